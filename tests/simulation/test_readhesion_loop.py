"""The built-in readhesion controllers on the plant: what each holds, where each search goes, and braking as driving."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.metrics.search import utilisation_short
from alloc.onboard.controllers.collection import BUILT_IN
from alloc.onboard.controllers.creep import CreepControl
from alloc.onboard.parameters import Braking, Onboard, ReferenceSpeed, TorqueRelief
from alloc.plant.adhesion import POLACH_WET
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.train import Motors, TorqueLimit
from alloc.simulation import DriverCommand, Event, simulate

PUBLISHED = ("fuzzy-creep", "fuzzy-tracking", "swarm-tracking", "swarm-slip", "cubature-seeking")


def worst_slip(run):
    """Largest slip of each unit's axles, (time, unit)."""
    unit = run["axle_unit"].values
    slip = run["slip_velocity"].values
    return np.stack([slip[:, unit == j].max(axis=1) for j in range(run.sizes["unit"])], axis=1)


@pytest.mark.parametrize("reference", [0.08, 0.15])
def test_pi_creep_holds_its_reference_where_the_rail_is_short(make_event, reference):
    onboard = Onboard(creep=CreepControl(reference=reference))
    run = simulate(make_event(0.08, onboard=onboard), "alone", "pi-creep")
    late = worst_slip(run.sel(time=slice(3.0, None)))
    # the reference speed is that of a trailer's wheels, which slip next to nothing
    np.testing.assert_allclose(late, reference, rtol=0.05)


@pytest.mark.parametrize(
    ("controller", "reference", "left"),
    [
        ("perturb-observe", 0.05, 0.5),
        ("perturb-observe", 0.45, 0.5),
        ("steepest-gradient", 0.05, 0.7),
        # beyond its peak Polach's curve falls so slowly that the slope hardly says where to go: arXiv 2406.13650
        ("steepest-gradient", 0.45, 0.95),
    ],
)
def test_a_search_leads_to_a_wide_peak_from_both_sides(train, controller, reference, left):
    """`left`: share of the distance between the first reference and the peak that may be left at the end."""
    onboard = Onboard(creep=CreepControl(reference=reference))
    model = build(train, Rail(0.06, curve=POLACH_WET))
    event = Event("wide", model, DriverCommand((0.2,), (0.75,)), onboard, duration=14.0)
    run = simulate(event, "alone", controller)
    end = run.sel(time=slice(12.0, None))  # the peak moves up with speed; at the end it does slowly
    peak = end["peak_slip"].values[:, end["axle_unit"].values >= 0].mean()
    assert 0.15 < peak < 0.35
    assert abs(worst_slip(end).mean() - peak) < left * abs(reference - peak)


@pytest.mark.parametrize("controller", PUBLISHED)
def test_published_controllers_use_a_short_rail(make_event, controller):
    late = simulate(make_event(0.08), "alone", controller).sel(time=slice(3.0, None))
    assert utilisation_short(late) > 0.94
    assert worst_slip(late).max() < 0.6


@pytest.mark.parametrize("controller", ["fuzzy-tracking", "swarm-tracking", "cubature-seeking"])
def test_published_searches_leave_a_bad_first_reference(train, controller):
    """Polach's wide peak lies far above the first reference; creep control that does not search stays there."""
    onboard = Onboard(creep=CreepControl(reference=0.05))
    model = build(train, Rail(0.06, curve=POLACH_WET))
    event = Event("wide", model, DriverCommand((0.2,), (0.75,)), onboard, duration=10.0)
    found, held = (
        utilisation_short(simulate(event, "alone", name).sel(time=slice(6.0, None)))
        for name in (controller, "pi-creep")
    )
    assert found > held + 0.5 * (1.0 - held)


@pytest.mark.parametrize("controller", BUILT_IN)
def test_braking_is_driving_mirrored(train, controller):
    # a rigid train without resistance and air brakes, on rail whose adhesion knows neither speed nor place
    strong = TorqueLimit(2000.0, 2e6)  # whose bound falls with the wheels' speed must not act
    motors = Motors("1C4M", 7.07, strong, strong)
    cars = tuple(replace(car, motors=motors) if car.motors else car for car in train.cars)
    bare = replace(train, cars=cars, resistance=(0.0, 0.0, 0.0), load_transfer=False)
    model = build(bare, Rail(0.09))
    # nor do the reference speed's doubts grow with the speed
    reference = ReferenceSpeed(creep_speed=1e3, relief=TorqueRelief(doubt_ratio=1e-9))
    onboard = Onboard(braking=Braking(blended=False), reference=reference)
    runs = [
        simulate(
            Event(
                "mirror", model, DriverCommand((0.2,), (sign * 0.75,)), onboard,
                duration=5.0, initial_speed=11.0,
            ),
            "alone",
            controller,
        )
        for sign in (1.0, -1.0)
    ]  # fmt: skip
    ahead, back = runs
    assert np.abs(ahead["slip_velocity"].values).max() > 0.02
    for name in ("torque_command", "slip_velocity", "acceleration"):
        scale = np.abs(ahead[name].values).max()
        np.testing.assert_allclose(
            back[name], -ahead[name], atol=1e-6 * scale, rtol=0, err_msg=name
        )
    np.testing.assert_allclose(ahead["speed"] - 11.0, 11.0 - back["speed"], atol=1e-7)


def test_the_table_takes_torque_from_wheels_that_run_away(make_event):
    run, free = (
        simulate(make_event(0.10, duration=6.0), "alone", name) for name in ("table", "none")
    )
    assert run["torque_factor"].values.min() < 0.8
    assert worst_slip(run).max() < 0.5 * worst_slip(free).max()
