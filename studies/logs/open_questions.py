"""What the errors of a log leave open of its wheel damage Q: the delay of the train's speed first."""

from studies.logs.measured_log import MeasuredLog
from studies.logs.measured_run import Findings
from studies.logs.remarks import Remark
from studies.logs.train_speed import ROWS, SURE, UNLIKE

MOVED = 0.05
"""Share of Q by which a delay changes it, above which the log is flagged."""


def moved_by_delay(log: MeasuredLog, found: Findings) -> float | None:
    """By how much the delay that was found would move Q if it were left in the speed, as a share of Q; None if none was."""
    if found.errors is None or log.run.speed_delay is None or log.run.speed_source != "followed":
        return None
    return found.errors.of_delay / max(abs(found.total_damage), 1e-9)


def delay_remarks(log: MeasuredLog, found: Findings) -> list[Remark]:
    """Flags: a delay that alone moves Q by more than `MOVED`, or that is not known well enough."""
    delay, errors = log.run.speed_delay, found.errors
    if delay is None or errors is None:
        return []
    damage = max(abs(found.total_damage), 1e-9)
    moved = moved_by_delay(log, found)
    if moved is None:
        unlike = delay.deviation if delay.drift > UNLIKE else 0.0
        likely = max(SURE * delay.deviation, ROWS * log.period)
        late = abs(delay.value) if abs(delay.value) > likely and not unlike else 0.0
        unsure = abs(errors.per_second) * max(unlike, late) / damage
        if unsure < MOVED:
            return []
        text = (
            f"the train's speed may be {max(unlike, late):.2g} s late or early, by what forces and wheels say; that moves "
            f"Q by {100.0 * unsure:.0f} %, and is not made up for"
        )
        return [Remark("delay", "speed", text)]
    remarks = []
    how = f"{abs(delay.value):.3f} ± {delay.deviation:.3f} s {'late' if delay.value > 0.0 else 'early'}"
    if abs(moved) > MOVED:
        text = f"the train's speed is {how}; made up for, and left alone it moves Q by {100.0 * moved:+.0f} %"
        remarks.append(Remark("delay", "speed", text))
    open_still = errors.by_delay / damage
    if open_still > MOVED:
        text = f"what is not known of the delay, {delay.deviation:.2g} s, moves Q by {100.0 * open_still:.0f} %"
        remarks.append(Remark("delay", "speed", text))
    return remarks
