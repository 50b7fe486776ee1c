"""How good was a run? Pure functions of a recorded run (`alloc.old.recording`).

One registry gives every metric its unit, its meaning and which way is better. A metric registers where it is written.
"""

from typing import TYPE_CHECKING

from alloc.old.registry import names_of

if TYPE_CHECKING:
    from alloc.old.metrics.registry import METRICS, Metric, evaluate, metric
else:
    __getattr__ = names_of(__name__, registry="METRICS Metric evaluate metric")

__all__ = ["METRICS", "Metric", "evaluate", "metric"]
