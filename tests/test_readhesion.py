"""The one name to import: what it hands on works, and natural mistakes get a sentence that says what to do."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import version

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import readhesion as r
from alloc.evaluation.metrics import METRICS
from alloc.plant.rail import Rail
from alloc.run.simulation import simulate as simulate_event


@pytest.fixture(scope="module")
def short():
    return r.load_scenario("wet-start").changed(duration_s=1.0)


@pytest.fixture(scope="module")
def run():
    return r.simulate("wet-patch", "cooperative", "perturb-observe")


def test_its_example(run, tmp_path):
    assert set(r.evaluate(run)) == set(METRICS)
    assert run.readhesion.metrics()["bound_use"] == r.evaluate(run)["bound_use"]
    table = r.compare("wet-patch", rules=["alone", "cooperative"], seeds=1)
    own = table[table["rule"] == "cooperative"].set_index("controller")
    assert own["bound_use"]["perturb-observe"] == r.evaluate(run)["bound_use"]
    assert (table["status"] == "ok").all()
    assert r.plot(run).axes
    run.readhesion.plot(tmp_path / "event.png")
    assert (tmp_path / "event.png").stat().st_size > 1000


def test_an_event_is_simulated_by_its_name_file_scenario_or_itself(short, tmp_path):
    path = tmp_path / "short.toml"
    path.write_text(
        'title = "short"\ntrain = "commuter-8car"\nduration_s = 1.0\n'
        '[rail]\nlevel = 0.1\nincrements = { law = "none" }\n[[command]]\ntime_s = 0.0\nacceleration_kmhs = 2.6\n'
    )
    first = r.simulate(path, "alone", seed=3)
    again = r.simulate(r.load_scenario(path).event(3), "alone")
    assert first.drop_attrs().equals(again.drop_attrs())
    assert r.simulate(short).attrs["event"] == "wet-start"


def test_a_comparison_goes_on_where_it_stopped(short, tmp_path, monkeypatch):
    asked = {"rules": ("alone", "exact"), "controllers": "none", "seeds": 2, "out": tmp_path}
    table = r.compare(short, **asked)
    assert table["rule"].value_counts().to_dict() == {"alone": 2, "exact": 2}
    assert set(METRICS) <= set(table.columns)
    monkeypatch.setattr("studies.run_cell.simulate", None)
    pd.testing.assert_frame_equal(r.compare(short, **asked), table)


def test_a_study_gives_rows_that_parquet_takes_its_table_and_its_statements(tmp_path):
    rows = r.sweep("claims", events=1)
    rows.to_parquet(tmp_path / "rows.parquet")
    assert pd.read_parquet(tmp_path / "rows.parquet").attrs == rows.attrs
    assert rows.attrs["table"]
    assert rows.attrs["statements"]


def test_axles_cars_and_units_are_counted_from_1(run):
    assert run.sel(unit=1)["limit"].equals(run["limit"].isel(unit=0))
    own = run["rail_force"].groupby("unit_of_axle").sum()
    driven = [unit for unit in own["unit_of_axle"].values if unit > 0]
    assert driven == run["unit"].values.tolist()
    last = run.sizes["car"]
    assert (run["car_of_axle"] == last).sum() == (run["axle_car"] == last - 1).sum() > 0


def test_runs_are_saved_and_loaded_by_several_threads_at_once(run, tmp_path):
    begin = run.isel(time=slice(100))

    def round_trip(k):
        path = str(tmp_path / f"run {k % 6}-{k}.nc")
        r.save(begin, path)
        return r.load(path).identical(begin)

    with ThreadPoolExecutor(4) as threads:
        assert all(threads.map(round_trip, range(24)))


MISTAKES = [
    (lambda e, run: r.simulate("WET-PATCH"), "unknown scenario 'WET-PATCH'; did you mean 'wet-patch'"),
    (lambda e, run: r.simulate(e, "exakt"), "did you mean 'exact'"),
    (lambda e, run: r.simulate(e, ["alone", "exact"]), "a run has one; `readhesion.compare`"),
    (lambda e, run: r.simulate(e, lambda problem: problem.cap), "give the name of a rule"),
    (lambda e, run: r.simulate(e, controller=Rail), "give the name of a controller"),
    (lambda e, run: r.simulate(e.event(), seed=1), "seed = 1: an event has its draws"),
    (lambda e, run: simulate_event(e), r"is no Event: its method event\(seed\) gives one"),
    (lambda e, run: simulate_event("wet-start"), "takes names too"),
    (lambda e, run: Rail(14), "14 % is 0.14"),
    (lambda e, run: r.AllocationProblem([0.1, 0.2], 17), "0.17 for 17 %"),
    (lambda e, run: r.compare(e, rules=r.RULES["exact"]), r"rules = Rule\(name='exact'.* give its name"),
    (lambda e, run: r.compare(e, rules=["exact", "exakt"]), "did you mean 'exact'"),
    (lambda e, run: r.compare(e, seeds=1.5), "seeds = 1.5: give a whole number from 1"),
    (lambda e, run: r.compare(e, seeds=[0, 1]), r"seeds = \[0, 1\]: give a whole number from 1"),
    (lambda e, run: r.compare(e, "alone", "none", out=5), "out = 5: give a folder"),
    (lambda e, run: r.compare(e, jobs=0), "jobs = 0: give a whole number from 1"),
    (lambda e, run: r.sweep("claim"), "unknown study 'claim'; did you mean 'claims'"),
    (lambda e, run: r.compare(e, rules=[]), r"rules = \[\]: give one or more"),
    (lambda e, run: r.sweep("claims", events=0), "events = 0: give a whole number from 1"),
    (lambda e, run: r.rank("exact", events=0), "events = 0: give a whole number from 1"),
    (lambda e, run: r.frame(run, "axles"), r"dimension = 'axles': give one of \['time', 'axle'"),
    (lambda e, run: r.evaluate("run.nc"), "not 'run.nc'; readhesion.load reads one"),
    (lambda e, run: r.evaluate(run.drop_vars("speed")), "'speed' is missing"),
    (lambda e, run: r.evaluate(run.isel(axle=slice(4))), "axle has 4 of 32"),
    (lambda e, run: r.evaluate(run.isel(unit=slice(None, None, -1))), "unit has 4 of 4, or another order"),
    (lambda e, run: r.evaluate(run.astype(np.float32)), "is float32, not float64"),
    (lambda e, run: r.evaluate(run.coarsen(time=10).mean()), "works is float64, not int64"),
    (lambda e, run: r.evaluate(run.assign(motor_torque=run["motor_torque"].where(run["unit"] > 1))), "torque has gaps"),
    (lambda e, run: r.evaluate(run.assign(rail_force=1e-3 * run["rail_force"])), "rail_force does not fit"),
    (lambda e, run: r.evaluate(run.assign(speed=run["speed"].assign_attrs(units="km h-1"))), "speed is km h-1, not m s-1"),
    (lambda e, run: r.evaluate(xr.concat([run, run], "run")), "offered is .*'run', 'time'"),
    (lambda e, run: r.evaluate(run.isel(time=slice(None, None, -1))), "by equal steps, first at instant 0"),
    (lambda e, run: r.evaluate(run.isel(time=np.r_[:300, 900:2200])), "by equal steps, first at instant 299"),
    (lambda e, run: r.evaluate(run.assign_coords(time=run["time"].astype("timedelta64[s]"))), "time is timedelta64"),
    (lambda e, run: r.evaluate(run.assign_coords(time=1e3 * run["time"])), "position is .* from what speed gives"),
    (lambda e, run: r.evaluate(run.isel(time=[*range(2200)] * 2).assign_coords(time=0.01 * np.arange(4400))), "what speed"),
]  # fmt: skip


def test_a_stretch_or_every_fifth_instant_of_a_run_is_whole_whoever_reads_it(run, tmp_path):
    run.to_netcdf(tmp_path / "run.nc", engine="scipy")
    read = xr.open_dataset(tmp_path / "run.nc", chunks={}).drop_vars(["cap", "level"])
    assert r.evaluate(read) == pytest.approx(r.evaluate(run), nan_ok=True)
    for part in (slice(500, 1500), slice(None, None, 5)):
        assert 0.9 < r.evaluate(run.isel(time=part))["bound_use"] <= 1.0


def test_a_frame_has_a_row_for_each_instant_and_number(run):
    for over in (("time", "axle"), ("time", "coupler"), ("time",)):
        table = r.frame(run, over[-1])
        for name, values in run.data_vars.items():
            assert (name in table) == (values.dims in (over, ("time",)))
            if values.dims == over:
                np.testing.assert_array_equal(table[name], values.values.ravel())
                assert table.attrs["units"][name] == values.attrs["units"]


def test_natural_mistakes_get_a_sentence_that_says_what_to_do(short, run):
    for mistake, sentence in MISTAKES:
        with pytest.raises(r.InputError, match=sentence) as caught:
            mistake(short, run)
        assert "\n" not in str(caught.value)


def test_its_names_are_public_and_it_is_the_command_too():
    assert set(dir(r)) == {*r.__all__, "__version__"}
    assert r.__version__ == version("readhesion")
    command = [sys.executable, "-m", "readhesion", "simulate", "no-such"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2
    assert "unknown scenario 'no-such'" in done.stderr
