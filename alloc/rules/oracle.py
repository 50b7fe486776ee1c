"""The best possible result: the exact level, by a rule that knows the rail."""

from alloc.compilation import jit
from alloc.rules.allocation import Allocation
from alloc.rules.exact import answer_exact, exact_limits
from alloc.rules.problem import AllocationProblem
from alloc.rules.rule import RULES, Rule


@jit
def oracle_law(units, expected, limit_out):
    """Limits at the exact level of the true coefficients."""
    return exact_limits(units.truth, expected, units.mass, units.limit_max, limit_out)


def answer_oracle(problem: AllocationProblem) -> Allocation:
    """The exact answer to the problem with the true coefficients."""
    return answer_exact(problem.changed(cap=problem.available))


ORACLE = Rule(
    "oracle", "the exact level on the true coefficients: what could be had at best", answer_oracle,
    oracle_law, periodic=True, needs_truth=True, colour="#000000", marker="*",
)  # fmt: skip
RULES.register("oracle", ORACLE)
