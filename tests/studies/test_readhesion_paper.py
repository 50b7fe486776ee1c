"""The readhesion paper: its printed numbers, its indices on signals made by hand, its equations by SciPy, a small grid."""

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import sawtooth

from alloc.laws import window
from studies import readhesion_paper as paper
from studies.readhesion_paper import IN_USE, MEMBER_STEP, PLAN, AxleRun, Case

TIME = np.arange(0.0, 16.0, paper.RECORD)


def made(slip, torque, mu=0.1):
    """A run whose slip is macro slip from 1 m/s on."""
    one = np.ones_like(TIME)
    return AxleRun(TIME, slip * one, one, mu * one, torque * one, torque * one, one)


def test_printed_numbers():
    coefficient = paper.MASS * paper.ACCELERATION / (paper.LOAD * np.array([paper.GRAVITY, 9.0855]))
    assert coefficient == pytest.approx([0.17, 0.183], abs=5e-4)  # the g of Table 1 is a misprint
    np.testing.assert_allclose(PLAN * paper.TO_COEFFICIENT, coefficient[0])
    curve = IN_USE["m/s2"].curve
    assert curve.micro_slope**2 / (4.0 * curve.top_curvature) == paper.VERY_SLIPPERY


@pytest.mark.parametrize("unit", IN_USE)
def test_the_start_passes_the_filter_too(unit):
    """2.3: the filter of T_u is behind the product of the driver's torque and the factor."""
    given, time = IN_USE[unit], np.array([1.0, 4.0])
    command = paper.run_axle(given, paper.CASE_A, step=MEMBER_STEP).command
    expected = PLAN * -np.expm1(-time / given.rise)
    np.testing.assert_allclose(command[(time / paper.RECORD).astype(int)], expected, rtol=1e-3)


def test_readhesion_is_possible_where_the_cycle_at_14_s_crosses_the_peak():
    swing = 1.0 + 0.5 * sawtooth(2.0 * np.pi * TIME / 0.65)
    assert paper.is_possible(made(swing, PLAN * swing))
    assert not paper.is_possible(made(swing + 1.0, PLAN * swing))  # macro slip throughout
    assert not paper.is_possible(made(TIME / 6.0, PLAN))  # no cycle
    assert paper.is_possible(made(0.5, PLAN))  # nothing slips


def test_means_and_limit_cycle_of_a_known_swing():
    growing = np.where(TIME < 7.8, 0.5, 1.0) * sawtooth(2.0 * np.pi * TIME / 0.65)
    run = made(2.0 + growing, PLAN * (1.0 + 0.1 * growing))
    found = paper.find_indices(run, 0.125)
    assert (found["used"], found["utilisation"]) == pytest.approx((0.1, 0.8))
    period, slips = paper.limit_cycle(run)
    assert period == pytest.approx(0.65, rel=0.01)
    assert (
        slips == 3
    )  # one before the first cycle, then those of half the size from 6.5 and 7.15 s on


def test_a_run_solves_the_printed_equations():
    given, g1, c, g2 = IN_USE["m/s2"], 5.0, 40.0, 0.05
    case, time = Case(limit=0.16), TIME[:9000:10]  # there the printed curve is one

    def coefficient(slip, peak):
        v1, top = peak / g1 - g1 / (4.0 * c), peak / g1 + g1 / (4.0 * c)
        v2, residual = top + g2 / (2.0 * c), given.residual_ratio * peak
        b = peak - c * (g2 / (2.0 * c)) ** 2 - residual
        tail = residual + b * np.exp((v2 - slip) * g2 / b)
        return g1 * slip if slip <= v1 else tail if slip >= v2 else peak - c * (slip - top) ** 2

    def rates(t, state):
        v, omega, torque, command, filtered = state
        rim, peak = paper.RADIUS * omega, 0.18 - 0.02 * window(t, paper.DROP, 99.0, paper.FADE)
        force = paper.LOAD * paper.GRAVITY * coefficient(rim - v, peak)
        pace = (rim - filtered) / given.time_constant
        factor = np.clip(1.0 - (pace - paper.ACCELERATION - case.margin) / case.width, 0.0, 1.0)
        missing = factor * PLAN - command
        lag = given.rise if missing > 0.0 else given.fall
        turning = (paper.GEAR * torque - paper.RADIUS * force) / paper.INERTIA
        return force / paper.MASS, turning, (command - torque) / paper.LAG, missing / lag, pace

    run = paper.run_axle(given, case)
    known = solve_ivp(rates, (0.0, 9.0), np.zeros(5), t_eval=time, rtol=1e-7, max_step=5e-3)
    slip = paper.RADIUS * known.y[1] - known.y[0]
    np.testing.assert_allclose(run.slip[:9000:10], slip, atol=0.005 * np.ptp(slip))
    np.testing.assert_allclose(run.torque[:9000:10], known.y[2], atol=2e-3 * PLAN)


def test_a_small_grid_meets_the_findings_that_the_study_states():
    rows = []
    for cell in paper.cells(0, 0):
        part, given, margin, width, _ = cell.args
        if part == "cases" or (margin in (0.0, 0.4, 0.9) and width in (0.2, 0.3, 0.5, 0.6)):
            found = paper.run(part, given, margin, width, MEMBER_STEP)
            rows += [{**cell.columns, "status": "ok"} | row for row in found]
    table = paper.table(pd.DataFrame(rows)).set_index("number")[["km/h/s", "m/s2"]]
    assert table.loc["findings that hold, of 22"].tolist() == ["19", "18"]
    assert table.loc["downhill: off the share at rest by"].astype(float).max() < 1e-3
