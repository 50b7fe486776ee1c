"""Conformance kit: problems with known answers, random ones, and the laws that an allocation rule keeps.

`check_rule(rule)` raises `BrokenLaw` with the law, the worst value and the smallest counterexample that Hypothesis finds;
`parametrize_with_checks` makes a test of pytest of each law. A rule is asked the laws that it promises, see `PROMISES`. The
laws of controllers and adhesion curves are in `alloc.old.testing`. Hypothesis and pytest are imported where they are used.
"""

import math
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from functools import lru_cache, partial
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import alloc.old as alloc
from alloc.old.errors import InputError
from alloc.old.rules.exact import EXACT, optimality
from alloc.old.rules.patent import GREEDY
from alloc.old.rules.problem import CASES, Allocation, AllocationProblem, Floats, fault_of
from alloc.old.rules.rule import PROMISES, Rule, Units, units_of

# Laws and their verdicts, for parts of any kind.


class Unusable(AssertionError):
    """What a part answers is of no use; the message says what it should be."""


class BrokenLaw(AssertionError):
    """A part breaks a law; the message has the law, the worst value and the counterexample."""


@dataclass(frozen=True)
class Law:
    """What parts of a kind keep: by how much a part breaks it in a case, and the cases in which it is asked."""

    name: str
    meaning: str
    """One line, with the unit of the amount."""
    amount: Callable[[Any, Any], float]
    """By how much the part breaks the law in a case; raises `Unusable` where its answer cannot be judged."""
    drawn: Callable[[], Any] | None = None
    """Makes the Hypothesis strategy of cases."""
    known: Sequence[Any] = ()
    """Cases beside those drawn."""
    promise: str = PROMISES[-1]
    """The weakest promise that includes it."""
    tolerance: float = 1e-9
    """Largest amount that counts as rounding."""


class Verdict(NamedTuple):
    """What was found of one law."""

    law: Law
    worst: float
    """Largest amount of all cases tried; inf where an answer could not be judged."""
    fault: str = ""
    """What is wrong; empty where the law holds."""
    counterexample: str = ""
    """The smallest case found that breaks it."""

    def check(self, name: str) -> None:
        """Raise `BrokenLaw` where the part called `name` breaks the law."""
        if self.fault:
            raise BrokenLaw(
                f"{name} breaks the law {self.law.name!r} ({self.law.meaning}): {self.fault}; "
                f"worst {self.worst:.3g}, at most {self.law.tolerance:.0e}; counterexample: {self.counterexample}"
            )


def needed(module: str) -> Any:
    """A module of the extra "check"; raises `InputError` where it is not installed."""
    try:
        return import_module(module)
    except ImportError:
        raise InputError(
            f"the conformance kit needs {module}: install it with `pip install -e '.[check]'`"
        ) from None


@lru_cache(maxsize=16)
def drawn_cases(drawn: Callable[[], Any], count: int) -> tuple[Any, ...]:
    """The same `count` cases of a strategy for every part and law."""
    cases: list[Any] = []
    _search(drawn, cases.append, count)
    return tuple(cases)


def _search(drawn: Callable[[], Any], ask: Callable[[Any], None], count: int) -> None:
    hypothesis = needed("hypothesis")
    settings = hypothesis.settings(
        max_examples=count, database=None, derandomize=True, deadline=None,
        suppress_health_check=list(hypothesis.HealthCheck), report_multiple_bugs=False,
    )  # fmt: skip

    def search(case: Any) -> None:
        ask(case)

    settings(hypothesis.given(drawn())(search))()


def verdict(law: Law, part: Any, examples: int = 100) -> Verdict:
    """Ask `part` whether it keeps `law` in the cases known and in as many drawn `examples`."""
    worst, fault, counterexample = 0.0, "", ""

    def ask(case: Any) -> None:
        nonlocal worst, fault, counterexample
        said = ""
        try:
            amount = float(law.amount(part, case.changed() if hasattr(case, "changed") else case))
        except Unusable as error:
            amount, said = math.inf, str(error)
        except (Exception, SystemExit) as error:
            amount, said = math.inf, f"raises {raised(error)}"
        amount = math.inf if math.isnan(amount) else amount
        worst = max(worst, amount)
        if amount > law.tolerance:
            fault, counterexample = said or f"by {amount:.3g} there", shown(case)
            raise BrokenLaw

    drawn = () if law.drawn is None else drawn_cases(law.drawn, examples)
    for case in (*drawn, *law.known):
        with suppress(BrokenLaw):
            ask(case)
    if fault and law.drawn is not None:  # that of a smaller case
        # BrokenLaw: as it should be. Flaky: a part that remembers
        with suppress(BrokenLaw, needed("hypothesis").errors.Flaky):
            _search(law.drawn, ask, examples)
    return Verdict(law, worst, fault, counterexample)


def check(part: Any, laws: Iterable[Law], examples: int = 100) -> list[Verdict]:
    """Raise `BrokenLaw` for the first of `laws` that `part` breaks; else the verdicts, with the worst value of each."""
    found = []
    for law in laws:
        found.append(verdict(law, part, examples))
        found[-1].check(name_of(part))
    return found


def raised(error: BaseException) -> str:
    """An error in one line, with the innermost line of code outside of this package."""
    own = str(Path(alloc.__file__).parent)
    frames = [
        f
        for f in traceback.extract_tb(error.__traceback__)
        if not f.filename.startswith((own, "<"))
    ]
    place = f" in line {frames[-1].lineno} of {Path(frames[-1].filename).name}" if frames else ""
    return f"{type(error).__name__}: {' '.join(str(error).split()) or 'no message'}{place}"


def shown(case: Any) -> str:
    """A case as one could type it."""
    if isinstance(case, Known):
        return f"{shown(case.problem)}, by hand {list(case.exact)}"
    if not isinstance(case, AllocationProblem):
        return str(case)
    given = {one.name: getattr(case, one.name) for one in fields(case) if one.init}
    words = [
        f"{name}={np.asarray(value).tolist()}"
        for name, value in given.items()
        if value is not None and (name, value) != ("slip", True)
    ]
    return f"AllocationProblem({', '.join(words)})"


def brief(value: Any) -> str:
    """A value as a message shows it."""
    text = " ".join(repr(value).split())
    return f"{text if len(text) < 60 else text[:60] + ' ...'} ({type(value).__name__})"


def parametrize_with_checks(
    parts: Iterable[Any], laws: Callable[[Any], Iterable[Law]] | None = None, examples: int = 100
) -> Any:
    """Decorator of a test of pytest with the arguments `part` and `check`, which calls `check(part)`: once per part and law.

    `parts`: rules; or parts of another kind with `laws`, which gives the laws of one.
    """
    pytest = needed("pytest")

    def checking(law: Law) -> Callable[[Any], None]:
        return lambda part: verdict(law, part, examples).check(name_of(part))

    return pytest.mark.parametrize(
        ("part", "check"),
        [
            pytest.param(one, checking(law), id=f"{name_of(one)}-{law.name.replace(' ', '-')}")
            for one in parts
            for law in (laws or laws_of_rule)(one)
        ],
    )


def name_of(part: Any) -> str:
    """The name of a part, or that of its class or function."""
    return str(getattr(part, "name", None) or getattr(part, "__name__", type(part).__name__))


# Problems: random ones, and those whose answers are known.


GRID = 2.0**-13
"""Coefficients are multiples of this, so that sums of them are exact."""
EXPECTED = 1400 * GRID
"""The plan of random problems, 0.171: near that of 3.0 km/h/s."""


def problems(largest: int = 8, bounded: bool = True, growing: bool = False) -> Any:
    """Hypothesis strategy of problems of 1 to `largest` units.

    Caps are any, near the plan, tied, all below or above it, all zero; with `growing` they grow along the train. `bounded`:
    also masses up to 1000:1, torque limits (0 and inf among them), limits in force, rates of change, what is delivered, and
    the truth, each in half of the problems.
    """
    st = needed("hypothesis").strategies
    plan = round(EXPECTED / GRID)

    @st.composite
    def drawn(draw: Any) -> AllocationProblem:
        n = draw(st.integers(1, largest))
        coefficient = st.integers(0, 2 * plan).map(lambda k: GRID * k)

        def each(value: Any) -> Floats:
            return np.array(draw(st.lists(value, min_size=n, max_size=n)), dtype=float)

        cap = each(
            draw(
                st.sampled_from([
                    coefficient,
                    st.integers(plan - 200, plan + 200).map(lambda k: GRID * k),
                    st.sampled_from([GRID * (plan + k) for k in (-64, 0, 32, 64)]),
                    st.integers(0, plan).map(lambda k: GRID * k),
                    st.integers(plan, 2 * plan).map(lambda k: GRID * k),
                    st.just(EXPECTED),
                    st.just(0.0),
                ])
            )
        )  # fmt: skip
        given: dict[str, Any] = {}
        if bounded:
            rate = st.one_of(coefficient, coefficient.map(lambda x: x / 8), st.just(math.inf))
            fields_of = {
                "mass": st.integers(0, 3000).map(lambda k: 10.0 ** (k / 1000.0)),
                "limit_max": st.one_of(coefficient, st.just(math.inf), st.just(0.0)),
                "previous": coefficient,
                "delivered": coefficient,
                "truth": coefficient,
            }
            given = {name: each(value) for name, value in fields_of.items() if draw(st.booleans())}
            if "previous" in given and draw(st.booleans()):
                given["rate"] = draw(rate) if draw(st.booleans()) else each(rate)
        return AllocationProblem(np.sort(cap) if growing else cap, EXPECTED, **given)

    return drawn()


class Known(NamedTuple):
    """A problem whose answers were worked out by hand."""

    problem: AllocationProblem
    exact: tuple[float, ...]
    """Limits at the exact level."""
    greedy: tuple[float, ...] | None = None
    """Limits of the reference rule; None where it takes no account of what bounds the units."""


_GROWTH = np.array([-0.016, -0.001, 0.010, 0.014, 0.017, 0.020, 0.022, 0.024])
_A = AllocationProblem([0.150, 0.165, 0.176, 0.180, 0.183, 0.186, 0.188, 0.190], 0.170)
_B_CAPS = (0.130, 0.145, 0.156, 0.160, 0.163, 0.166, 0.168, 0.170)
_B = AllocationProblem(_B_CAPS, 0.170)
KNOWN: dict[str, Known] = {
    # deficit 0.020 + 0.005; car 3 as the candidate: 6 x 0.006 = 0.036 is enough; exactly, 6 (L - 0.170) = 0.025
    "Fig. 6 (a)": Known(_A, (0.150, 0.165, *(0.170 + 0.025 / 6,) * 6), (0.150, 0.165, *(0.176,) * 6)),
    "Fig. 6 (b)": Known(_B, _B_CAPS, _B_CAPS),
    # the reference takes the first cap in the rear that is enough: it depends on the order
    "order": Known(AllocationProblem([0.15, 0.2, 0.185], 0.17), (0.15, 0.18, 0.18), (0.15, 0.2, 0.185)),
    "ties": Known(AllocationProblem([0.10, 0.25, 0.25, 0.25], 0.20), (0.1, *(0.7 / 3,) * 3), (0.1, 0.25, 0.25, 0.25)),
    "caps at the plan": Known(AllocationProblem([0.125] * 3, 0.125), (0.125,) * 3, (0.125,) * 3),
    "caps that just give the plan": Known(AllocationProblem([0.3, 0.1], 0.2), (0.3, 0.1), (0.3, 0.1)),
    "zero caps": Known(AllocationProblem([0.0, 0.0], 0.2), (0.0, 0.0), (0.0, 0.0)),
    "a zero cap": Known(AllocationProblem([0.0, 0.5, 0.6], 0.2), (0.0, 0.3, 0.3), (0.0, 0.5, 0.5)),
    "one unit": Known(AllocationProblem([0.1], 0.2), (0.1,), (0.1,)),
    # unit 1 lacks 2 x 0.05, the others make it up by 0.05 each
    "heavy front": Known(AllocationProblem([0.12, 0.3, 0.3], 0.17, mass=[2.0, 1.0, 1.0]), (0.12, 0.22, 0.22)),
    # 1000 x 0.0001 is what the light unit carries beyond the plan
    "mass 1000:1": Known(AllocationProblem([0.1699, 0.3], 0.17, mass=[1e3, 1.0]), (0.1699, 0.27)),
    "limits 0 and inf": Known(
        AllocationProblem([0.3, 0.3, 0.3], 0.1, limit_max=[0.0, math.inf, math.inf]), (0.0, 0.15, 0.15)
    ),
    "rates": Known(
        AllocationProblem([0.14, 0.20, 0.25], 0.17, previous=[0.17] * 3, rate=[0.05, 0.01, 0.02]), (0.14, 0.18, 0.19)
    ),
    "caps prevail over rates": Known(
        AllocationProblem([0.05, 0.30], 0.17, previous=[0.17] * 2, rate=0.02), (0.05, 0.19)
    ),
    "rates that hold more than the plan": Known(
        AllocationProblem([0.5, 0.15], 0.125, previous=[0.25, 0.25], rate=0.05), (0.2, 0.15)
    ),
    "lower bounds that just give the plan": Known(
        AllocationProblem([0.5, 0.5], 0.125, previous=[0.25] * 2, rate=0.125), (0.125, 0.125)
    ),
}  # fmt: skip
"""By name; Fig. 6 is that of JP5484215."""


# Laws of rules. Amounts are shares of the plan.


def usable(rule: Rule, problem: AllocationProblem) -> Allocation:
    """The rule's answer to `problem`; raises `Unusable` where it is no allocation."""
    answer = rule(problem)
    if fault := fault_of(answer, problem):
        raise Unusable(fault)
    return answer


def _told(rule: Rule, problem: AllocationProblem) -> AllocationProblem:
    """What `rule` takes the caps from: the truth where it needs it."""
    return problem.changed(cap=problem.available) if rule.needs_truth else problem


def _apart(problem: AllocationProblem, one: Any, other: Any) -> float:
    return float(np.max(np.abs(np.asarray(one) - other), initial=0.0)) / problem.expected


def _beyond(problem: AllocationProblem, limit: Floats, box: tuple[Floats, Floats]) -> float:
    return float(max(np.max(box[0] - limit), np.max(limit - box[1]))) / problem.expected


def _differ(problem: AllocationProblem, one: Allocation, other: Allocation) -> float:
    """How far two answers that should be one lie apart; inf where case or status differ."""
    same = (one.case, one.status) == (other.case, other.status)
    return _apart(problem, one.limit, other.limit) if same else math.inf


def _answer(rule: Rule, problem: AllocationProblem) -> float:
    answer = usable(rule, problem)
    shortfall = max(problem.expected - answer.effort(problem), 0.0)
    return abs(answer.unmet - shortfall) / problem.expected


def _without_slip(rule: Rule, problem: AllocationProblem) -> float:
    answer = usable(rule, problem.changed(slip=False))
    if answer.case != "none" or answer.unmet != 0.0:
        raise Unusable(
            f"answers case {answer.case!r} with {answer.unmet} unmet while nothing slips"
        )
    return _apart(problem, answer.limit, problem.expected)


def _torque_and_rate(rule: Rule, problem: AllocationProblem) -> float:
    # a cap that fell faster than the rate allows to follow prevails
    box = _told(rule, problem).box[0], problem.rate_box[1]
    return _beyond(problem, usable(rule, problem).limit, box)


def _from_rest(rule: Rule, problem: AllocationProblem) -> float:
    rest = _told(rule, problem.changed(previous=None, rate=None))
    answer = usable(rule, rest)
    beyond = _beyond(rest, answer.limit, rest.box)
    return min(beyond, answer.excess(rest) / rest.expected)


def _case(rule: Rule, problem: AllocationProblem) -> float:
    judged, case = _told(rule, problem), usable(rule, problem).case
    spare = float(np.average(judged.box[1] - judged.expected, weights=judged.weight))
    # on the verge of the plan rounding decides, but for equal masses: their sums are exact
    wrong = case != CASES[1 + judged.within_reach]
    verge = problem.mass is not None and abs(spare) < 1e-11 * judged.expected
    return abs(spare) / judged.expected + 1e-6 if wrong and not verge else 0.0


def _untouched(rule: Rule, problem: AllocationProblem) -> float:
    asked = problem.changed()
    names = [one.name for one in fields(asked)] + ["weight", "in_force", "obtained", "available"]
    before = {name: np.array(getattr(problem, name), dtype=object) for name in (*names, "box")}
    [getattr(asked, name) for name in before]
    usable(rule, asked)
    for name, value in before.items():
        if not np.array_equal(np.array(getattr(asked, name), dtype=object), value):
            raise Unusable(f"changes {name} of the problem; work on a copy")
    return 0.0


def _repeated(rule: Rule, problem: AllocationProblem) -> float:
    first = usable(rule, problem.changed())
    limit = np.array(first.limit)
    usable(rule, problem.changed(cap=np.asarray(problem.cap)[::-1] * 0.75))
    again = usable(rule, problem.changed())
    return max(_differ(problem, first, again), _apart(problem, first.limit, limit))


THREADS = 8


def _in_threads(rule: Rule, problem: AllocationProblem) -> float:
    share = [(1 + k) / THREADS for k in range(THREADS)]
    asked = [
        problem.changed(cap=np.asarray(problem.cap) * s, mass=problem.weight * np.linspace(s, 1.0, problem.n))
        for s in share
    ]  # fmt: skip
    found: list[Any] = [None] * THREADS
    together = threading.Barrier(THREADS)

    def take(k: int) -> None:
        together.wait()
        try:
            found[k] = usable(rule, asked[k])
        except (Exception, SystemExit) as error:  # a thread that dies is not noticed
            found[k] = error

    threads = [threading.Thread(target=take, args=(k,)) for k in range(THREADS)]
    often = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(often)
    for one in found:
        if isinstance(one, BaseException):
            raise one
    return max(_differ(problem, one, usable(rule, p)) for one, p in zip(found, asked, strict=True))


def _scaled_masses(rule: Rule, problem: AllocationProblem) -> float:
    one = usable(rule, problem)
    others = (usable(rule, problem.changed(mass=problem.weight * k)) for k in (1024.0, 1 / 1024.0))
    return max(_apart(problem, one.limit, other.limit) for other in others)


def _known(rule: Rule, known: Known) -> float:
    answer = usable(rule, known.problem)
    apart = _apart(known.problem, answer.limit, known.exact)
    if rule.promise == "reference" and known.greedy is not None:
        apart = min(apart, _apart(known.problem, answer.limit, known.greedy))
    return apart


def _as_near(rule: Rule, problem: AllocationProblem) -> float:
    """In the box, not short of what it allows, and no more beyond that than the reference rule."""
    judged = _told(rule, problem)
    answer, reference = usable(rule, problem), GREEDY(judged)
    effort, most = answer.effort(judged), max(reference.effort(judged), judged.attainable)
    outside = max(judged.attainable - effort, effort - most) / judged.expected
    return max(outside, _beyond(judged, answer.limit, judged.box))


def _in_the_box(rule: Rule, problem: AllocationProblem) -> float:
    judged = _told(rule, problem)
    return _beyond(judged, usable(rule, problem).limit, judged.box)


def _sum(rule: Rule, problem: AllocationProblem) -> float:
    judged = _told(rule, problem)
    return abs(usable(rule, problem).effort(judged) - judged.attainable) / judged.expected


def _optimal(rule: Rule, problem: AllocationProblem) -> float:
    judged = _told(rule, problem)
    found = optimality(judged, usable(rule, problem))
    # the lightest unit may have to bear alone what the sum is not exact by
    scale = judged.expected * float(judged.weight.mean() / judged.weight.min())
    return max(found.worst, found.gap) / scale


def _compiled(rule: Rule, problem: AllocationProblem) -> float:
    """The law called as in a run: without rates, and what it fills are the limits in force that it reads."""
    asked = problem.changed(rate=None)
    answer, cap = usable(rule, asked), _told(rule, asked).cap
    *arrays, plan = units_of(asked)
    units = Units._make((*map(np.array, arrays), plan))
    _, reached = rule.law(units, plan, units.previous)
    if CASES[1 + bool(reached)] != answer.case:
        raise Unusable(f"the law says reached = {reached}, the answer case {answer.case!r}")
    # a law may keep units at the plan, or let them search, beyond their caps
    return _apart(asked, np.minimum(units.previous, cap), np.minimum(answer.limit, cap))


def _status(rule: Rule, problem: AllocationProblem) -> float:
    status = usable(rule, problem).status
    if status != "ok":
        raise Unusable(f"has status {status!r}")
    return 0.0


def _reversed(rule: Rule, problem: AllocationProblem) -> float:
    """The other way round and rotated by one unit."""

    def turned(value: Any) -> Any:
        return np.roll(np.asarray(value)[::-1], 1) if np.ndim(value) else value

    arrays = (one.name for one in fields(problem) if one.init)
    other = problem.changed(**{name: turned(getattr(problem, name)) for name in arrays})
    limit = turned(usable(rule, problem).limit)
    return _apart(problem, limit, usable(rule, other).limit)


_plain = partial(problems, bounded=False)
_growing = partial(problems, bounded=False, growing=True)
_EVERY = tuple(one.problem for one in KNOWN.values())
_EXACT, _REFERENCE, _HEURISTIC, _ = PROMISES
_PLAIN_ANSWERS, _BOUNDED_ANSWERS = (
    tuple(one for one in KNOWN.values() if (one.greedy is None) is bounded) for bounded in (False, True)
)  # fmt: skip
RULE_LAWS = (
    Law("answer", "one finite limit per unit, case, status, and what the limits lack", _answer, problems, _EVERY),
    Law("without slip", "every limit is the plan", _without_slip, problems),
    Law("torque and rate", "no limit is beyond what motors and its rate allow", _torque_and_rate, problems, _EVERY),
    Law("from rest", "limits beyond a cap add up to the plan at most", _from_rest, problems, _EVERY, _HEURISTIC),
    Law("case", "A where the caps do not allow more than the plan, B where they do", _case, _plain, (_A, _B)),
    Law("inputs untouched", "the problem is as before", _untouched, problems),
    Law("repeatable", "one problem has one answer, whatever is asked between", _repeated, problems, tolerance=0.0),
    Law("threads", f"{THREADS} threads get the answers that one gets", _in_threads, problems),
    Law("compiled law", "it asks of every unit, up to its cap, what the answer asks", _compiled, problems, _EVERY),
    Law("scale of masses", "only ratios of masses count", _scaled_masses, problems, _EVERY),
    Law("known answers", "those by hand", _known, None, _PLAIN_ANSWERS, _REFERENCE),
    Law("reference", "in the box, no less than it allows, no more than `greedy`", _as_near, _growing, (_A, _B), _REFERENCE),
    Law("known answers, bounded", "those by hand", _known, None, _BOUNDED_ANSWERS, _EXACT),
    Law("in the box", "no limit is beyond cap, torque and rate", _in_the_box, problems, _EVERY, _EXACT),
    Law("attainable sum", "the mean limit is the plan, or as near as the box allows", _sum, problems, _EVERY, _EXACT),
    Law("optimal", "conditions of optimality, and the gap to the exact level", _optimal, problems, _EVERY, _EXACT),
    Law("case of the box", "A where the box does not allow more than the plan, else B", _case, problems, _EVERY, _EXACT),
    Law("status", '"ok"', _status, problems, _EVERY, _EXACT),
    Law("order of units", "units in another order have their own limits", _reversed, problems, _EVERY, _EXACT),
)  # fmt: skip


def laws_of_rule(rule: Rule) -> list[Law]:
    """The laws that `rule` promises to keep."""
    place = PROMISES.index(rule.promise)
    laws = [law for law in RULE_LAWS if PROMISES.index(law.promise) >= place]
    return [law for law in laws if law.amount is not _compiled or rule.law is not None]


def check_rule(
    rule: Rule | Callable[[AllocationProblem], Allocation],
    promise: str | None = None,
    examples: int = 100,
) -> list[Verdict]:
    """Raise `BrokenLaw` for the first law that `rule` breaks; else the verdicts, with the worst value of each law.

    `promise`: one of `PROMISES` in place of the rule's own. `examples`: random problems per law.
    """
    rule = rule if isinstance(rule, Rule) else Rule(name_of(rule), "", rule)
    rule = rule.promising(promise) if promise else rule
    return check(rule, laws_of_rule(rule), examples)


class Measured(NamedTuple):
    """A rule beside the exact level and the reference rule, over random problems of 8 units of equal mass."""

    gap: float
    """Mean distance from the exact limits, root mean square over units, as a share of the plan."""
    over_delivery: float
    """Mean of what the limits ask beyond the plan, as a share of it."""
    reference_gap: float
    """That distance of the reference rule."""
    time: float
    """Median time of a call [s]."""


def measured(rule: Rule, count: int = 200) -> Measured:
    """Ask `rule` about `count` problems whose caps grow by JP5484215 Fig. 6 from a drawn level, with scatter."""
    draw, rows = np.random.default_rng(1), []
    for _ in range(count):
        cap = EXPECTED * draw.uniform(0.9, 1.1) + _GROWTH + draw.normal(0.0, 0.005, _GROWTH.size)
        problem = AllocationProblem(cap, EXPECTED)
        started = time.perf_counter()
        answer = rule(problem)
        took = time.perf_counter() - started
        limits = (answer.limit, GREEDY(problem).limit)
        gap, reference = (
            np.sqrt(np.mean((x - EXACT(problem).limit) ** 2)) / EXPECTED for x in limits
        )
        rows.append((gap, answer.excess(problem) / EXPECTED, reference, took))
    gap, over, reference, _ = np.mean(rows, axis=0).tolist()
    return Measured(gap, over, reference, float(np.median([row[-1] for row in rows])))
