"""The net of hashes: it tells a moved number from a better sentence, and another machine from another result."""

import json
from dataclasses import asdict, replace

import numpy as np
import pandas as pd
import xarray as xr

from studies.core.statement import FAILS, HOLDS, Interval, Statement
from tests.results_hash import (
    STORED,
    TRACED,
    Hashes,
    difference,
    run_hashes,
    statements_hashes,
    table_hashes,
    tasks,
)

ONE = Statement(
    "one", "uses more", HOLDS, {"mean [%]": Interval(1.5, 1.0, 2.0, 9)}, ("gains 3.1 % on dry rail",)
)  # fmt: skip
TABLE = pd.DataFrame({"rule": ["alone", "exact"], "effort": [0.5, 0.75], "damage": [1.0, 2.0]})
RUN = xr.Dataset({name: ("time", np.linspace(0.0, 1.0, 9) + k) for k, name in enumerate(TRACED)})


def test_it_says_which_of_numbers_and_words_moved():
    before = statements_hashes([ONE])
    for changed, moved in (
        (replace(ONE, claim="uses more of it"), "words"),
        (replace(ONE, conditions=("it gains 3.1 % on dry rail",)), "words"),
        (replace(ONE, numbers={"mean": ONE.numbers["mean [%]"]}), "words"),
        (replace(ONE, conditions=("gains 3.2 % on dry rail",)), "numbers"),
        (replace(ONE, numbers={"mean [%]": Interval(1.5, 1.0, 2.1, 9)}), "numbers"),
        (replace(ONE, verdict=FAILS), "numbers"),
        (replace(ONE, verdict=FAILS, claim="uses less"), "numbers and words"),
        (ONE, ""),
    ):
        assert statements_hashes([changed]).moved(before) == moved
    before = table_hashes(TABLE)
    swapped = TABLE.assign(effort=TABLE["damage"], damage=TABLE["effort"])
    for table, moved in (
        (TABLE[::-1][["damage", "rule", "effort"]], ""),
        (TABLE.rename(columns={"damage": "wheel_damage"}), "words"),
        (TABLE.replace("alone", "each alone"), "words"),
        (TABLE.assign(damage=[1.0, np.nextafter(2.0, 3.0)]), "numbers"),
        (TABLE.assign(damage=[2.0, 1.0]), "numbers"),
        (swapped, "order, or which name has which number"),
    ):
        assert table_hashes(table).moved(before) == moved
    before = run_hashes(RUN)
    assert run_hashes(RUN.rename(speed="pace")).moved(before) == "words"
    assert run_hashes(RUN.rename(speed="limit", limit="speed")).moved(before).startswith("order")
    assert run_hashes(RUN.assign(speed=1.0 * RUN["speed"] + 1e-15)).moved(before) == "numbers"


def test_another_machine_may_round_but_not_differ():
    means = [10.0, 0.1, 2e3, 0.0, 1e5]
    stored = {"hashes": {"run/a": "1 2 3", "table/a": "1 2 3"}, "traces": {"run/a": means}}
    other = Hashes("4", "5", "3")
    rounded, apart = [(1.0 + 1e-9) * one for one in means], [10.001, *means[1:]]
    assert difference(("run/a", other, rounded), stored, same_machine=True) == "numbers"
    assert difference(("run/a", other, rounded), stored, same_machine=False) == ""
    assert "mean of speed" in difference(("run/a", other, apart), stored, same_machine=False)
    assert difference(("table/a", other, []), stored, same_machine=False) == ""
    assert difference(("table/b", other, []), stored, same_machine=False) == "new"


def test_what_is_stored_is_what_is_computed():
    stored = json.loads(STORED.read_text())
    labels = {label.removeprefix("study/") for label, _ in tasks()}
    names = {name for name in stored["hashes"] if not name.startswith(("table/", "statements/"))}
    studies = {name.partition("/")[2] for name in stored["hashes"] if name.startswith("table/")}
    assert names | studies == labels
    assert set(stored["traces"]) == {name for name in names if name.startswith("run/")}
    assert all(
        len(three.split()) == len(asdict(Hashes("", "", ""))) for three in stored["hashes"].values()
    )
