"""`make bench` compares ratios with those of `docs/results/benchmarks.md`; `make bench-keep` adds to it."""

import os

import pandas as pd
import pytest

from alloc.event import DriverCommand
from alloc.metrics import evaluate
from alloc.onboard.controllers.simple import TorqueTable
from alloc.plant import engine as compiled
from alloc.plant.model import build
from alloc.plant.rail import Patch, Rail
from alloc.plant.sets import find_set
from alloc.simulation import simulate
from studies.readhesion_paper.lanes import simulate_tables
from studies.scenario.scenario import load_scenario
from tests.benchmarks import history

ROUNDS = 150


def _model(name):
    return build(find_set(name), Rail(0.2, patches=(Patch(0.6, start=5.0),)))


def _plant(name, step, steps):
    model = _model(name)
    w, start, inputs = (
        compiled.workspace(model, step),
        model.initial_state(20.0),
        model.zero_inputs(),
    )
    inputs.torque_command[:] = 500.0
    return lambda: compiled.advance(w, 0.0, step, steps, start.copy(), inputs)


def _run():
    event = load_scenario("wet-patch").event(0)
    return lambda: simulate(event, "exact", "cut-and-ramp")


def _metrics():
    run = _run()()
    return lambda: evaluate(run)


def _lanes():
    rails, tables = [Rail(0.1 + 0.001 * k) for k in range(8)], [TorqueTable()] * 8
    command, train = DriverCommand((0.0,), (0.8,)), find_set("one-axle")
    return lambda: simulate_tables(train, rails, tables, command, 0.0, 0.1)


WAYS = {
    "plant, 32 axles, 100 steps of 2 ms": lambda: _plant("commuter-8car", 2e-3, 100),
    "plant, 64 axles, 100 steps of 2 ms": lambda: _plant("high-speed-16car", 2e-3, 100),
    "plant, 74 axles coupled, 100 steps of 0.5 ms": lambda: _plant("freight-17", 5e-4, 100),
    "plant, one axle, 1000 steps of 50 us": lambda: _plant("one-axle", 5e-5, 1000),
    "eight lanes of the readhesion paper, 0.1 s": _lanes,
    "run of 20 s with 32 axles, recorded": _run,
    "all metrics of that run": _metrics,
}


def test_ratios_do_not_grow(benchmark):
    benchmark(lambda: None)
    if not benchmark.enabled:
        pytest.skip("times are compared by `make bench`")
    now = history.entries(history.ratios({name: make() for name, make in WAYS.items()}, ROUNDS))
    benchmark.extra_info.update(now.set_index("way")["ratio"].to_dict())
    slower = history.grown(now, history.stored())
    if os.environ.get("READHESION_KEEP_BENCHMARKS"):
        history.keep(now)
    assert not slower, "; ".join(slower)


def _entry(way, ratio, processor=None):
    return [["2026-01-01", processor or history.processor(), "", way, 1.0, ratio]]


@pytest.mark.parametrize(("ratio", "told"), [(1.19, []), (1.21, ["way: 1.21"]), (0.5, [])])
def test_a_fifth_more_is_told(ratio, told):
    before = pd.DataFrame(_entry("way", 9.0) + _entry("way", 1.0), columns=history.COLUMNS)
    now = pd.DataFrame(_entry("way", ratio) + _entry("new", 9.0), columns=history.COLUMNS)
    assert [line.partition(" of")[0] for line in history.grown(now, before)] == told


def test_other_processors_do_not_count():
    before = pd.DataFrame(_entry("way", 1.0, "another"), columns=history.COLUMNS)
    now = pd.DataFrame(_entry("way", 5.0), columns=history.COLUMNS)
    assert history.grown(now, before) == []


def test_ways_take_turns_and_a_way_that_does_twice_the_work_has_twice_the_ratio(monkeypatch):
    calls, spent = [], [0.0]

    def work(name, seconds):
        calls.append(name)
        spent[0] += seconds

    monkeypatch.setattr(history, "_measure", lambda: work("", 0.5))
    monkeypatch.setattr(history.time, "process_time", lambda: spent[0])
    ways = {name: lambda name=name, s=s: work(name, s) for name, s in (("a", 1.0), ("b", 2.0))}
    found = history.ratios(ways, 3).set_index("way")
    assert calls == ["", *"aabb", *["", "a", "", "b"] * 3]
    assert found["ratio"].tolist() == [2.0, 4.0]
    assert found["microseconds"].tolist() == [1e6, 2e6]


def test_what_is_kept_is_read_again(tmp_path, monkeypatch):
    page = tmp_path / "page.md"
    page.write_text("# Title\n\n| a | b |\n|---|---|\n")
    monkeypatch.setattr(history, "PAGE", page)
    found = pd.DataFrame({"way": ["one", "other"], "microseconds": [2.0, 1.0], "ratio": [1.0, 0.5]})
    now = history.entries(found)
    history.keep(now)
    history.keep(now)
    pd.testing.assert_frame_equal(history.stored(), pd.concat([now, now], ignore_index=True))
    assert history.stored()["ratio"].tolist() == [1.0, 0.5, 1.0, 0.5]
