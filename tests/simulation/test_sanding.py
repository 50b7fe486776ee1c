"""When a train sands, how much, and brake force that cars are asked for in unequal shares."""

import numpy as np
import pytest

from alloc.errors import OnboardError
from alloc.event import DriverCommand, Event
from alloc.onboard.brakes import Sanding
from alloc.onboard.parameters import Braking, Onboard, ReferenceSpeed
from alloc.plant.model import build
from alloc.plant.rail import Patch, Rail
from alloc.plant.train import Sander
from alloc.simulation import simulate
from studies.stops.sander_trial import (
    FIXED_RATE,
    GREATEST_RATE,
    VARIABLE_AMOUNT,
    coupled_units,
    sanded,
)

RECORD = 0.01
SLIPPERY = Patch(0.2, begin=2.0, until=5.0, fade=0.1)
"""Three seconds on which wheels slide; before and after all is carried."""


def run(sanding=None, *, sanders=None, speed=20.0, patches=(SLIPPERY,), duration=12.0, shares=None):
    """One unit brakes from `speed` [m/s] on dry rail with slippery spells."""
    train = coupled_units(1)
    train = train if sanders is None else sanded(train, sanders)
    onboard = Onboard(
        sanding=sanding or Sanding(),
        braking=Braking(car_shares=shares),
        reference=ReferenceSpeed(source="truth"),
    )
    model = build(train, Rail(0.15, patches=tuple(patches)), span=(0.0, 1000.0))
    event = Event(
        "sanding", model, DriverCommand((0.5,), (-0.9,)), onboard,
        duration=duration, initial_speed=speed, record_period=RECORD,
    )  # fmt: skip
    return simulate(event, "alone", "none")


def spells(run):
    """Begin and end [s] of every span in which sand is laid."""
    on = np.concatenate([[False], run["sand_rate"].values[:, 0] > 0.0, [False]])
    edges = np.flatnonzero(np.diff(on.astype(int)))
    return (RECORD * edges).reshape(-1, 2)


def slides(run):
    """Instants [s] at which a valve does not supply."""
    return run["time"].values[(run["valve"].values > 0).any(axis=1)]


@pytest.mark.parametrize(("delay", "hold"), [(1.0, 2.0), (0.3, 4.0)])
def test_sand_begins_a_delay_after_the_first_slide_and_holds_on(delay, hold):
    found = run(Sanding(delay=delay, hold=hold))
    seen = slides(found)
    (begin, end), = spells(found)  # fmt: skip
    assert begin == pytest.approx(seen[0] + delay, abs=0.021)
    assert end == pytest.approx(seen[-1] + hold, abs=0.021)
    assert found["speed"].values[-1] > Sanding().least_speed


def test_a_fixed_rate_is_that_of_the_sander():
    rates = np.unique(run()["sand_rate"].values)
    assert rates.tolist() == [0.0, FIXED_RATE]


def test_no_slide_no_sand():
    found = run(patches=())
    assert slides(found).size == 0
    assert spells(found).size == 0


def test_sand_by_command():
    found = run(Sanding(on_slide=False, delay=0.5, begin=1.0, until=4.0))
    assert slides(found).size > 0
    np.testing.assert_allclose(spells(found), [[1.5, 4.5]], atol=1e-9)


def test_slow_trains_lay_none():
    found = run(Sanding(on_slide=False, delay=0.0, begin=0.0, least_speed=15.0))
    speed = found["speed"].values
    (_, end), = spells(found)  # fmt: skip
    assert speed[round(end / RECORD)] == pytest.approx(15.0, abs=0.02)


def test_a_variable_rate_keeps_to_the_amount_as_far_as_it_goes():
    found = run(
        Sanding(on_slide=False, delay=0.0, begin=0.0, least_speed=0.0),
        sanders={2: Sander(0, GREATEST_RATE, VARIABLE_AMOUNT)},
        speed=28.0,
    )  # fmt: skip
    amount = found["sand_rate"].values[:, 0] / found["speed"].values
    most = GREATEST_RATE / found["speed"].values
    np.testing.assert_allclose(amount, np.minimum(VARIABLE_AMOUNT, most), rtol=1e-3)
    assert most[0] < 0.9 * VARIABLE_AMOUNT < most[-1]


def test_a_train_without_sanders_has_none_in_its_record():
    assert "sand_rate" not in run(sanders={})
    found = run(duration=1.0)
    assert found["sand_rate"].dims == ("time", "sander")
    assert found["sand_rate"].attrs["units"] == "kg s-1"


def test_cars_brake_by_their_shares():
    shares = (0.5, 0.9, 1.2, 1.0)
    equal, shared = (run(patches=(), duration=4.0, shares=one) for one in (None, shares))
    ratio = shared["cylinder_pressure"].values[-1] / equal["cylinder_pressure"].values[-1]
    np.testing.assert_allclose(ratio, np.repeat(shares, 2), rtol=1e-3)


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: Sanding(delay=-1.0), "delay"),
        (lambda: Sanding(hold=float("nan")), "hold"),
        (lambda: Sanding(begin=3.0, until=2.0), "begin = 3.0 must not exceed until"),
        (lambda: Braking(car_shares=(1.0, -0.1)), r"car_shares\[1\]"),
        (lambda: run(shares=(1.0, 1.0)), "2 car_shares for 4 cars"),
    ],
)
def test_impossible_parameter_is_named(make, named):
    with pytest.raises(OnboardError, match=named):
        make()


def test_slip_in_traction_calls_for_sand_too(make_event, train):
    one = sanded(train, {4: Sander(0, 0.03)})
    event = make_event(0.06, train=one, onboard=Onboard(sanding=Sanding(least_speed=0.0)))
    found = simulate(event, "alone", "cut-and-ramp")
    first = found["time"].values[(found["slipping"].values > 0).any(axis=1)][0]
    begin, _ = spells(found)[0]
    assert begin == pytest.approx(first + Sanding().delay, abs=0.021)
    assert found["rail_force"].values[-1].sum() > 0.0
