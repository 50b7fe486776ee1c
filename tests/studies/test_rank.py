"""What a rank says beside places: the worst events, a cause that is at work there, and commands that work as printed."""

import re
import shlex

import pandas as pd
import pytest
from matplotlib.figure import Figure

import readhesion
from alloc.rules import RULES
from studies import PartFailed, benchmark, rank
from studies.command.command_line import run
from studies.files.scenario_files import load_scenario

EVENTS = 3
HELD = """
from readhesion import RULES, Rule
RULES.register(Rule("held", "half the plan", answer=lambda p: 0.5 * p.plan * p.mass**0, belief="delivered always"))
"""


def test_a_rank_names_events_with_causes_and_commands_that_work(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(rank, "LONG", 0.0)
    (tmp_path / "held.py").write_text(HELD)
    assert run(["rank", "held.py", "--events", str(EVENTS), "--jobs", "1"]) == 0
    output, errors = capsys.readouterr()
    assert f"{EVENTS} runs, of which {EVENTS - 1} are to be made: about " in errors
    cause = r"points\n    limits below the plan and what the rail gives in \d\d % of the time\n"
    assert re.search(cause, output.partition("worst events")[2])
    folder = tmp_path / "results" / "rank-held-perturb-observe"
    assert (folder / "figure.pdf").stat().st_size > 1e4
    used = pd.read_parquet(folder / "rows.parquet").set_index("scenario")["bound_use"]
    lines = output.replace("\\\n", "").splitlines()
    commands = [shlex.split(line) for line in lines if line.startswith("    readhesion ")]
    for command in commands:
        assert run(command[1:]) == 0
        assert f"{used[command[4]]:.4g}" in capsys.readouterr().out
        assert (tmp_path / command[-1]).stat().st_size > 1e4
    assert {command[4] for command in commands} == set(used.index)

    ranking = readhesion.rank("held", events=EVENTS, out=folder)
    assert output.startswith(f"{ranking!r}\n{EVENTS} rows")
    assert isinstance(ranking.plot(tmp_path / "forest.png"), Figure)
    assert ranking["used"].is_monotonic_decreasing


FAILS = """
import numpy as np
from readhesion import RULES, Rule
RULES.register("fails", Rule("fails", "where a train has units", answer=lambda p: np.full(min(p.n, 3), p.plan)))
"""


def test_a_part_that_fails_has_no_place(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fails.py").write_text(FAILS)
    assert run(["rank", "fails.py", "--events", "6", "--jobs", "1"]) == 1
    output, errors = capsys.readouterr()
    assert "place" not in output
    failed = re.search(
        r"(\d) of 6 events failed in rank-fails-perturb-observe, first (\S+): .*shape", errors
    )
    assert failed
    assert 1 <= int(failed[1]) < 6
    assert load_scenario(failed[2]).event().world().units.size > 3
    assert not (tmp_path / "results/rank-fails-perturb-observe/table.md").exists()
    with pytest.raises(PartFailed, match=f"{failed[1]} of 6 events failed"):
        readhesion.rank("fails", events=6, out=tmp_path / "results/rank-fails-perturb-observe")


def causes(rule, controller="perturb-observe", latency=0.05):
    telegrams = {"latency_s": latency, "silence_s": 5.0}
    event = load_scenario("wet-patch").changed(onboard={"telegrams": telegrams})
    return rank.measure_causes(readhesion.simulate(event, rule, controller))


def test_causes_are_at_work_where_they_were_put():
    alone, cut = causes("alone"), causes("alone", "cut-and-ramp")
    assert max(alone[name] for name in ("held", "asked", "late")) < 1e-3
    assert causes(RULES["exact"].with_belief("delivered"))["held"] > 0.1
    assert causes("most", "cut-and-ramp")["asked"] > cut["asked"] + 0.05
    assert causes("alone", "none")["slip"] > alone["slip"] + 0.1
    assert alone["spared"] > cut["spared"] + 0.03  # it rests below the peak, where nothing slips
    assert cut["slips"] > alone["slips"] + 0.1
    early, late = (causes("greedy-tuned", "cut-and-ramp", seconds) for seconds in (0.05, 2.0))
    assert late["late"] > early["late"] + 0.05


@pytest.mark.parametrize("controllers", [["mpc"], ["mpc", "perturb-observe"], ["none"]])
def test_a_comparison_says_what_drawn_events_say(controllers):
    rules = "alone", "cooperative", "exact", "most", "mine"
    rows = pd.DataFrame(
        [("wet-patch", rule, name) for rule in rules for name in controllers],
        columns=["scenario", "rule", "controller"],
    )
    text = benchmark.summarise_stored(rows)
    if controllers == ["none"]:
        assert not text
        return
    runs = benchmark.split_runs(benchmark.read_stored(), controllers[-1])
    for rule, verb in (("cooperative", "gains"), ("exact", "loses")):
        size = abs(benchmark.find_gain(runs, rule, "alone").mean())
        assert f"{rule} {verb} {size:.2f} points" in text
    assert "most" not in text
    assert text.endswith("For mine on drawn events, run readhesion rank.")
    assert not benchmark.summarise_stored(rows.assign(scenario="population-65-0000"))
