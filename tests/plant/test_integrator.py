"""The integrator: order four where the laws are smooth, and results that do not hang on the step."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.plant.adhesion import POLACH_WET, PiecewiseCurve, SlipRatioCurve
from alloc.plant.model import build
from alloc.plant.rail import Patch, Rail, Receptivity
from alloc.plant.train import Coupler

ROLLING_RESISTANCE = (2e3, 50.0, 6.0)


def _orders(end_state, steps, reference) -> np.ndarray:
    """Observed orders between successive steps; `end_state(step)` is compared with that of `reference`."""
    exact = end_state(reference)
    error = np.array([np.abs(end_state(step) - exact).max() for step in steps])
    return np.log(error[:-1] / error[1:]) / np.log(np.array(steps[:-1]) / steps[1:])


def _slipping_end_state(run, model, duration, **inputs):
    """Rim speeds at the end, wheels slipping from the start (laws are smooth on either side of no slip)."""
    n, s = model.layout, model.structure

    def end(step):
        state = model.initial_state(20.0)
        state[n.omega] *= 1.05
        trace = run(model, duration, state=state, step=step, sample=duration, **inputs)
        return s.radius * trace.rows("omega")[-1]

    return end


@pytest.mark.parametrize(
    ("formation", "couplers"), [("M", None), ("MMM", (Coupler(damping=0.0),) * 2)],
    ids=["rigid", "coupled"],
)  # fmt: skip
def test_fourth_order_on_a_smooth_case(run, train, formation, couplers):
    made = train(formation, resistance=ROLLING_RESISTANCE, load_transfer=True, couplers=couplers)
    model = build(made, Rail(0.2, curve=POLACH_WET))
    end = _slipping_end_state(run, model, 0.48, command=1300.0)
    orders = _orders(end, [2e-3, 1e-3, 5e-4], 6.25e-5)
    assert np.all(np.abs(orders - 4.0) < 0.3), orders


def test_fourth_order_with_smooth_edges_of_the_environment(run, train):
    """A patch entered in space and in time, a speed law, and a receptivity that fluctuates."""
    rail = Rail(
        1.5, "shinkansen", curve=POLACH_WET,
        patches=(Patch(0.6, start=-3.0, edge=6.0), Patch(1.3, begin=0.2, until=9.0, fade=0.3)),
    )  # fmt: skip
    model = build(train("M"), rail, receptivity=Receptivity(0.7, 0.2, 1.0))
    n, s = model.layout, model.structure

    def end(step):
        state = model.initial_state(20.0)
        state[n.omega] *= 0.95
        trace = run(model, 0.48, state=state, step=step, sample=0.48, command=-9e3)
        return s.radius * trace.rows("omega")[-1]

    orders = _orders(end, [2e-3, 1e-3, 5e-4], 6.25e-5)
    assert np.all(np.abs(orders - 4.0) < 0.4), orders


CURVES = [PiecewiseCurve(), POLACH_WET, SlipRatioCurve(0.03, 0.7)]


@pytest.mark.parametrize("curve", CURVES, ids=["piecewise", "polach", "slip-ratio"])
def test_halving_the_step_keeps_the_metrics_of_a_slip_event(run, train, curve):
    """Peak slip, damage and speed reached change by less than 0.1 %."""
    level = 0.3 if curve is POLACH_WET else 0.18
    rail = Rail(level, patches=(Patch(0.5, begin=1.0, until=2.0, fade=0.05),), curve=curve)
    model = build(train("TMT", resistance=ROLLING_RESISTANCE), rail)

    def metrics(step):
        def command(t):
            return 1900.0 if t < 1.6 else 300.0

        trace = run(model, 3.0, 10.0, command=command, step=step, sample=4e-3)
        speed = trace.rows("speed")[:, 0]
        slip = 0.43 * trace.rows("omega") - speed[:, None]
        return np.array([slip.max(), trace.rows("friction_work")[-1].sum(), speed[-1]])

    coarse, fine = metrics(1e-3), metrics(5e-4)
    assert coarse[0] > 0.3  # the wheels did slip
    np.testing.assert_allclose(coarse, fine, rtol=1e-3)


def test_results_do_not_depend_on_how_often_the_caller_asks(run, train):
    model = build(train("TMT"), Rail(0.12, scatter=0.01, conditioning=0.3))
    often = run(model, 0.5, 15.0, command=1500.0, sample=1e-3)
    seldom = run(model, 0.5, 15.0, command=1500.0, sample=0.1)
    np.testing.assert_allclose(often.state[-1], seldom.state[-1], rtol=1e-12, atol=1e-12)


def test_locking_wheels_do_not_chatter(run, train):
    """Stiff shoe friction at standstill of a wheel: twice the step gives the same end."""
    model = build(train("TT"), Rail(0.03))
    ends = [
        run(model, 4.0, 8.0, pressure=400e3, step=step, sample=1.0).state[-1]
        for step in (1e-3, 5e-4)
    ]
    np.testing.assert_allclose(ends[0][model.layout.speed], ends[1][model.layout.speed], rtol=1e-4)
    assert np.abs(ends[0][model.layout.omega]).max() < 1e-9


def test_model_is_not_changed_by_a_run(run, train):
    rail = Rail(0.12, scatter=0.01)
    model = build(train("M"), rail)
    before = replace(model).environment.noise.copy()
    run(model, 0.1, 10.0, command=1000.0)
    np.testing.assert_array_equal(model.environment.noise, before)
