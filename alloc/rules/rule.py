"""What an allocation rule is, and all rules by name.

A rule is a belief, what the leader thinks that each unit can carry, and a way to share the plan over the units, which works
on rows: `share(units, run) -> level` reads of each unit `cap`, `mass_share`, `most`, `mark`, `reported`, `searching`,
`wanted` (the limits in force, inf: none), of the run `plan`, `needed`, `limit_rate`. It writes `wanted`, and may set
`run.case`, which follows from `cap` and `most` else. A rule of a user may be an `answer` to an `AllocationProblem` instead,
in plain Python. Either is called with a problem to get an `Allocation`.
"""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import InitVar, dataclass, field, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from alloc.onboard.beliefs import BELIEFS
from alloc.onboard.columns import RUN, UNIT
from alloc.rules.problem import CASES, ROUNDING, Allocation, AllocationProblem, allocated
from alloc.schema.errors import AllocationError, blamed_on
from alloc.schema.registry import Registry
from alloc.schema.tables import Rows

Answer = Callable[[AllocationProblem], "Allocation | ArrayLike"]

PROMISES = ("exact", "reference", "effort", "baseline")
"""What a rule may promise, see `alloc.rules.conformance`. Exact: the optimum. Reference: where caps grow along the train,
no less than they allow and no more than the patent's rule asks. Effort: what caps and torque limits allow of the
plan, whatever the order of the units. Baseline: what every rule keeps."""


@dataclass(frozen=True)
class Rule:
    """An allocation rule: call it with an `AllocationProblem`. Raises `AllocationError` where a part of it does not
    exist.
    """

    name: str
    description: str
    share: Any = None
    """`share(units, run) -> level`, compiled or not. Left out where there is an `answer`."""
    belief: Any = "front"
    """A name in `alloc.onboard.beliefs.BELIEFS`, or a belief."""
    answer: Answer | None = field(default=None, repr=False)
    """In plain Python: an `Allocation`, or an array of limits of which the rest follows."""
    settings: Mapping[str, Any] = field(default_factory=dict, hash=False)
    """Settings on board that belong to the rule, by their path in `alloc.onboard.settings.Onboard`, as "detector.pole"."""
    promise: str = "baseline"
    """One of `PROMISES`."""
    colour: str = "#402020"
    """The same in every figure."""
    marker: str = "h"
    """In figures, as Matplotlib names it."""
    law: InitVar[Any] = None
    """What `share` was called; goes with the next release."""

    def __post_init__(self, law: Any) -> None:
        if law is not None:
            object.__setattr__(self, "share", law)
        for choice, choices in ((self.belief, BELIEFS), (self.promise, PROMISES)):
            if isinstance(choice, str) and choice not in choices:
                names = ", ".join(choices)
                raise AllocationError(f"rule {self.name!r}: {choice!r} must be one of {names}")
        if isinstance(self.belief, str):
            object.__setattr__(self, "belief", BELIEFS[self.belief])
        if self.answer is not None:
            object.__setattr__(self, "share", partial(serve_answer, self))
        if not callable(self.share):
            raise AllocationError(
                f"rule {self.name!r}: give a share(units, run), or an answer(problem)"
            )

    def __call__(self, problem: AllocationProblem) -> Allocation:
        """The rule's answer to `problem`."""
        started = time.perf_counter()
        if self.answer is not None:
            return replace(self.call_answer(problem), solve_time=time.perf_counter() - started)
        with blamed_on(f"rule {self.name!r}", self.share):
            units, run = rows_of_problem(problem)
            level = self.share(units, run)
            if level is None:
                raise AllocationError("share returned None; return the level, nan for none")
            spent, case = time.perf_counter() - started, CASES[run.case] if run.case else None
            return allocated(problem, units.wanted, level, case, solve_time=spent)

    def call_answer(self, problem: AllocationProblem) -> Allocation:
        """What its `answer` is, filled in; raises `InputError` of one line with file and line for what is none."""
        with blamed_on(f"rule {self.name!r}", self.answer):
            answer: Any = self.answer(problem)  # type: ignore[misc]
            if not isinstance(answer, Allocation):
                return allocated(problem, answer)
            fine = np.shape(answer.limit) == (problem.n,) and np.all(answer.limit >= -ROUNDING)
            return answer if fine else allocated(problem, answer.limit)

    def with_belief(self, name: str) -> "Rule":
        """The same rule on another belief."""
        return replace(self, belief=name)


RULES: Registry[Rule] = Registry(
    "rule",
    "alloc.rules.baselines",  # what a method must beat
    "alloc.rules.patent",
    "alloc.rules.exact",  # the best answer to the same problem
    "alloc.rules.qp",
    "alloc.rules.convex",
    "alloc.rules.cooperative",  # from what units report
)
"""Every rule by name, from these modules on."""


def serve_answer(rule: Rule, units: Rows, run: Any) -> float:
    """How a rule shares that has an `answer` in plain Python: rows in, rows out; faults of its solver are counted."""
    answer = rule.call_answer(problem_of(units, run))
    for j in range(units.size):
        units[j].wanted = answer.limit[j]
    run.case = CASES.index(answer.case)
    run.rule_faults += int(answer.failed)
    run.rule_gap = np.fmax(run.rule_gap, answer.gap)
    return answer.level


FIELD_OF = {name: name for name in ("cap", "mark", "searching", "truth", "deviation")}
FIELD_OF |= {"mass_share": "mass", "most": "limit_max"}
FIELD_OF |= {"reported": "delivered", "wanted": "previous"}
"""Field of an `AllocationProblem` by the column of a unit that has it."""


@lru_cache(maxsize=64)
def _default_rows(n: int) -> tuple[Rows, Rows]:
    return UNIT.rows(n), RUN.rows(1)


def rows_of_problem(problem: AllocationProblem) -> tuple[Rows, Any]:
    """Rows of the units and the row of the run that state `problem` to a rule."""
    # copies: to fill every column anew takes four times as long
    units, run = (rows.copy() for rows in _default_rows(problem.n))
    for column, name in FIELD_OF.items():
        units[column] = getattr(problem, name)
    run.plan, run.needed, run.limit_rate = problem.plan, problem.expected, problem.rate
    return units, run[0]


def problem_of(units: Rows, run: Any) -> AllocationProblem:
    """What rows of the units and the row of the run ask of a rule; a unit without a limit counts as having the plan."""
    needed = float(run.needed)
    return AllocationProblem(
        units.cap,
        needed,
        units.mass_share,
        limit_max=units.most,
        mark=units.mark,
        delivered=np.maximum(units.reported, 0.0),
        previous=np.where(units.wanted < math.inf, units.wanted, needed),
        searching=units.searching,
        truth=units.truth,
        deviation=units.deviation,
        rate=float(run.limit_rate),
        plan=float(run.plan),
    )
