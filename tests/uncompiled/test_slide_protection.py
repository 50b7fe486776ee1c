"""The cars' slide protection, decision by decision: worst axle of a bogie, reliefs, safeguards."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.onboard.brakes import Fuzzy, SlideProtection, protect
from alloc.onboard.equipment import equipment
from alloc.onboard.parameters import Braking, Onboard
from alloc.onboard.state import RuleSettings, memory, settings
from alloc.plant.model import build
from alloc.plant.rail import Rail
from studies.jp4209318 import train as slide_train

SPEED, CYCLE = 20.0, 0.02
SUPPLY, HOLD, RELEASE = 0, 1, 2
FUZZY = SlideProtection(
    law="fuzzy", period=CYCLE, time_out=1.0, refill=0.1,
    fuzzy=Fuzzy(slip=(0.0, 0.05, 0.15), rate=(-1.0, 0.0, 1.0)),
)  # fmt: skip
MODEL = build(slide_train(2), Rail(0.1))


class Cars:
    """Two braked cars whose axles turn as the test says."""

    def __init__(self, protection: SlideProtection, period: float = CYCLE) -> None:
        onboard = Onboard(period=period, braking=Braking(slide_protection=protection))
        self.eq = equipment(MODEL, onboard)
        self.settings = settings(onboard, RuleSettings(0), "none")
        self.memory = memory(self.eq, SPEED, 0.1)
        self.valve = np.full((4, 1), np.nan)
        self.tick = 0

    def decide(self, slip=(), speed=SPEED, braking=True) -> list[int]:
        """Valves after one control period; `slip`: slip ratio by axle, the others roll at `speed` [m/s]."""
        rim = np.full(8, speed)
        for axle, ratio in dict(slip).items():
            rim[axle] = speed * (1.0 - ratio)
        self.memory.axle_omega[:] = rim / self.eq.axle_radius
        self.memory.reference[:] = speed
        protect(self.eq, self.settings, self.memory, self.tick, braking, self.valve)
        self.tick += 1
        return self.valve[:, 0].astype(int).tolist()

    def settle(self, slip=(), speed=SPEED) -> list[int]:
        """Valves once the filters have settled on a constant slip."""
        for _ in range(40):
            valves = self.decide(slip, speed)
        return valves


@pytest.mark.parametrize("law", ["none", "threshold", "fuzzy"])
def test_rolling_wheels_are_left_alone(law):
    assert Cars(replace(FUZZY, law=law)).settle() == [SUPPLY] * 4


@pytest.mark.parametrize(("ratio", "action"), [(0.01, SUPPLY), (0.05, HOLD), (0.2, RELEASE)])
@pytest.mark.parametrize("axle", range(8))
def test_the_worst_axle_decides_for_its_bogie_alone(axle, ratio, action):
    valves = Cars(FUZZY).settle({axle: ratio})
    expected = [SUPPLY] * 4
    expected[axle // 2] = action
    assert valves == expected


def test_a_slide_that_grows_is_released_before_one_that_stays():
    growing = Cars(FUZZY)
    valves = [growing.decide({0: ratio})[0] for ratio in np.arange(0.0, 0.05, 0.004)]
    assert RELEASE in valves
    assert Cars(FUZZY).settle({0: 0.048})[0] == HOLD


@pytest.mark.parametrize(("ratio", "action"), [(0.07, SUPPLY), (0.1, HOLD), (0.16, RELEASE)])
def test_the_threshold_switches_at_its_points(ratio, action):
    assert Cars(replace(FUZZY, law="threshold")).settle({2: ratio})[1] == action


def test_a_slide_is_measured_from_the_trains_speed_though_every_axle_slides():
    assert Cars(FUZZY).settle(dict.fromkeys(range(8), 0.2)) == [RELEASE] * 4
    assert Cars(FUZZY).settle(dict.fromkeys(range(4), 0.2)) == [RELEASE, RELEASE, SUPPLY, SUPPLY]


@pytest.mark.parametrize("bogie", range(4))
@pytest.mark.parametrize("law", ["none", "threshold", "fuzzy"])
def test_the_bogie_that_the_reference_speed_asks_for_is_released_alone(law, bogie):
    cars = Cars(replace(FUZZY, law=law))
    cars.memory.estimate.relief.group[0] = bogie
    expected = [SUPPLY] * 4
    if law != "none":  # without slide protection nobody may release brakes
        expected[bogie] = RELEASE
    assert cars.decide() == expected
    cars.memory.estimate.relief.group[0] = -1
    assert cars.decide() == [SUPPLY] * 4


def test_a_sounded_bogie_brakes_again_below_the_cut_out_speed():
    cars = Cars(FUZZY)
    cars.memory.estimate.relief.group[0] = 1
    assert cars.decide(speed=1.3) == [SUPPLY] * 4


def test_valves_rest_below_the_cut_out_speed():
    assert Cars(FUZZY).decide({0: 0.5}, speed=1.4)[0] == RELEASE
    assert Cars(FUZZY).decide({0: 0.5}, speed=1.3) == [SUPPLY] * 4


def test_a_valve_that_never_supplies_is_made_to():
    cars = Cars(FUZZY)
    actions = np.array([cars.decide({0: 0.3})[0] for _ in range(200)])
    supplied = np.flatnonzero(actions == SUPPLY)
    assert supplied[0] * CYCLE == pytest.approx(1.0, abs=1.5 * CYCLE)
    assert (actions[supplied[0] : supplied[0] + 5] == SUPPLY).all()  # for the 0.1 s of its refill
    assert actions[supplied[0] + 5] == RELEASE
    # again and again, and the bogies that roll are not concerned
    assert cars.memory.counter.time_outs[0] == 3


@pytest.mark.parametrize(("law", "action"), [("none", SUPPLY), ("fuzzy", RELEASE)])
def test_a_standing_axle_is_counted_once_and_released(law, action):
    cars = Cars(replace(FUZZY, law=law))
    for _ in range(5):
        valves = cars.decide({5: 1.0})
    assert valves[2] == action
    assert cars.memory.counter.locks[0] == 1
    cars.decide()
    cars.decide({5: 1.0})
    assert cars.memory.counter.locks[0] == 2


def test_between_two_decisions_valves_stay():
    cars = Cars(FUZZY, period=0.005)
    assert cars.decide({0: 0.3})[0] == RELEASE
    assert [cars.decide()[0] for _ in range(4)] == [RELEASE, RELEASE, RELEASE, SUPPLY]


def test_released_brakes_forget():
    cars = Cars(FUZZY)
    for _ in range(20):
        cars.decide({0: 0.3})
    assert cars.memory.slide.away[0] > 0.0
    assert cars.decide({0: 0.3}, braking=False) == [SUPPLY] * 4
    assert cars.memory.slide.away[0] == 0.0
