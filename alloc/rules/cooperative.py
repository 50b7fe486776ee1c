"""This project's own rule: units that the rail limits keep what they find, the others make up for it together.

It knows what the units report, see `alloc.onboard.reports`: whether they are limited, and what they deliver. Nothing that is
believed of the rail enters, neither the increments nor a curve.

- **Own caps.** A limited unit's cap is what it delivers. Every other unit is open up to what it has shown to carry,
  and one that was never limited up to its torque limit. The exact level over these caps makes up for what is missing.
- **The plan at least.** No limit is below the plan: a unit that finds less is in the hands of its own controller, which
  finds the rail's recovery sooner than telegrams tell of it.
- **Probing.** Beyond the plan a limit stays at what the unit has shown, so its wheels do not work at the peak all the time.
  The mark rises slowly until the unit is limited once more, and sinks slowly while it delivers less.
- **Room to search.** A unit that is limited is asked for a little more than it delivers. A controller that searches for the
  peak learns nothing while its torque touches the limit, and takes each change of the limit for the rail's answer.
"""

import numpy as np

from alloc.compilation import jit
from alloc.rules.exact import answer_exact, exact_limits
from alloc.rules.rule import RULES, Rule


@jit
def cooperative_law(units, expected, limit_out):
    """The exact level over all caps; every unit keeps the plan at least, and no more than it is open to."""
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
