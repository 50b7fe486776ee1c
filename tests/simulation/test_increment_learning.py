"""Increments learnt in whole runs: what the record says of them, and runs in which nothing is learnt."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from alloc.estimation.increments import learnt_in
from alloc.onboard.increment_learning import IncrementLearning, gaussian_posterior, running_mean
from alloc.recording import VARIABLES
from alloc.simulation import simulate
from studies.scenario.loading import shipped_scenario


def start(learning=None, failures=(), loss=0.0, trigger="slip"):
    """A start on rail that is wet from end to end; the foremost unit may fail."""
    base = shipped_scenario("wet-start")
    rail = base.rail.model_dump() | {"level": 0.125, "scatter": 0.0085}
    event = base.changed(
        rail=rail, variation=None, duration_s=8.0, failures=failures,
        onboard={"telegrams": {"loss": loss}, "trigger": trigger},
    ).event(3)  # fmt: skip
    if learning is None:
        return event
    return replace(event, onboard=replace(event.onboard, learning=learning))


def data(run):
    """The data of a run: instant (index), unit, value."""
    number = run["increment_data"].values
    instant, unit = np.nonzero(np.diff(number, axis=0, prepend=0.0))
    return list(zip(instant, unit, run["increment_datum"].values[instant, unit], strict=True))


def onsets(run):
    """Instants (indices) at which the slip signal of each unit goes on."""
    signal = np.diff(run["slipping"].values, axis=0, prepend=0) > 0
    return [np.flatnonzero(on) for on in signal.T]


MEAN = IncrementLearning("running-mean", first=3, further=2, stored=4.0)


@pytest.mark.parametrize("trigger", ["slip", "limited"])
def test_what_a_run_learns_is_16_and_17_of_its_data(trigger):
    event = start(replace(MEAN, reference="held"), trigger=trigger)
    run = simulate(event, "exact")
    given = run["increment"].values[0]
    increment, count = given.copy(), np.full(4, 4.0)
    waiting, updates = [[] for _ in range(4)], np.zeros(4)
    over_time = np.tile(given, (run.sizes["time"], 1))
    for k, unit, value in data(run):
        waiting[unit].append(value)
        if len(waiting[unit]) == (2 if updates[unit] else 3):
            n = len(waiting[unit])
            increment[unit] = running_mean(increment[unit], count[unit], sum(waiting[unit]), n)
            count[unit] += n
            waiting[unit], updates[unit] = [], updates[unit] + 1
        over_time[k:, unit] = increment[unit]
    assert updates.sum() > 0
    np.testing.assert_allclose(run["increment"].values, over_time, rtol=1e-12, atol=1e-15)
    for name in (name for name in VARIABLES if name.startswith(("increment", "learnt"))):
        assert (run[name].dims, run[name].attrs["units"]) == (VARIABLES[name].dims, "1")
    learnt = learnt_in(run)
    np.testing.assert_allclose(learnt.increment, increment, rtol=1e-12, atol=1e-15)
    assert learnt.behind == tuple(count)
    assert learnt.waiting == tuple(map(len, waiting))
    np.testing.assert_allclose(learnt.waiting_sum, list(map(sum, waiting)), rtol=1e-12)
    assert learnt.updates == tuple(updates)


def test_a_second_run_goes_on_where_the_first_one_ended():
    event = start(IncrementLearning("gaussian", "held"))
    first = simulate(event, "exact")
    learnt = learnt_in(first)
    belief = replace(event.onboard.belief, learnt=learnt)
    second = simulate(replace(event, onboard=replace(event.onboard, belief=belief)), "exact")
    np.testing.assert_array_equal(second["increment"].values[0], learnt.increment)
    mean, deviation = np.array(learnt.increment), np.array(learnt.deviation)
    for _, unit, value in data(second):
        mean[unit], deviation[unit] = gaussian_posterior(
            mean[unit], deviation[unit], value, 0.012, 0.0
        )
    assert second["increment_data"].values[-1].sum() > 0
    np.testing.assert_allclose(second["learnt_increment"].values, mean, rtol=1e-9)
    np.testing.assert_allclose(second["learnt_deviation"].values, deviation, rtol=1e-9)


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_every_slip_of_a_rear_unit_is_one_datum(loss):
    """One that is not followed by another before the next telegrams, and not shortly before the end."""
    run = simulate(start(replace(MEAN, first=1000), loss=loss, trigger="limited"), "exact")
    assert (run.attrs["telegrams_lost"] > 0) == (loss > 0.0)
    time, found, checked = run["time"].values, data(run), 0
    for unit, instants in enumerate(onsets(run)):
        taken = time[[k for k, j, _ in found if j == unit]] if unit else np.zeros(0)
        assert len(taken) <= len(instants)
        at = [*time[instants], np.inf]
        for begin, until in pairwise(at):
            if unit and until - begin > 0.6 and begin < time[-1] - 0.6:
                assert np.sum((begin < taken) & (taken < begin + 0.6)) == 1
                checked += 1
    assert checked >= 5


def test_a_leader_that_fails_teaches_nothing_by_its_failure():
    """The foremost unit's motors fail at 3 s; the report of a slip arrives before the train knows of it."""
    run = simulate(start(replace(MEAN, first=1000), ({"unit": 1, "time_s": 3.0},)), "exact")
    values = {"before": [], "after": []}
    for k, unit, value in data(run):
        values["before" if run["time"].values[k] < 3.0 else "after"].append(value)
        assert unit > (0 if run["time"].values[k] < 3.1 else 1)
    assert all(values.values())
    # a leader without motors finds no adhesion: its data would be those of the rail itself, 0.108 in this run
    assert max(values["before"] + values["after"]) < 0.06


def test_runs_in_which_nothing_is_learnt_are_as_they_were():
    plain = simulate(start(), "exact")
    other = simulate(start(IncrementLearning("none", "held", 1, 1, 0.0, 0.5)), "exact")
    assert not [name for name in map(str, plain) if "increment" in name or "learnt" in name]
    for name in plain:
        np.testing.assert_array_equal(plain[name].values, other[name].values)
    # and what takes data alone, as a learner that never changes anything, does not move the first slips
    idle = simulate(start(replace(MEAN, first=10**9)), "exact")
    before = int(min(k[0] for k in onsets(idle)[1:] if k.size))
    for name in plain:
        if "time" in plain[name].dims:
            kept, found = plain[name].values[:before], idle[name].values[:before]
            # increments count from the foremost unit then: the same differences, rounded otherwise
            np.testing.assert_allclose(found, kept, rtol=1e-9, atol=1e-9, err_msg=str(name))
