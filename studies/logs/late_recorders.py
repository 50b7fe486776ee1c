"""Axles of a log that another recorder wrote, with a clock of its own: brought into time with the others, and said."""

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.axle_delays import LateAxles, late_axles
from alloc.estimation.common_instants import Instants
from alloc.estimation.force_reading import in_time
from alloc.estimation.known_train import MeasuredTrain
from alloc.estimation.own_samples import Samples
from alloc.estimation.speed_fixes import find_delay
from alloc.estimation.speed_shape import motion_of, shape_of_forces
from studies.logs.remarks import Remark

Floats = NDArray[np.float64]


def bring_together(
    instants: Instants,
    rim: Floats,
    force: Floats,
    train: MeasuredTrain,
    grade: Floats | None,
    fixes: Samples | None,
    noise: float,
) -> tuple[list[Remark], float]:
    """Rim speeds and forces (instants, axles), in place, as if one clock had been for all; remarks on it.

    Forces are moved with the wheels unless the train's speed, of which `fixes` are measurements, says otherwise. The
    second is what remains unknown of the delays, as a standard deviation of a delay of all axles [s].
    """
    remarks, unsure = [], 0.0
    for group in late_axles(instants.time, rim, train, noise):
        axles = group.axles
        rim[:, axles] = in_time(*instants, rim[:, axles], group.late)
        with_wheels = force.copy()
        with_wheels[:, axles] = in_time(*instants, force[:, axles], group.late)
        both = _fits_better(instants, rim, (with_wheels, force), train, grade, fixes)
        if both:
            force[:, axles] = with_wheels[:, axles]
        remarks.append(_remark(group, both))
        unsure = float(np.hypot(unsure, group.deviation * axles.size / train.radius.size))
    return remarks, unsure


def _fits_better(
    instants: Instants,
    rim: Floats,
    forces: tuple[Floats, Floats],
    train: MeasuredTrain,
    grade: Floats | None,
    fixes: Samples | None,
) -> bool:
    """Whether the first of two readings of the forces explains the train's speed no worse than the second."""
    if fixes is None or fixes.time.size == 0 or not np.isfinite(forces[0]).any():
        return True
    time, part = instants
    near = np.interp(time, fixes.time, fixes.value)
    under_way = motion_of(time, near, rim).under_way
    misfits = []
    for force in forces:
        shape = shape_of_forces(time, near, rim, force, train, grade)
        assert shape is not None
        misfits.append(find_delay(time, part, shape, fixes, under_way).misfit)
    return misfits[0] <= misfits[1]


def _remark(group: LateAxles, both: bool) -> Remark:
    axles = [int(i) + 1 for i in group.axles]
    whole = axles == list(range(axles[0], axles[-1] + 1))
    names = f"axles {axles[0]} to {axles[-1]}" if whole else f"axles {', '.join(map(str, axles))}"
    names = f"axle {axles[0]}" if len(axles) == 1 else names
    how = f"{abs(group.late):.3f} ± {group.deviation:.3f} s {'later' if group.late > 0.0 else 'earlier'}"
    what = "speed and force" if both else "speed alone"
    text = f"{names}: {what} recorded {how} than the others, by the wheels that roll; made up for"
    return Remark("delay", "axleN_speed", text)
