"""What is recorded of the plant is what the NumPy form of its laws gives, for every train, curve and kind of drive."""

import time
from dataclasses import replace
from itertools import product

import numpy as np

from alloc.plant import engine as compiled
from alloc.plant.array_model import ArrayModel
from alloc.plant.laws import swing_torque
from alloc.plant.model import Model, build
from alloc.plant.rail import Rail
from alloc.plant.sets import SETS, find_set
from alloc.recording import AT_ONCE, PlantRecord, physical_variables
from tests.cases import looped
from tests.plant.test_engine import AGREEING, TIME, _agreeing_model, _random
from tests.plant.test_torsion import _twisting

COMMUTER = find_set("commuter-8car")
OWN = {
    "twisting": build(_twisting(COMMUTER), Rail(0.2)),
    "twisting, on one inverter": build(_twisting(COMMUTER, kind="induction"), Rail(0.2)),
    "recovering": build(COMMUTER, Rail(0.08, recovered_coefficient=0.28)),
    "without load transfer": build(replace(COMMUTER, load_transfer=False), Rail(0.2)),
}


def _recorded(model: Model, instants: int) -> tuple[PlantRecord, np.ndarray]:
    """A record of random states, and the states (rows, instants)."""
    n = model.layout
    record, states = PlantRecord.allocate(instants, n), np.empty((n.rows, instants))
    for k in range(instants):
        state, inputs, _ = _random(model, k)
        states[:, k], record.state[k], record.time[k] = state, state[: n.deflection.start], TIME
        w = compiled.workspace(model, 1e-3)
        compiled.advance(w, TIME, 1e-3, 1, state, inputs)
        for values, noted in zip(record.noted, w.noted, strict=True):
            values[k] = noted
    return record, states


def _by_arrays(model: Model, states: np.ndarray, peak: np.ndarray) -> dict[str, np.ndarray]:
    """The same variables by `ArrayModel`, (…, instants)."""
    n, s, arrays = model.layout, model.structure, ArrayModel.of(model)
    slip, mu, force = arrays.forces(states, peak)
    shoe, rate = arrays.wheelsets(states, force)
    speed = arrays.body_of_axle @ states[n.speed]
    limit, top = model.rail.curve.limit(peak, speed, model.environment.contact[:, None])
    found = {
        "slip_velocity": slip,
        "coefficient": mu,
        "rail_force": force,
        "axle_load": np.where(mu != 0.0, force / np.where(mu != 0.0, mu, 1.0), np.nan),
        "brake_force": shoe / s.radius[:, None],
        "adhesion_limit": limit,
        "peak_slip": np.broadcast_to(top, limit.shape),
        "coupler_force": arrays.coupler_forces(states)[0],
    }
    if n.shafts:
        rotor, stiffness, _ = s.axle_shaft[:, :, None]
        wheel, shaft = s.inertia[:, None] - rotor, arrays.shaft_torques(states)
        # the oscillation is about the torque with which rotor and wheelset speed up alike
        motor = arrays.motor_torques(states)
        alike = (motor - s.radius[:, None] * force - shoe) / (rotor + wheel)
        twisting = swing_torque(
            shaft, motor - rotor * alike, arrays.rotor_speeds(states) - states[n.omega],
            stiffness, rotor * wheel / (rotor + wheel),
        )  # fmt: skip
        found |= {
            "shaft_torque": shaft,
            "shaft_swing": np.where(rotor > 0.0, twisting, np.abs(shaft)),
        }
        assert np.isfinite(rate).all()
    return found


def _assert_recorded(model: Model, instants: int, case: str) -> None:
    record, states = _recorded(model, instants)
    actual = physical_variables(model, record)
    for name, values in _by_arrays(model, states, record.noted.peak.T).items():
        known, scale = ~np.isnan(values.T), np.nanmax(np.abs(values), initial=0.0)
        # a maximum is flat: its place is known to the root of its height's rounding
        tolerance = 1e-6 if name == "peak_slip" else 1e-12
        np.testing.assert_allclose(
            actual[name][known], values.T[known], rtol=tolerance, atol=tolerance * scale,
            err_msg=f"{case}, {name}",
        )  # fmt: skip


@looped("name", SETS)
def test_recorded_physics_are_the_laws_on_arrays(name):
    for curve, law in product(AGREEING, ("shinkansen",)):
        _assert_recorded(_agreeing_model(name, curve, law), 9, curve)


@looped("name", OWN)
def test_so_are_those_of_drives_and_rails_with_a_memory(name):
    _assert_recorded(OWN[name], 9, name)


def test_an_instant_has_the_same_limits_in_a_record_of_any_length():
    """Limits are found in blocks of several instants, the last one not full."""
    model = _agreeing_model("commuter-8car", "polach-wet", "shinkansen")
    one, _ = _recorded(model, 1)
    instants = 2 * AT_ONCE // model.layout.axles + 1
    state, peak = (np.repeat(values, instants, axis=0) for values in (one.state, one.noted.peak))
    many = PlantRecord.allocate(instants, model.layout)
    many = PlantRecord(many.time, state, many.noted._replace(peak=peak))
    short, long = (physical_variables(model, record) for record in (one, many))
    for name in ("adhesion_limit", "peak_slip"):
        assert (long[name] == short[name]).all()


def test_what_follows_from_a_record_occupies_one_processor():
    model = build(COMMUTER, Rail(0.13))
    record = PlantRecord.allocate(5000, model.layout)
    record.state[:] = model.initial_state(10.0)[: record.state.shape[1]]
    record.noted.peak[:] = 0.13
    physical_variables(model, record)  # threads that something else woke spin for a while
    thread, process = time.thread_time(), time.process_time()
    for _ in range(10):
        physical_variables(model, record)
    assert time.process_time() - process <= 1.2 * (time.thread_time() - thread)
