"""How good was a run? Pure functions of a recorded run (`alloc.recording`).

One registry gives every metric its unit, its meaning and which way is better.
"""

# isort: off (the order of these is the order of the metrics)
from alloc.metrics import counts, detection, motion, search, slide

# isort: on
from alloc.metrics.registry import METRICS, Metric, evaluate

jerk = motion.jerk

__all__ = [
    "METRICS",
    "Metric",
    "counts",
    "detection",
    "evaluate",
    "jerk",
    "motion",
    "search",
    "slide",
]
