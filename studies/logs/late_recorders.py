"""Axles that another recorder wrote, with a clock of its own: brought into time with the others, and said."""

import numpy as np
from numpy.typing import NDArray

from studies.logs.axle_delays import LateAxles, late_axles
from studies.logs.force_reading import explains_more, in_time
from studies.logs.own_samples import Samples
from studies.logs.remarks import Remark
from studies.logs.speed_fixes import Delay, find_delay
from studies.logs.speed_shape import motion_of, rolls_always, shape_of_forces
from studies.logs.train_readings import TrainReadings
from studies.logs.train_speed import clear_of_rest

Floats = NDArray[np.float64]


def bring_together(
    readings: TrainReadings, fixes: Samples | None
) -> tuple[TrainReadings, list[Remark], float]:
    """Wheels and forces as if one clock had been for all; remarks on it.

    Wheels that come together may have slipped apart. So axles are moved only where some of them, and some of the others,
    always roll freely; or where the train's momentum then explains its speed much better, of which `fixes` are measurements.
    The last number is what remains unknown of the delays, as a standard deviation of a delay of all axles [s].
    """
    if fixes is None or fixes.time.size == 0 or not np.isfinite(readings.force).any():
        return readings, [], 0.0
    groups = late_axles(readings.time, readings.rim, readings.train, readings.rim_noise)
    if not groups:
        return readings, [], 0.0
    rim, force = (_moved(readings, values, groups) for values in (readings.rim, readings.force))
    together = readings._replace(rim=rim, force=force)
    if not (
        _by_free_axles(readings, groups)
        or explains_more(_fit(together, fixes), _fit(readings, fixes))
    ):
        return readings, [], 0.0
    axles = readings.train.radius.size
    unsure = [group.deviation * group.axles.size / axles for group in groups]
    return together, [_remark(one) for one in groups], float(np.hypot.reduce(unsure))


def _by_free_axles(readings: TrainReadings, groups: list[LateAxles]) -> bool:
    """Whether each group has an axle that always rolls freely, and so have those that are in time."""
    free = rolls_always(readings.force, readings.train.axle_load)
    others = np.setdiff1d(np.arange(free.size), np.concatenate([one.axles for one in groups]))
    return bool(free[others].any() and all(free[one.axles].any() for one in groups))


def _moved(readings: TrainReadings, values: Floats, groups: list[LateAxles]) -> Floats:
    values = values.copy(order="K")
    for group in groups:
        own = values[:, group.axles]
        values[:, group.axles] = in_time(readings.time, readings.part, own, group.late)
    return values


def _fit(readings: TrainReadings, fixes: Samples) -> Delay:
    """How well wheels and forces explain the train's speed."""
    near = np.interp(readings.time, fixes.time, fixes.value)
    shape = shape_of_forces(readings, near)
    assert shape is not None
    under_way, unclear = motion_of(readings, near, fixes.noise)
    clear, part = clear_of_rest(readings, unclear, fixes)
    return find_delay(readings.time, part, shape, clear, under_way)


def _remark(group: LateAxles) -> Remark:
    axles = [int(i) + 1 for i in group.axles]
    whole = axles == list(range(axles[0], axles[-1] + 1))
    names = f"axles {axles[0]} to {axles[-1]}" if whole else f"axles {', '.join(map(str, axles))}"
    names = f"axle {axles[0]}" if len(axles) == 1 else names
    how = f"{abs(group.late):.3f} ± {group.deviation:.3f} s {'later' if group.late > 0.0 else 'earlier'}"
    text = f"{names}: recorded {how} than the others, by the wheels that roll; made up for"
    return Remark("delay", "axleN_speed", text)
