"""What the computers counted during a run."""

from alloc.metrics.registry import METRICS, NEVER_NEGATIVE, Metric


def _attribute(
    name: str, unit: str, description: str, key: str, better: int = 0, scale: float = 1.0
) -> None:
    count = Metric(
        name, unit, description, lambda run: scale * float(run.attrs[key]), better, NEVER_NEGATIVE
    )
    METRICS.register(name, count)


_attribute("detections", "1", "slips detected by the foremost unit", "detections", -1)
_attribute("unit_detections", "1", "slips detected by all units", "unit_detections", -1)
_attribute("telegrams", "1", "telegrams sent", "telegrams_sent")
_attribute("telegrams_lost", "1", "telegrams lost", "telegrams_lost")
_attribute("fallbacks", "1", "units fallen back to the plan in silence", "fallbacks")
_attribute("blinded", "1", "units that lost the speed of their last axle", "blinded")
_attribute("locks", "1", "axles that slide protection found standing", "locks", -1)
_attribute("time_outs", "1", "valves made to supply by their time-out", "time_outs", -1)
_attribute("rule_calls", "1", "calls of the allocation rule", "rule_calls")
_attribute("rule_failures", "1", "calls in which the rule's solver failed", "rule_failures", -1)
_attribute("rule_time", "ms", "time in rules called from Python", "rule_time_s", 0, 1e3)
_attribute(
    "controller_failures",
    "1",
    "steps in which a controller's solver failed",
    "controller_failures",
    -1,
)
_attribute(
    "controller_median",
    "ms",
    "median time per unit and step that its computer takes",
    "controller_median_s",
    0,
    1e3,
)
_attribute("controller_p99", "ms", "99th percentile of it", "controller_p99_s", 0, 1e3)
