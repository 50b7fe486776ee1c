"""Forces of a log as they are read: in time with the wheels and at the rims; what was changed is said."""

import numpy as np
from numpy.typing import NDArray

from studies.logs.force_reading import at_rims, in_time
from studies.logs.measured_run import WINDOW
from studies.logs.remarks import Remark
from studies.logs.train_readings import TrainReadings
from studies.logs.train_speed import MeasuredSpeed

Floats = NDArray[np.float64]


def as_read(
    readings: TrainReadings, speed: MeasuredSpeed, told: bool | None
) -> tuple[Floats, list[Remark]]:
    """The forces at the rims and in time with the wheels; `told`: whether they are said to act between wheel and rail."""
    time, part, rim, force, train = readings[:5]
    late, at_contact = 0.0, bool(told)
    if speed.forces is not None:
        late, at_contact = speed.forces.late, speed.forces.at_contact
    remarks = []
    perhaps = 0.0 if speed.forces is None else speed.forces.perhaps_late
    if perhaps:
        how = f"{abs(perhaps):.2g} s {'later' if perhaps > 0.0 else 'earlier'}"
        text = f"the forces may be recorded {how} than the wheels, by the train's momentum: not made up for"
        remarks.append(Remark("delay", "axleN_force", text))
    if speed.forces is not None and speed.forces.perhaps_at_contact:
        text = (
            "with the told mass they explain the motion only if they act between wheel and rail: not taken so (a mapping "
            'file may say at = "contact" under [forces])'
        )
        remarks.append(Remark("balance", "axleN_force", text))
    if late:
        how = f"{abs(late):.3f} s {'later' if late > 0.0 else 'earlier'}"
        end = "last" if late > 0.0 else "first"
        text = (
            f"all forces are recorded {how} than the wheels, by the train's momentum: made up for; in the {end} "
            f"{abs(late):.2g} s they are held"
        )
        remarks.append(Remark("delay", "axleN_force", text))
        force = in_time(time, part, force, late, held=True)
    if at_contact:
        if told is None:
            text = (
                "the forces are those between wheel and rail, by the train's momentum; taken so (a mapping file may say "
                'at = "rim" under [forces])'
            )
            remarks.append(Remark("guess", "axleN_force", text))
        force = at_rims(time, rim, force, train, WINDOW)
    return force, remarks
