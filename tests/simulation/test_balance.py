"""A run that breaks a law of the plant is none: faults are put in, and sound runs pass."""

import numpy as np
import pytest

from alloc import loop, simulation
from alloc.balance import check_run
from alloc.errors import UnsoundRun
from alloc.simulation import simulate
from studies.scenario.loading import load_scenario


def faulty(monkeypatch, change):
    """Every plant is changed before its run."""
    made = loop.compiled.workspace

    def workspace(model, step):
        found = made(model, step)
        change(found)
        return found

    monkeypatch.setattr(loop.compiled, "workspace", workspace)


@pytest.fixture(scope="module")
def event():
    return load_scenario("wet-start").changed(duration_s=4.0).event(0)


@pytest.mark.parametrize("part", ["bodies", "wheels"])
def test_a_force_that_is_wrong_by_a_hundredth_is_noticed(monkeypatch, event, part):
    def change(w):
        inverse = w.car.inverse_body_mass if part == "bodies" else w.axle.inverse_inertia
        inverse[:] *= 1.01

    faulty(monkeypatch, change)
    with pytest.raises(UnsoundRun, match=r"its energy balance lacks more than 0.0001 .* at \d"):
        simulate(event, "alone", "cut-and-ramp")


def test_each_limit_and_each_missing_number_is_noticed(monkeypatch, event):
    told = []
    monkeypatch.setattr(simulation, "check_run", lambda *given: told.extend(given))
    simulate(event, "alone", "cut-and-ramp")
    model, record, run = told
    check_run(model, record, run)
    axles, brakes = model.layout.axles, model.train.brake_groups
    for name, value, words in (
        ("motor_torque", 1.01 * model.structure.drive_table.max(), "a motor's torque exceeds its greatest at 2 s"),
        ("cylinder_pressure", 1.01 * brakes[0].maximum_pressure, "pressure is outside 0 to its supply at 2 s"),
        ("cylinder_pressure", -100.0, "pressure is outside 0 to its supply at 2 s"),
        ("coefficient", -1.03 * run["adhesion_limit"].values[200, 0], "force exceeds what its rail carries at 2 s"),
        ("reference_speed", np.nan, "reference_speed is not finite at 2 s"),
    ):  # fmt: skip
        changed = run.copy(deep=True)
        changed[name].values[200, ...] = value
        with pytest.raises(UnsoundRun, match=words):
            check_run(model, record, changed)
    record.state[200, model.layout.omega.stop - axles] = np.inf
    with pytest.raises(UnsoundRun, match="the state is not finite at 2 s"):
        check_run(model, record, run)
