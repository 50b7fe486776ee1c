"""Whether a recorded run can be believed: numbers are finite, the energy balance closes, limits are kept."""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.old.errors import UnsoundRun
from alloc.old.plant.laws import coupler_stretch
from alloc.old.plant.model import Floats, Model
from alloc.old.recording import PlantRecord

MOST_MISSING = 1e-4
"""Share of the energy turned over that the balance may lack."""
LEAST_ENERGY = 1.0
"""Energy [J] that a balance may lack of a train that hardly moves."""
ROUNDING = 1e-9
"""Share of the energy that is there, of a limit, and of the range of a metric, that counts for nothing."""
BRAKED = 0.025
"""Share by which a braked wheel may exceed the recorded limit, which is that of driving: Polach's law gives up to 2 %."""
AT_ONCE = 4096
"""Instants that are compared with their limits at once: a long run is not to double its memory."""
BALANCED = 200
"""Instants of a run at which energy is counted; what is lost once is missing at all later ones."""
MAY_BE_MISSING = {"level", "increment_datum", "learnt_deviation"}
"""Recorded variables that are nan where there is no such quantity."""


def coupler_spring_energy(stretch: Floats, stiffness: Floats, stiffening: Floats) -> Floats:
    """Elastic energy of a draft gear [J]: the integral of `coupler_spring_force`."""
    square = stretch * stretch
    return square * (0.5 * stiffness + 0.25 * stiffening * square)


def draft_gear_energy(stretch: Floats, travel: Floats, gear: Floats) -> Floats:
    """Elastic energy of a friction draft gear [J]: of its structure, and of the mean of the wedges' two lines."""
    structure, loading, unloading, preload, restoring = gear[:5]
    pull = np.maximum(stretch - np.maximum(travel, 0.0), 0.0)
    push = np.maximum(-stretch - np.maximum(-travel, 0.0), 0.0)
    way = np.abs(travel)
    wedges = way * (0.5 * (preload + restoring) + 0.25 * (loading + unloading) * way)
    return np.asarray(0.5 * structure * (pull**2 + push**2) + wedges)


def mechanical_energy(model: Model, state: Floats) -> Floats:
    """Kinetic energy of bodies, wheelsets, rotors, elastic energy of couplers and drives [J] of states (..., rows)."""
    s, n = model.structure, model.layout
    speed, omega, position = (state[..., part] for part in (n.speed, n.omega, n.position))
    energy = 0.5 * np.einsum("...b,...b,b->...", speed, speed, s.body_mass)
    rotor, stiffness, _ = s.axle_shaft
    energy += 0.5 * np.einsum("...a,...a,a->...", omega, omega, s.inertia - rotor)
    if n.shafts:
        turned, twist = state[..., n.rotor], state[..., n.twist]
        energy += 0.5 * ((turned**2 @ rotor) + (twist**2 @ stiffness))
    if n.bodies > 1:
        stiffness, stiffening, _, slack = s.coupler.T
        stretch = coupler_stretch(position[..., :-1] - position[..., 1:], slack)
        energy += coupler_spring_energy(stretch, stiffness, stiffening).sum(axis=-1)
        if n.draft_gears:
            travel = state[..., n.gear_travel]
            energy += draft_gear_energy(stretch, travel, s.draft_gear.T).sum(axis=-1)
    return np.asarray(energy)


def energy_balance(model: Model, state: Floats) -> tuple[Floats, Floats]:
    """Energy that came from nowhere, and what was turned over [J], since the first of the states (instants, rows)."""
    n = model.layout
    energy = mechanical_energy(model, state)
    works = np.hstack([state[:, n.work], state[:, n.friction_work].sum(axis=1, keepdims=True)])
    motors, *lost = (works - works[0]).T
    turned = np.abs(motors) + sum(np.abs(one) for one in lost)
    return energy - energy[0] - motors + sum(lost), turned + ROUNDING / MOST_MISSING * energy


def check_run(model: Model, record: PlantRecord, run: xr.Dataset) -> None:
    """Raise `UnsoundRun` where `run`, made from `record`, breaks a law that every run keeps.

    All numbers are finite. Energy is conserved to `MOST_MISSING` of what motors, shoes, resistance, couplers and slip turn
    over. No motor gives more than its greatest torque, no wheel more than its rail, no cylinder more than its supply.
    """
    s, time = model.structure, record.time
    # what is recorded of axles follows from these, and takes ten times as long to look through
    parts = {"the state": record.state, "the rail's coefficient": record.noted.peak}
    parts |= {
        str(name): np.asarray(variable.values)
        for name, variable in run.variables.items()
        if "axle" not in variable.dims and name not in MAY_BE_MISSING
    }
    for name, values in parts.items():
        if not np.isfinite(values.sum()):
            _refuse(time, ~np.isfinite(values), f"{name} is not finite")
    chosen = np.r_[0 : time.size : max(1, time.size // BALANCED), time.size - 1]
    missing, turned = energy_balance(model, record.state[chosen])
    _refuse(
        time[chosen], np.abs(missing) > MOST_MISSING * turned + LEAST_ENERGY,
        f"its energy balance lacks more than {MOST_MISSING:g} of the energy turned over",
    )  # fmt: skip
    beyond = 1.0 + ROUNDING
    braking, driving = (table.max(axis=1, initial=0.0) for table in (s.brake_table, s.drive_table))
    supply = np.array([brake.maximum_pressure for brake in model.train.brake_groups])
    recorded = [
        run.variables[name].values
        for name in ("motor_torque", "cylinder_pressure", "coefficient", "adhesion_limit")
    ]
    for first in range(0, time.size, AT_ONCE):
        some = slice(first, first + AT_ONCE)
        torque, pressure, coefficient, limit = (np.asarray(values[some]) for values in recorded)
        most = np.where(torque < 0.0, braking, driving)
        for faulty, what in (
            (np.abs(torque) > beyond * most, "a motor's torque exceeds its greatest"),
            (np.abs(pressure - 0.5 * supply) > beyond * 0.5 * supply, "a cylinder's pressure is outside 0 to its supply"),
            (np.abs(coefficient) > (1.0 + BRAKED) * limit, "a wheel's force exceeds what its rail carries"),
        ):  # fmt: skip
            _refuse(time[some], faulty, what)


def _refuse(time: Floats, faulty: NDArray[np.bool_], what: str) -> None:
    """Raise where a number is faulty; the first dimension is the instants, or there are none."""
    if faulty.any():
        since = f" at {time[np.nonzero(faulty)[0][0]]:g} s" if len(faulty) == time.size else ""
        raise UnsoundRun(f"the run is not sound, its numbers count for nothing: {what}{since}")
