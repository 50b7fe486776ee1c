"""The MPC's belief equals a second transcription; its box QP as plain Python, on programs too small for blocks of eight."""

import math

import numpy as np
import pytest

from alloc.plant.operations import WIDTH
from mpc import slip_search
from mpc.belief import GroupBelief, UnitBelief
from mpc.box_qp import ACCEPTED, box_workspace, solve_box_qp
from mpc.settings import MpcSettings, PeakBelief, SlipSearch
from tests.cases import looped
from tests.mpc.made_problems import PROGRAM_KINDS, program, violation
from tests.uncompiled.second_belief import Unit


class OtherBelief(PeakBelief):
    walk, slope_walk, slip_error, coefficient_error, relative_error, gate = (
        0.2,
        0.1,
        0.003,
        0.002,
        0.02,
        2.0,
    )


class OtherSearch(SlipSearch):
    least_swing, memory, gain, fastest_rise, fastest_fall = 0.1, 0.5, 10.0, 1.0, 0.8


SETTINGS = {
    "default": MpcSettings(),
    "others": MpcSettings(
        belief=OtherBelief(initial=0.15, pole=40.0, floor=0.05, ceiling=0.3),
        search=OtherSearch(
            first=0.06, lowest=0.03, highest=0.09, noise_margin=2.0, friction_price=1.0, swing=0.3, swing_time=0.15
        ),
    ),
    "given": MpcSettings(search=SlipSearch(seek=False, given_share=0.8)),
}  # fmt: skip


@looped("kind", ["piecewise", "polach"])
@looped("name", SETTINGS)
def test_belief_is_its_second_transcription(make_context, kind, name):
    context = make_context(kind, axles=3, unit=2)
    belief, other = UnitBelief(context, SETTINGS[name]), Unit(context, SETTINGS[name])
    rng, speed, slip, level = np.random.default_rng(4), 9.0, np.full(3, 0.05), 0.12
    for tick in range(420):
        speed += 0.005
        level = 0.06 if tick > 250 else 0.12
        if tick in (0, 200):
            belief.forget_forces()
            other.fresh = True
        goal = belief.slip_limit if tick % 140 > 30 else 0.002 + 0.0003 * (tick % 140)
        used_up = (
            200 < tick < 275
        )  # the peak believed is what limits, and slip stays far below the one sought
        goal = 0.2 * belief.slip_limit if used_up else goal
        if tick > 300 and tick % 40 < 6:
            goal = 3.0 * belief.slip_limit + 0.05
        slip += 0.3 * (goal * np.array([1.0, 0.9, 0.8]) - slip)
        measured = slip + 0.002 * rng.standard_normal(3)
        mu = (
            float(context.curve.coefficient(slip, level, speed).mean())
            + 0.001 * rng.standard_normal()
        )
        mu = 0.97 * float(belief.peak.min()) if used_up else mu
        torque = mu * context.axle_load * context.radius / context.gear_ratio
        wanted = 0.5 * torque if 60 < tick < 70 else 9000.0 if used_up else 900.0
        estimate = mu + 0.05 if 80 < tick < 120 else mu if tick > 120 else math.nan
        load = context.axle_load * rng.uniform(0.95, 1.05, 3)
        omega = (speed + measured) / context.radius
        belief.axle_load[:] = load
        belief.update(speed, omega, torque, wanted, estimate)
        other.update(speed, omega, torque, wanted, estimate, load)
        state, axles = belief.record.search.state[0], belief.record.axles
        for key in (
            "slip", "swing", "limited_for", "elasticity", "certainty", "noise", "error", "step_share", "away",
            "below",
        ):  # fmt: skip
            expected = pytest.approx(getattr(other, key), rel=1e-5, abs=1e-7)
            assert float(state[key]) == expected, (tick, key)
        curve = belief.record.curve.state[0]
        for key in ("top", "slope", "variance", "heard_for"):
            expected = pytest.approx(getattr(other.curve, key), rel=1e-5, abs=1e-9)
            assert float(curve[key]) == expected, (tick, key)
        assert float(curve.peak_slip) == pytest.approx(other.curve.predicted, rel=1e-5)
        for key in ("coefficient", "slip", "noise", "peak", "variance"):
            attribute = "mu" if key == "coefficient" else key
            expected = [getattr(a, attribute) for a in other.axles]
            np.testing.assert_allclose(getattr(axles, key), expected, rtol=1e-5, atol=1e-9)
        limit = other.slip * (1.0 + other.swing * math.sin(other.phase))
        assert belief.slip_limit == pytest.approx(limit, rel=1e-6)
    common = {"not limited", "first", "heard", "jump", "return", "doubt", "air"}
    common |= {"felt more", "used up", "used up but for noise"}
    common |= {"doubted peak", "doubted to the ceiling"}
    moved = {"moved", "turned", "on trial", "runs away"}
    assert other.seen >= common | (set() if name == "given" else moved)


@looped("share", [0.9985, 0.9995])
def test_a_unit_that_gives_what_is_wanted_is_not_limited(make_context, share):
    belief = UnitBelief(make_context(axles=2), MpcSettings())
    belief.update(8.0, np.full(2, 8.01 / 0.43), 300.0 * share, 300.0)
    assert (belief.record.search.state[0].limited_for > 0.0) == (share < slip_search.LIMITING)


def test_loads_of_a_group_follow_the_forces_of_the_car(make_context):
    units = [
        make_context(axles=2, car=0, unloading=(0.03, 0.01), axle_load=70e3),
        make_context(axles=2, car=0, unloading=(-0.01, -0.03), axle_load=74e3),
        make_context(
            axles=4, car=1, unloading=(0.05, 0.02, -0.02, -9.0), axle_load=80e3, mass=60e3
        ),
    ]
    group = GroupBelief(units, MpcSettings())
    static = np.repeat([70e3, 74e3, 80e3], [2, 2, 4])
    unloading = np.concatenate([u.unloading for u in units])
    omega, torque, load = np.full(8, 8.02 / 0.43), np.array([200.0, 300.0, 400.0]), static.copy()
    for _ in range(3):
        group.update(np.full(3, 8.0), omega, torque, np.full(3, 900.0), np.full(3, math.nan))
        felt = np.repeat(torque * 7.07 / 0.43, [2, 2, 4]) / load
        np.testing.assert_allclose(
            np.concatenate([o.coefficient for o in group.observers]), felt, rtol=1e-9
        )
        force = np.repeat([(felt * load)[:4].sum(), (felt * load)[4:].sum()], 4)
        load = np.maximum(static - unloading * force, 0.5 * static)
        np.testing.assert_allclose(group.load, load, rtol=1e-9)
    np.testing.assert_array_equal(group.peak, np.concatenate([o.peak for o in group.observers]))
    limits = [np.full(o.peak.size, o.slip_limit) for o in group.observers]
    np.testing.assert_array_equal(group.slip_limit, np.concatenate(limits))
    group.peak[:] = np.linspace(0.1, 0.17, 8)
    share = group.peak * load / static
    rim = [155.0 * u.axles / (0.43**2 * u.mass) for u in units]
    carried = [u.axle_load * 0.43 / 7.07 * (1.0 + r) for u, r in zip(units, rim, strict=True)]
    weakest = [share[:2].min(), share[2:4].min(), share[4:].min()]
    np.testing.assert_allclose(group.carried_torque(), np.multiply(weakest, carried), rtol=1e-12)


@looped("kind", PROGRAM_KINDS)
def test_no_slope_is_left_that_could_be_followed(kind):
    for seed in range(40):
        hessian, gradient, lower, upper = program(seed, kind, most=WIDTH)
        for start in (lower, upper, np.zeros_like(lower)):
            x = start.copy()
            steps = solve_box_qp(hessian, gradient, lower, upper, x, box_workspace(x.size))
            assert 0 <= steps <= 3 * x.size + 2
            assert violation(hessian, gradient, lower, upper, x) <= ACCEPTED
