"""What the errors of a log leave open of its wheel damage Q: the delay of the train's speed first."""

from alloc.estimation.measured_run import Findings
from studies.logs.measured_log import MeasuredLog
from studies.logs.remarks import Remark

MOVED = 0.05
"""Share of Q that a delay moves, from which on the log is flagged."""
UNLIKE = 0.03
"""Drift of the shape [m/s2 per root second] from which on a speed that is as measured is not that of the forces."""


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
        unsure = abs(errors.per_second) * delay.deviation / damage
        if delay.drift < UNLIKE or unsure < MOVED:
            return []
        text = (
            f"the train's speed does not change as forces and wheels say; it may be {delay.deviation:.2g} s late or early, "
            f"which moves Q by {100.0 * unsure:.0f} %"
        )
        return [Remark("delay", "speed", text)]
    remarks = []
    late = f"{abs(delay.value):.3f} ± {delay.deviation:.3f} s {'late' if delay.value > 0.0 else 'early'}"
    if abs(moved) > MOVED:
        text = f"the train's speed is {late}; made up for, and left alone it moves Q by {100.0 * moved:+.0f} %"
        remarks.append(Remark("delay", "speed", text))
    unsure = errors.by_delay / damage
    if unsure > MOVED:
        text = f"what is not known of the delay, {delay.deviation:.2g} s, moves Q by {100.0 * unsure:.0f} %"
        remarks.append(Remark("delay", "speed", text))
    return remarks
