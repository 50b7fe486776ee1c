"""The one name to import: what it hands on works, and natural mistakes get a sentence that says what to do."""

import subprocess
import sys
from fractions import Fraction

import numpy as np
import pytest

import readhesion
from alloc.metrics import METRICS
from alloc.plant.rail import Rail
from alloc.simulation import simulate as simulate_event
from studies.core import StudyError


@pytest.fixture(scope="module")
def short():
    return readhesion.load_scenario("wet-start").changed(duration_s=1.0)


def test_an_event_is_simulated_by_its_name_file_scenario_or_itself(short, tmp_path):
    path = tmp_path / "short.toml"
    path.write_text(
        'title = "short"\ntrain = "commuter-8car"\nduration_s = 1.0\n'
        '[rail]\nlevel = 0.1\nincrements = { law = "none" }\n[[command]]\ntime_s = 0.0\nacceleration_kmhs = 2.6\n'
    )
    first = readhesion.simulate(path, "alone", seed=3)
    again = readhesion.simulate(readhesion.load_scenario(path).event(3), "alone")
    assert first.drop_attrs().equals(again.drop_attrs())
    assert readhesion.simulate(short).attrs["event"] == "wet-start"
    assert set(readhesion.evaluate(first)) == set(METRICS)
    with pytest.raises(readhesion.InputError, match="has its draws already"):
        readhesion.simulate(short.event(), seed=1)


def test_a_comparison_gives_a_row_per_run_and_goes_on_where_it_stopped(
    short, tmp_path, monkeypatch
):
    asked = {"rules": ("alone", "exact"), "controllers": "none", "out": tmp_path}
    table = readhesion.compare(short, **asked)
    assert list(table["rule"]) == ["alone"] * 5 + ["exact"] * 5
    assert list(table.columns[:6]) == list(readhesion.FIRST)
    assert (table["status"] == "ok").all()
    assert set(METRICS) <= set(table.columns)
    run = readhesion.simulate(short, "exact", "none", seed=int(table["seed"].iloc[6]))
    assert table["effort_ratio"].iloc[6] == readhesion.evaluate(run)["effort_ratio"]
    monkeypatch.setattr("studies.core.run.run_cell", None)
    assert readhesion.compare(short, **asked).equals(table)
    with pytest.raises(readhesion.InputError, match="by out"):
        readhesion.compare(short, keep=["*"])


def test_a_study_gives_its_table_and_its_statements():
    table = readhesion.sweep("headroom", events=2, duration=3.0, controllers=["cut-and-ramp"])
    assert len(table)
    assert table.attrs["statements"]
    with pytest.raises(
        readhesion.InputError, match="unknown option of the sweep headroom 'durations'"
    ):
        readhesion.sweep("headroom", durations=1.0)


def test_a_run_is_drawn_or_written(short, tmp_path):
    run = readhesion.simulate(short)
    assert readhesion.plot(run).axes
    run.readhesion.plot(tmp_path / "run.png")
    assert (tmp_path / "run.png").stat().st_size > 1000


def test_axles_cars_and_units_are_counted_from_1(short, tmp_path):
    run = readhesion.simulate(short)
    first = run.sel(unit=1)
    assert first["limit"].equals(run["limit"].isel(unit=0))
    own = run["rail_force"].groupby("unit_of_axle").sum()
    driven = [unit for unit in own["unit_of_axle"].values if unit > 0]
    assert driven == run["unit"].values.tolist()
    last = run.sizes["car"]
    assert (run["car_of_axle"] == last).sum() == (run["axle_car"] == last - 1).sum() > 0
    readhesion.save(run, tmp_path / "run.nc")
    assert readhesion.load(tmp_path / "run.nc").identical(run)
    assert run.readhesion.metrics()["damage"] == readhesion.evaluate(run)["damage"]


MISTAKES = [
    (lambda e: simulate_event(e), r"is no Event: its method event\(seed\) gives one"),
    (lambda e: simulate_event("wet-start"), "takes names too"),
    (lambda e: readhesion.simulate(e, ["alone", "exact"]), "a run has one; `readhesion.compare`"),
    (lambda e: readhesion.simulate(e, lambda problem: problem.cap), r"give its name, or Rule\("),
    (lambda e: readhesion.simulate(e, controller=Fraction), r"or HostedController\("),
    (lambda e: readhesion.simulate(e, "exakt"), "did you mean 'exact'"),
    (lambda e: readhesion.simulate("WET-PATCH"), "did you mean 'wet-patch'"),
    (lambda e: readhesion.RULES["exakt"], "did you mean 'exact'"),
    (lambda e: Rail(14), "14 % is 0.14"),
    (lambda e: readhesion.AllocationProblem([0.1, 0.2], 17), "0.17 for 17 %"),
    (lambda e: readhesion.compare(e, rules=["exact", "exakt"]), "did you mean 'exact'"),
    (lambda e: readhesion.compare(e, rules=[lambda problem: 0.0]), "must be a name"),
    (lambda e: readhesion.sweep("claim"), "did you mean 'claims'"),
]  # fmt: skip


def test_natural_mistakes_get_a_sentence_that_says_what_to_do(short):
    for mistake, sentence in MISTAKES:
        with pytest.raises((readhesion.InputError, KeyError), match=sentence) as caught:
            mistake(short)
        assert "\n" not in str(caught.value)
    assert issubclass(StudyError, readhesion.InputError)


def test_the_module_is_the_command_too():
    done = subprocess.run(
        [sys.executable, "-m", "readhesion", "simulate", "no-such"], capture_output=True, text=True
    )
    assert done.returncode == 2
    assert "unknown scenario 'no-such'" in done.stderr
    assert np.all([name in dir(readhesion) for name in readhesion.__all__])
