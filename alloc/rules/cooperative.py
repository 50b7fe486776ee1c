"""This project's own rule: limited units deliver what they can, and the others make up for the shortfall together.

It uses what the units report, see `alloc.onboard.reports`: whether they are limited, and what they deliver. It uses no
belief about the rail, neither the increments nor a curve.

- **Own caps.** A limited unit's cap is what it delivers. Every other unit may go up to the coefficient that it has shown to
  carry, and one that was never limited may go up to its torque limit. The exact level over these caps makes up for the
  shortfall.
- **The plan at least.** No limit is below the plan. If a unit finds less adhesion, its own controller takes care of it. That
  controller finds the rail's recovery sooner than telegrams report it. What trailers lack comes from units with room alone.
- **Probing.** Beyond the plan a limit stays at the coefficient that the unit has shown, so its wheels do not work at the
  peak all the time. The mark rises slowly until the unit is limited once more, and falls slowly while it delivers less.
- **Room to search.** A limited unit is asked for a little more than it delivers. A controller that searches for the peak
  learns nothing while its torque is at the limit, and mistakes each change of the limit for a response of the rail.
"""

import numpy as np

from alloc.compilation import jit
from alloc.rules.exact import answer_exact, exact_limits
from alloc.rules.rule import RULES, Rule


@jit
def cooperative_law(units, expected, limit_out):
    """The exact level over all caps; every unit gets the plan at least, and beyond the plan at most `open_to`."""
    level, reached = exact_limits(units.cap, expected, units.mass, units.limit_max, limit_out)
    # out of reach every unit does what it can, the best one too
    most = level if reached else np.inf
    for j in range(limit_out.size):
        limit_out[j] = min(max(min(most, units.open_to[j]), units.plan), units.limit_max[j])
    return level, reached


COOPERATIVE = Rule(
    "cooperative", "limited units keep what they find, the others make up for it", answer_exact,
    cooperative_law, own_caps=True, colour="#8e0055", marker="p",
)  # fmt: skip
RULES.register("cooperative", COOPERATIVE)
