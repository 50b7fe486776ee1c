"""Axles of another recorder are found by the wheels that roll; an axle that creeps or slips for long goes with its car."""

import numpy as np
import pytest

from alloc.plant.sets import find_set
from studies.logs.axle_delays import late_axles
from studies.logs.known_train import MeasuredTrain

TRAIN = MeasuredTrain.of(find_set("commuter-8car"))
TIME = 0.01 * np.arange(3000)
DRIVEN = np.flatnonzero(TRAIN.driven)


def speed(time: np.ndarray) -> np.ndarray:
    """A start, and a brake application from 15 s on."""
    return np.interp(time, [0.0, 1.0, 15.0, 30.0], [0.0, 0.4, 10.0, 1.0])


def rims(late: float, odd: int | None = None, early: float = 0.0) -> np.ndarray:
    """Wheels of which the rear half is `late` [s]; the `odd` one seems to be `early` [s] beside its neighbours."""
    delay = np.where(np.arange(TRAIN.radius.size) < 16, 0.0, late)
    if odd is not None:
        delay[odd] -= early
    return np.stack([speed(TIME - own) for own in delay], axis=1)


@pytest.mark.parametrize("late", [0.1, 0.3])
def test_the_rear_half_is_late(late):
    (group,) = late_axles(TIME, rims(late), TRAIN, 0.0)
    np.testing.assert_array_equal(group.axles, np.arange(16, 32))
    assert group.late == pytest.approx(late, abs=0.005)


@pytest.mark.parametrize("odd", [DRIVEN[1], DRIVEN[-1]])
def test_a_driven_axle_alone_does_not_tell_its_delay(odd):
    """It creeps; where it stands first or last in its car, the car says which recorder it has."""
    (group,) = late_axles(TIME, rims(0.2, odd, 0.15), TRAIN, 0.0)
    np.testing.assert_array_equal(group.axles, np.arange(16, 32))
    assert group.late == pytest.approx(0.2, abs=0.01)


def test_at_the_border_between_two_recorders_the_car_decides():
    first = int(DRIVEN[DRIVEN >= 16][0])
    border = np.where(np.arange(32) < first, 0.0, 0.2)
    border[first] = -0.1
    rim = np.stack([speed(TIME - own) for own in border], axis=1)
    (group,) = late_axles(TIME, rim, TRAIN, 0.0)
    assert first in group.axles


def test_a_free_axle_alone_may_have_a_recorder_of_its_own():
    free = int(np.flatnonzero(~TRAIN.driven)[0])
    groups = late_axles(TIME, rims(0.0, free, -0.2), TRAIN, 0.0)
    assert [one.axles.tolist() for one in groups] == [[free]]
    assert late_axles(TIME, rims(0.0), TRAIN, 0.0) == []
