"""Excess damage: against the least that a solver finds, with every curve; zero at the optimum, nan without one."""

import json
from dataclasses import fields

import numpy as np
import pytest
import xarray as xr
from scipy.optimize import brentq, minimize_scalar

from alloc.metrics import evaluate
from alloc.metrics.least_damage import excess_damage
from alloc.plant.adhesion import (
    ExponentialDifference,
    PiecewiseCurve,
    PolachByFrictionCurve,
    PolachCurve,
    RationalCurve,
    ShapedCurve,
    SlipRatioCurve,
)
from alloc.simulation import simulate
from studies import headroom
from tests.cases import looped

CURVES = (
    PiecewiseCurve(), PolachCurve(), PolachByFrictionCurve(), SlipRatioCurve(), RationalCurve(steepness=9.0),
    ExponentialDifference(),
)  # fmt: skip
UNIT, CAR = np.array([1, -1, 0, 0, 1]), np.array([1, 1, 0, 0, 1])
PEAK = np.array([0.10, 0.2, 0.07, 0.09, 0.12])
LOAD = np.array([1.1e5, 1e5, 0.9e5, 1.2e5, 1e5])
CAR_SPEED = np.array([11.0, 10.0])
GEAR, RADIUS, TURNING = 5.0, 0.45, 300.0


class Rail:
    """Five axles in two cars, 0 and 4 of unit 1, 2 and 3 of unit 0, on a curve; forces of units are per axle [N]."""

    def __init__(self, curve, way=1.0):
        self.curve, self.way = curve, way
        self.speed, self.contact = CAR_SPEED[CAR], curve.contact(0.5 * LOAD, np.full(5, RADIUS))
        self.limit, self.top = (
            np.broadcast_to(one, 5) for one in curve.limit(PEAK, self.speed, self.contact)
        )
        self.best = np.array([self.coefficient(a, self.top[a]) for a in range(5)])
        self.cap = np.array([min((self.best * LOAD)[j == UNIT]) for j in range(2)])

    def coefficient(self, a, slip):
        """In the way of the demand."""
        signed = self.way * slip
        return self.way * float(
            self.curve.coefficient(signed, PEAK[a], self.speed[a], self.contact[a])
        )

    def slip(self, a, force):
        """Slip below the peak at which axle `a` carries `force` [N]."""
        wanted = min(force / LOAD[a], self.best[a])
        if wanted >= self.best[a] * (1.0 - 1e-12):
            return self.top[a]
        return brentq(
            lambda s: self.coefficient(a, s) - wanted, 0.0, self.top[a], xtol=1e-13, rtol=1e-13
        )

    def power(self, force):
        """Power [W] if the axles of both units carry `force` (2,) each."""
        return sum(force[j] * self.slip(a, force[j]) for a, j in enumerate(UNIT) if j >= 0)

    def least(self, force, most):
        """The least power for the sum of `force`, by a search over what an axle of unit 0 carries; and the force there."""
        total, high = sum(force), np.minimum(self.cap, most)
        bounds = max(total - high[1], 0.0), min(high[0], total)
        found = minimize_scalar(
            lambda x: self.power((x, total - x)), bounds=bounds, options={"xatol": 1e-3}, method="bounded"
        )  # fmt: skip
        return found.fun, (found.x, total - found.x)

    def run(self, forces, most=(1e9, 1e9), beyond=0.0, **attributes):
        """A recorded run, an instant for each of `forces`; `beyond`: slip added to that of the curve [m/s]."""
        n = len(forces)
        slips = np.array(
            [[0.0 if j < 0 else self.slip(a, f[j]) + beyond for a, j in enumerate(UNIT)] for f in forces]
        )  # fmt: skip
        carried = np.array([[0.0 if j < 0 else f[j] for j in UNIT] for f in forces])
        ones, demand = np.ones((n, 1)), np.full(n, 0.5 * self.way)
        torque = np.array(most) * RADIUS / GEAR
        name, values = type(self.curve).__name__, {
            one.name: getattr(self.curve, one.name) for one in fields(self.curve)
        }  # fmt: skip
        variables = {
            "driver_command": ("time", demand), "acceleration": ("time", 0.0 * demand),
            "rail_force": (("time", "axle"), self.way * carried), "slip_velocity": (("time", "axle"), self.way * slips),
            "adhesion_limit": (("time", "axle"), ones * self.limit), "peak_slip": (("time", "axle"), ones * self.top),
            "axle_load": (("time", "axle"), ones * LOAD), "car_speed": (("time", "car"), ones * CAR_SPEED),
            "drive_limit": (("time", "unit"), ones * torque), "brake_limit": (("time", "unit"), ones * torque),
            "axle_unit": ("axle", UNIT), "axle_car": ("axle", CAR), "axle_static_load": ("axle", LOAD),
            "axle_radius": ("axle", np.full(5, RADIUS)), "axle_turning_mass": ("axle", np.full(5, TURNING)),
            "unit_gear": ("unit", [GEAR] * 2), "unit_radius": ("unit", [RADIUS] * 2), "unit_parallel": ("unit", [0, 0]),
        }  # fmt: skip
        told = {
            "adhesion_curve": json.dumps({"class": name, "values": values}),
            "blended_brakes": 0,
        }
        return xr.Dataset(variables, {"time": 0.1 * np.arange(n)}, told | attributes)


@looped(("curve", "way"), [(curve, way) for curve in CURVES for way in (1.0, -1.0)])
def test_the_least_is_that_of_a_search_of_its_own(curve, way):
    rail, generator = Rail(curve, way), np.random.default_rng(1)
    forces = rail.cap * generator.uniform(0.5, 0.999, (12, 2))
    least = sum(rail.least(force, np.inf)[0] for force in forces)
    power = sum(map(rail.power, forces))
    assert excess_damage(rail.run(forces)) + 1.0 == pytest.approx(power / least, rel=3e-3)


@looped("curve", CURVES)
def test_excess_is_never_negative_in_balance_and_zero_at_the_optimum(curve):
    rail, generator = Rail(curve), np.random.default_rng(2)
    for share in (0.3, 0.9, 0.99, 0.999):
        force = share * rail.cap * generator.uniform(0.8, 1.0, 2)
        assert excess_damage(rail.run([force])) > -1e-4
        best = rail.least(force, np.inf)[1]
        assert excess_damage(rail.run([best])) == pytest.approx(0.0, abs=1e-3)
    assert excess_damage(rail.run([rail.cap])) == pytest.approx(0.0, abs=1e-6)


def test_motors_bound_the_split_and_slip_beyond_the_curve_counts_in_full():
    rail = Rail(PiecewiseCurve())
    force, most = 0.8 * rail.cap, np.array([0.81, 0.81]) * rail.cap
    bounded = rail.power(force) / rail.least(force, most)[0] - 1.0
    free = rail.power(force) / rail.least(force, np.inf)[0] - 1.0
    assert bounded < 0.8 * free
    assert excess_damage(rail.run([force], most)) == pytest.approx(bounded, abs=3e-4)
    # a unit has two axles; its wheels' slip counts with the force of each
    power, least = rail.power(force) + 0.1 * 2.0 * force.sum(), rail.least(force, np.inf)[0]
    found = excess_damage(rail.run([force], beyond=0.1))
    assert found == pytest.approx(power / least - 1.0, rel=1e-4)


def test_failed_motors_leave_their_wheels_drag_to_the_others():
    rail = Rail(PiecewiseCurve())
    run = rail.run([(0.0, 0.9 * rail.cap[1])], (0.0, 1e9))
    run["acceleration"] = run["acceleration"] + 0.5
    drag = -0.5 * TURNING  # of an axle, which acceleration turns
    run["rail_force"].values[0, 2:4] = drag
    own = 0.9 * rail.cap[1]
    slip = [rail.slip(a, own) for a in (0, 4)]
    dragged = abs(drag) * run["slip_velocity"].values[0, 2:4].sum()
    expected = (own * sum(slip) + dragged) / (own * sum(slip)) - 1.0
    assert excess_damage(run) == pytest.approx(expected, abs=1e-5)


def test_axles_whose_motors_share_an_inverter_find_their_own_force():
    rail = Rail(PiecewiseCurve())
    run = rail.run([0.95 * rail.cap])
    together = excess_damage(run)
    run["unit_parallel"] = ("unit", [1, 1])
    assert excess_damage(run) > together + 0.02


class Unknown(ShapedCurve):
    """A curve that nobody registered."""

    def shape(self, slip):
        return slip / (0.01 + slip * slip)


def test_it_is_nan_where_it_does_not_apply():
    rail = Rail(PiecewiseCurve())
    run = rail.run([rail.cap])
    coasting = run.assign(driver_command=0.0 * run["driver_command"])
    unpowered = run.isel(unit=slice(0)).assign(axle_unit=("axle", [-1] * 5))
    still = run.assign(slip_velocity=0.0 * run["slip_velocity"], rail_force=0.0 * run["rail_force"])
    cases = coasting, unpowered, still, Rail(Unknown()).run([(1e3, 1e3)]), run.drop_attrs()
    assert np.isnan([excess_damage(one) for one in cases]).all()


def test_what_runs_slip_beyond_the_peak_is_excess_and_the_oracle_has_next_to_none():
    event = headroom.event(7, 3).changed(duration_s=6.0).event()
    alone, oracle = (
        evaluate(simulate(event, rule, "cut-and-ramp"))["excess_damage"]
        for rule in ("alone", "oracle")
    )
    assert alone > 0.05
    assert 0.0 <= oracle < 0.05
