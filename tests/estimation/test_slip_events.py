"""Slips found in series that were made up, and car forces of cars whose forces are known."""

import numpy as np
import pytest

from alloc.errors import EstimationError
from alloc.estimation.slip_events import SlipCriterion, find_slips
from studies.logs.measured_run import parts

TIME = np.arange(1000) * 0.01


def humps(*where, height=1.0, width=1.0):
    """Slip velocity with humps sin^2 that begin at these times [s]."""
    inside = [np.clip((TIME - begin) / width, 0.0, 1.0) for begin in where]
    return height * sum(np.sin(np.pi * x) ** 2 for x in inside)


def find(slip, coefficient=None, **criterion):
    speed = np.full(TIME.size, 10.0)
    damage = None if coefficient is None else 100.0 * TIME
    return find_slips(3, TIME, speed, speed + slip, coefficient, damage, SlipCriterion(**criterion))


def test_slips_and_slides_are_found_in_order():
    events = find(humps(1.0) - humps(4.0) + humps(7.0, height=0.3))
    assert [(event.kind, round(event.largest_slip, 3)) for event in events] == [
        ("slip", 1.0), ("slide", -1.0)
    ]  # fmt: skip
    first = events[0]
    assert first.slip_ratio == pytest.approx(1.0 / 11.0, rel=0.01)
    assert (first.axle, first.cut) == (3, False)
    half = 0.5 * 0.05 * 10.0
    assert first.start == pytest.approx(1.0 + np.arcsin(np.sqrt(half)) / np.pi, abs=0.02)
    assert len(find(humps(7.0, height=0.3), ratio=0.01)) == 1  # by another criterion it is one


def test_a_slip_at_the_ends_of_the_series_is_cut():
    events = find(humps(-0.5) + humps(9.5))
    assert [event.cut for event in events] == [True, True]


def test_a_slip_that_seems_over_for_a_moment_is_one():
    slip = humps(1.0, width=2.0)
    slip[200:205] = 0.0
    assert len(find(slip)) == 1
    slip[190:215] = 0.0
    assert len(find(slip)) == 2


def test_the_adhesion_is_read_as_the_slip_begins():
    """Neither from the better rail before nor from the better rail after."""
    mu = np.full(TIME.size, 0.1)
    mu[:150], mu[250:] = 0.2, 0.3
    (event,) = find(humps(1.0, width=4.0), mu)
    assert event.onset_coefficient == 0.1
    assert event.utilisation > 1.5  # the better rail after
    assert event.damage == pytest.approx(100.0 * (event.end - event.start + 0.01), rel=1e-6)
    (slide,) = find(-humps(1.0, width=4.0), -mu)
    assert slide.onset_coefficient == 0.1


def test_an_onset_that_was_not_seen_tells_nothing():
    (event,) = find(humps(-0.5), np.full(TIME.size, 0.1))
    assert np.isnan([event.onset_coefficient, event.utilisation]).all()
    assert np.isfinite(event.damage)


def test_parts_end_at_gaps_and_at_missing_values():
    valid = np.ones(40, dtype=bool)
    valid[[5, 33]] = False
    part = np.repeat([0, 1, 2], [20, 2, 18])
    found = [(inside.start, inside.stop) for inside in parts(valid, part)]
    assert found == [(0, 5), (6, 20), (22, 33), (34, 40)]  # two instants are too short


def test_events_are_in_the_order_of_time():
    assert [event.kind for event in find(humps(4.0) - humps(1.0))] == ["slide", "slip"]


def test_the_bound_is_a_share_of_the_larger_speed():
    bound = SlipCriterion().bound(
        np.array([10.0, 20.0, -20.0, 3.0]), np.array([20.0, 10.0, 0.0, 3.9])
    )
    assert bound.tolist() == [1.0, 1.0, 1.0, 0.2]


def test_slip_at_the_bound_itself_is_none():
    still = np.zeros(TIME.size)
    for rim, count in ((0.2, 0), (0.21, 1)):
        found = find_slips(0, TIME, still, still + rim, None, None, SlipCriterion())
        assert len(found) == count


def test_onset_is_sought_from_half_of_its_time_after_the_start_until_that_time_after_the_bound():
    # slip t - 1 against 0.05 (9 + t): past half of it at 1.26 s, past it at 1.53 s; so between 1.31 and 1.63 s
    mu = np.full(TIME.size, 0.1)
    mu[[130, 160, 164]] = 0.4, 0.3, 0.5
    (event,) = find(np.clip(TIME - 1.0, 0.0, 1.0) * (TIME < 3.0), mu)
    assert event.start == pytest.approx(1.26)
    assert (event.onset_coefficient, event.onset_time) == (0.3, pytest.approx(1.60))
    mu[[131, 163]] = 0.35, 0.34
    (event,) = find(np.clip(TIME - 1.0, 0.0, 1.0) * (TIME < 3.0), mu)
    assert event.onset_time == pytest.approx(1.31)
    # mean of 174 instants over the largest: all 0.1 but 0.4, 0.35, 0.3, 0.34, 0.5
    assert event.utilisation == pytest.approx((169 * 0.1 + 1.89) / 174 / 0.35)


@pytest.mark.parametrize(("gap", "events"), [(8, 1), (9, 2)])
def test_less_than_a_tenth_of_a_second_is_bridged(gap, events):
    slip = np.where((TIME >= 1.0) & (TIME < 3.0), 1.0, 0.0)
    slip[150 : 150 + gap] = (
        0.0  # from the last instant before to the first after it is one period more
    )
    assert len(find(slip)) == events


@pytest.mark.parametrize(("instants", "found"), [(3, 0), (4, 1)])
def test_a_part_has_more_than_three_instants(instants, found):
    valid = np.arange(10) < instants
    assert len(list(parts(valid, np.zeros(10, dtype=int)))) == found


@pytest.mark.parametrize("name", ["velocity", "ratio"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan")])
def test_an_impossible_criterion_is_refused(name, value):
    with pytest.raises(EstimationError, match=name):
        SlipCriterion(**{name: value})
