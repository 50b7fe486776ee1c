"""Axles that another recorder wrote, with a clock of its own: brought into time with the others, and said."""

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.axle_delays import LateAxles, late_axles
from alloc.estimation.common_instants import Instants
from alloc.estimation.force_reading import explains_more, in_time
from alloc.estimation.known_train import MeasuredTrain
from alloc.estimation.own_samples import Samples
from alloc.estimation.speed_fixes import Delay, find_delay
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
) -> tuple[Floats, Floats, list[Remark], float]:
    """Rim speeds [m/s] and forces [N], (instants, axles), as if one clock had been for all; remarks on it.

    Wheels that come together may have slipped apart. So axles are moved only where the train's momentum then explains
    its speed, of which `fixes` are measurements, much better. The last number is what remains unknown of the delays, as a
    standard deviation of a delay of all axles [s].
    """
    as_recorded: tuple[Floats, Floats, list[Remark], float] = rim, force, [], 0.0
    if fixes is None or fixes.time.size == 0 or not np.isfinite(force).any():
        return as_recorded
    groups = late_axles(instants.time, rim, train, noise)
    if not groups:
        return as_recorded
    wheels, forces = _moved(instants, rim, groups), _moved(instants, force, groups)
    before = _fit(instants, rim, force, train, grade, fixes)
    if not explains_more(_fit(instants, wheels, forces, train, grade, fixes), before):
        return as_recorded
    unsure = [group.deviation * group.axles.size / train.radius.size for group in groups]
    return wheels, forces, [_remark(one) for one in groups], float(np.hypot.reduce(unsure))


def _moved(instants: Instants, values: Floats, groups: list[LateAxles]) -> Floats:
    values = values.copy(order="K")
    for group in groups:
        values[:, group.axles] = in_time(*instants, values[:, group.axles], group.late)
    return values


def _fit(
    instants: Instants,
    rim: Floats,
    force: Floats,
    train: MeasuredTrain,
    grade: Floats | None,
    fixes: Samples,
) -> Delay:
    """How well wheels and forces explain the train's speed."""
    time, part = instants
    near = np.interp(time, fixes.time, fixes.value)
    shape = shape_of_forces(time, near, rim, force, train, grade)
    assert shape is not None
    return find_delay(time, part, shape, fixes, motion_of(time, near, rim).under_way)


def _remark(group: LateAxles) -> Remark:
    axles = [int(i) + 1 for i in group.axles]
    whole = axles == list(range(axles[0], axles[-1] + 1))
    names = f"axles {axles[0]} to {axles[-1]}" if whole else f"axles {', '.join(map(str, axles))}"
    names = f"axle {axles[0]}" if len(axles) == 1 else names
    how = f"{abs(group.late):.3f} ± {group.deviation:.3f} s {'later' if group.late > 0.0 else 'earlier'}"
    text = f"{names}: recorded {how} than the others, by the wheels that roll; made up for"
    return Remark("delay", "axleN_speed", text)
