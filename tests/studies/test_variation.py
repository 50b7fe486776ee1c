"""What differs between seeds: drawn within bounds by all but seed 0, and refused where nothing is left to chance."""

import numpy as np
import pytest

from alloc.simulation import inputs_hash, simulate
from studies.comparison.summary import make_grid
from studies.files.study_error import StudyError
from studies.scenario.scenario import Day, VariationKeys, load_scenario, shipped_scenarios

RAIL = {"level": 0.05, "increments": {"law": "logarithmic"}}
QUIET = {"rail": RAIL, "onboard": {}, "variation": None}
"""Changes of the short scenario after which nothing of it is drawn."""
CHANCES = {
    "scatter of the rail": {"rail": RAIL | {"scatter": 0.01}},
    "noise of the speeds": {"onboard": {"sensors": {"speed_noise_kmh": 0.02}}},
    "jitter of telegrams": {"onboard": {"telegrams": {"jitter_s": 0.03}}},
    "loss of telegrams": {"onboard": {"telegrams": {"loss": 0.1}}},
    "errors of load signals": {
        "onboard": {"sensors": {"load_error": 0.05}}, "load_t": (1.0,) * 8,
    },
    "phase of the receptivity": {"receptivity": {"mean": 0.5, "amplitude": 0.3}},
    "level": {"variation": {"level": (0.9, 1.1), "start_m": 0.0, "delay_s": 0.0}},
    "start": {"variation": {"level": (1.0, 1.0), "start_m": 1.0, "delay_s": 0.0}},
    "delay": {"variation": {"level": (1.0, 1.0), "start_m": 0.0, "delay_s": 0.1}},
}  # fmt: skip


def test_a_seed_of_0_is_the_event_as_it_is_without_variation(short):
    plain, varied = short.changed(variation=None), short.changed(variation={})
    assert plain.event(0).hash == varied.event(0).hash
    assert plain.event(1).hash != varied.event(1).hash
    assert VariationKeys().day(0) == Day()


def test_days_lie_within_their_bounds_and_fill_them():
    keys = VariationKeys(level=(0.9, 1.05), start_m=3.0, delay_s=0.2)
    days = [keys.day(seed) for seed in range(1, 2001)]
    for values, low, high in (
        ([day.level for day in days], 0.9, 1.05),
        ([day.start for day in days], -3.0, 3.0),
        ([day.delay for day in days], 0.0, 0.2),
    ):
        share = (np.sort(values) - low) / (high - low)
        # Kolmogorov and Smirnov: beyond 1.63 / sqrt(n) for one draw of a hundred
        assert np.abs(share - np.linspace(0.0, 1.0, share.size)).max() < 1.63 / np.sqrt(share.size)
    assert keys.day(7) == keys.day(7)


def test_what_is_drawn_arrives_in_the_event(short):
    keys = {"level": (0.9, 0.95), "start_m": 3.0, "delay_s": 0.2}
    scenario = short.changed(variation=keys)
    event, day = scenario.event(3), VariationKeys(**keys).day(3)
    assert event.model.rail.level == day.level * 0.05
    assert event.initial_position == day.start != 0.0
    assert event.command.times == (day.delay,)
    assert event.model.span[0] == day.start - 20.0


@pytest.mark.parametrize("chance", CHANCES)
def test_what_is_left_to_chance_is_noticed(short, chance):
    assert not short.changed(**QUIET).draws()
    assert short.changed(**(QUIET | CHANCES[chance])).draws()


def test_where_nothing_is_drawn_the_runs_of_all_seeds_are_one(short):
    quiet = short.changed(**QUIET)
    one, other = (simulate(quiet.event(seed), "greedy") for seed in (0, 3))
    assert one.equals(other)
    assert inputs_hash(quiet.event(0)) == inputs_hash(quiet.event(3))


def test_seeds_are_refused_where_nothing_is_drawn_and_left_out_by_default(short):
    quiet = short.changed(**QUIET, name="quiet")
    with pytest.raises(StudyError, match="nothing in scenario 'quiet' depends on the seed"):
        make_grid([short, quiet], ["exact"], ["none"], 2)
    assert len(make_grid([quiet], ["exact"], ["none"], 1).jobs()) == 1
    jobs = make_grid([short, quiet], ["exact"], ["none"], None).jobs()
    assert [job.seed for job in jobs if job.scenario == quiet] == [0]
    assert [job.seed for job in jobs if job.scenario == short] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("level", [(1.1, 0.9), (0.0, 1.0), (-1.0, 1.0)])
def test_impossible_bounds_are_refused(short, level):
    with pytest.raises(StudyError, match="variation"):
        short.changed(variation={"level": level})


@pytest.mark.parametrize("name", shipped_scenarios())
def test_every_shipped_scenario_differs_from_day_to_day(name):
    scenario = load_scenario(name)
    hashes = {inputs_hash(scenario.event(seed)) for seed in range(4)}
    assert len(hashes) == 4
    assert len({scenario.event(seed).model.rail.level for seed in range(4)}) == 4
