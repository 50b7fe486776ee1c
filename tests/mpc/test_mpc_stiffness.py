"""Steps of the prediction are as short as the believed curve needs, and no shorter."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.plant.adhesion import RationalCurve
from alloc.records import ByReference
from mpc.belief import with_predicted_curve
from mpc.condensing import needed_substeps, steepest
from mpc.model import curve_place, parameters, stiffness_of, substeps
from mpc.period import RealTimeIteration
from mpc.settings import MpcSettings
from mpc.solver import linearise_at
from tests.mpc.groups import small_cars

STEP = 0.01


def _curve(rng):
    return RationalCurve(
        peak_slip=float(rng.uniform(0.02, 1.0)), steepness=float(rng.uniform(1.0, 60.0))
    )


def test_the_bound_of_the_slope_holds_and_is_close():
    rng = np.random.default_rng(5)
    for _ in range(200):
        curve, peak = _curve(rng), rng.uniform(0.01, 0.5)
        bound, exact = steepest(peak, curve.peak_slip, curve.steepness), curve.steepest_slope(peak)
        assert exact * (1.0 - 1e-9) <= bound <= 1.06 * exact


@pytest.mark.parametrize(
    "values", [{}, {"axles": 1}, {"axle_load": 200e3, "mass": 20e3}, {"torque_lag": 1e-3}], ids=str
)
def test_substeps_are_those_of_the_plant_on_the_believed_curve(make_context, values):
    context = with_predicted_curve(make_context(**values))
    stiffness, rng, found = stiffness_of(context, STEP), np.random.default_rng(6), set()
    assert stiffness.most == substeps(context, STEP)
    for _ in range(60):
        curve, peak = _curve(rng), rng.uniform(0.01, 0.5, context.axles)
        believed = parameters(context, peak)
        believed[curve_place(context)] = curve.peak_slip, curve.steepness
        # the plant's rail has a peak of 1
        scaled = replace(curve, peak_slip=curve.peak_slip / peak.max())
        plant = min(substeps(replace(context, curve=scaled), STEP), stiffness.most)
        needed = needed_substeps(stiffness, STEP, believed)
        assert plant <= needed <= min(np.ceil(1.06 * plant + 0.06), stiffness.most)
        found.add(needed)
    assert stiffness.most == max(found)
    assert len(found) > 1 or stiffness.rest * STEP / 2.0 > stiffness.most - 1


def test_what_is_no_number_gives_a_number_of_steps_and_other_curves_take_most(context):
    believed, other = with_predicted_curve(context), stiffness_of(context, STEP)
    place = curve_place(believed)
    for k in (0, place.start, place.stop - 1):
        for value in (np.nan, np.inf, 0.0):
            values = parameters(believed, 0.1)
            values[k] = value
            assert 1 <= needed_substeps(stiffness_of(believed, STEP), STEP, values) <= 6
    assert needed_substeps(other, STEP, parameters(context, 0.1)) == substeps(context, STEP)


def test_fewer_substeps_of_a_flatter_curve_predict_the_same(context, random_problem):
    context = with_predicted_curve(context)
    data = random_problem(context, 3)
    data.parameters[curve_place(context)] = 0.1, 2.5
    solver, slips = RealTimeIteration(context, MpcSettings()), []
    made = solver.period
    solver.restart(400.0)
    solver.take(data)
    assert made.now.substeps[0] < made.rules.stiffness.most
    for number in (made.now.substeps[0], 60):
        made.now.substeps[0] = number
        linearise_at(solver.torques, ByReference(made))
        slips.append(made.around.nodes @ made.terms.slip_matrix.T)
    assert np.abs(slips[0]).max() > 0.01
    np.testing.assert_allclose(slips[0], slips[1], atol=1e-3)


def test_a_group_needs_the_steps_of_its_stiffest_unit():
    group = [with_predicted_curve(one) for one in small_cars(2)]
    heavy = [replace(group[0], axle_load=3.0 * group[0].axle_load), *group[1:]]
    light, stiff = (stiffness_of(one, STEP) for one in (group, heavy))
    assert stiff.slope > 2.0 * light.slope
