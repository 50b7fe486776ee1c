"""Laws of all claims over the tables made for the tests: what is frozen is judged, and each row decides its own verdict."""

import sys
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import pytest

import studies.core.claims as engine
from studies.core.claims import AT_LEAST, AT_MOST, Claim, decisive, meets, names_in
from studies.core.statement import CONDITIONS, FAILS, HOLDS
from studies.core.study import all_studies
from tests.results_hash import SYNTHETIC
from tests.studies.blended_tables import blended_table
from tests.studies.test_effects_study import effects_table
from tests.studies.test_jp4209318 import ensemble_table
from tests.studies.test_log_round_trip import table as log_table

TABLES = {
    **SYNTHETIC,
    "blended": ("blended", blended_table),
    "effects": ("effects", effects_table),
    "log-accuracy": ("log-accuracy", log_table),
    "slide-calibration": ("slide-calibration", ensemble_table),
}
WITH_CLAIMS = sorted(name for name, (study, _) in TABLES.items() if all_studies()[study].claims)
SOME = (
    "headroom", "line-position", "brake-force", "differences", "sanders", "readhesion", "calibration",
)  # fmt: skip
"""Studies whose table has some of what is claimed; all that is judged is among what is frozen all the same."""
MOST = 2
"""Claims of a study that are pushed, drawn with a seed."""


@dataclass
class Judged:
    """What a study gives its judges."""

    families: list
    claims: list
    conjunctions: list


@pytest.fixture
def judged(monkeypatch):
    """Function that gives what a study's statements are judged from, with few resamples."""
    monkeypatch.setattr("studies.core.claims.RESAMPLES", 2)
    last = []
    real = {"family": engine.family, "conjunction": engine.conjunction}

    def family(*groups, **how):
        # the numbers beside the claims decide nothing
        groups = [
            (events, [replace(one, numbers={}) for one in claims]) for events, claims in groups
        ]
        found = last[-1]
        found.families.append((groups, how))
        found.claims += [claim for _, claims in groups for claim in claims]
        return real["family"](*groups, **how)

    def conjunction(events, claim, *args, **how):
        found = last[-1]
        found.claims.append(claim)
        found.conjunctions.append((events, replace(claim, numbers={}), args, how))
        return real["conjunction"](events, claim, *args, **how)

    def of(label):
        name, made = TABLES[label]
        study = all_studies()[name]
        folder = study.judge.__module__.rpartition(".")[0]
        for other in [one for one in sys.modules if one.startswith(f"{folder}.")]:
            for own in real:
                monkeypatch.setattr(f"{other}.{own}", locals_of[own], raising=False)
        print(label)  # a failure shows it
        last.append(Judged([], [], []))
        study.statements(made())
        return last[-1]

    locals_of = {"family": family, "conjunction": conjunction}
    return of


def test_what_is_judged_is_what_is_frozen(judged):
    for label in WITH_CLAIMS:
        frozen = all_studies()[TABLES[label][0]].claimed()
        assert len({claim.name for claim in frozen}) == len(frozen)
        known = {claim.name: decisive(claim) for claim in frozen}
        claims = judged(label).claims
        if label not in SOME:
            assert {
                claim.name: decisive(claim) for claim in claims if claim.mean or claim.cases
            } == known
        leaves = [decisive(leaf) for claim in frozen for leaf in claim.leaves]
        assert all(decisive(leaf) in leaves for claim in claims for leaf in claim.leaves)


def test_every_bound_has_a_reason():
    def reasons(claim):
        own = [claim.reason] if claim.mean else []
        return own + [one for leaf in (*claim.cases, *claim.besides) for one in reasons(leaf)]

    for label in WITH_CLAIMS:
        assert all(all(reasons(claim)) for claim in all_studies()[TABLES[label][0]].claimed())


def test_a_mean_pushed_over_its_threshold_flips_that_verdict_and_no_other(judged):
    for label in WITH_CLAIMS:
        for groups, how in judged(label).families:  # conjunctions have a law of their own
            before = {one.name: one for one in engine.family(*groups, **how)}
            pairs = [(k, claim) for k, (_, claims) in enumerate(groups) for claim in claims]
            chosen = np.random.default_rng(0).permutation(len(pairs))[:MOST]
            pushed = 0
            for k, claim in (pairs[j] for j in chosen):
                events, column = groups[k][0], column_of(claim, groups[k][0])
                for claimed in (True, False):
                    other = pushed_over(events, claim, column, claimed)
                    if other is None:
                        continue
                    pushed += 1
                    changed = [
                        (other if frame is events else frame, claims) for frame, claims in groups
                    ]
                    found = {one.name: one for one in engine.family(*changed, **how)}
                    whole = found[claim.name].test
                    above = whole.estimate.value > claim.value
                    assert above == (claimed == (claim.side != AT_MOST)), claim.name
                    assert whole.p_holm < 0.05, claim.name
                    assert (
                        found[claim.name].holds if claimed else found[claim.name].verdict != HOLDS
                    )
                    for frame, claims in groups:
                        for one in claims:
                            if frame is not events or column not in told_of(one):
                                assert found[one.name].verdict == before[one.name].verdict, (
                                    claim.name,
                                    one.name,
                                )
            assert pushed > len(chosen)


def test_a_bound_of_a_conjunction_that_is_missed_is_said_and_nothing_else_changes(judged):
    for label in WITH_CLAIMS:
        found = judged(label)
        pushed = 0
        for events, claim, args, how in found.conjunctions:
            before = engine.conjunction(events, claim, *args, **how)
            if before.verdict != HOLDS:
                continue
            for k, leaf in enumerate(claim.leaves):
                if claim.alike and k == 0:  # the others are to be as it is
                    continue
                other = missed(events, claim, leaf)
                if other is None:
                    continue
                pushed += 1
                events_now, column = other
                after = engine.conjunction(events_now, claim, *args, **how)
                if not (claim.mean and k == 0):
                    assert any(text.startswith(f"not {leaf.name}") for text in after.conditions), (
                        leaf.name
                    )
                alike = [one.name for one in claim.leaves if column in told_of(one)]
                said = [
                    text.removeprefix("not shown ").removeprefix("not ")
                    for text in after.conditions
                ]
                if claim.mean and claim.show and claim.name in alike:  # it says its own number
                    said = said[1:]
                assert all(text.startswith(tuple(alike)) for text in said), leaf.name
                needed = len(claim.leaves) - len(claim.besides)
                wanted = CONDITIONS if k >= needed or (claim.some and needed > 1) else FAILS
                if len(alike) == 1 and not how.get("partly"):
                    assert after.verdict == wanted, leaf.name
        for events, claim, args, how in found.conjunctions:
            before = engine.conjunction(events, claim, *args, **how)
            if claim.each and before.verdict == HOLDS and len(events) > 1:
                pushed += 1
                first = claim.bearing(events).index[0]
                changed = (with_value(events, first, *how) for how in far(events, claim.mean))
                other = next(
                    one
                    for one in changed
                    if not meets(claim, float(claim.values(one).astype(float).loc[first]))
                )
                after = engine.conjunction(other, claim, *args, **how)
                assert after.conditions == (f"not {events.loc[first, claim.each]}",)
                some = claim.some or how.get("partly")
                assert after.verdict == (CONDITIONS if some else FAILS)
        assert found.families or pushed


def far(events, mean):
    """Columns that a mean names, each with values of which one is on the other side of any threshold."""
    for column in dict.fromkeys(name for name in names_in(mean) if name in events):
        if set(events[column].dropna()) <= {True, False}:
            yield from ((column, value) for value in (False, True))
        elif pd.api.types.is_numeric_dtype(events[column]):
            yield from ((column, value) for value in (1e9, -1e9, 0.0, 1.0))


def with_value(events, row, column, value):
    other = events.astype({column: bool if isinstance(value, bool) else float})
    other.loc[row, column] = value
    return other


def missed(events, claim, leaf):
    """The events with a column changed so that a bound is clearly missed, and that column; None where none does it."""
    columns = [name for name in names_in(leaf.mean) if name in events]
    if not leaf.exact and events[columns[0]].dtype != bool:
        side = leaf.side
        if claim.alike:
            side = AT_LEAST if claim.values(events).mean() > 0.0 else AT_MOST
        other = pushed_over(events, replace(leaf, side=side), columns[0], claimed=False)
        return None if other is None else (other, columns[0])
    bear = len(leaf.bearing(claim.bearing(events)))
    for column, value in far(events, leaf.mean):
        other = events.assign(**{column: value})
        own = claim.bearing(other)
        mean = float(leaf.values(own).astype(float).mean())
        if len(leaf.bearing(own)) == bear > 0 and not meets(leaf, mean):
            return other, column
    return None


def column_of(claim: Claim, events: pd.DataFrame) -> str:
    """The first column that a claim's mean names."""
    return next(name for name in names_in(claim.mean) if name in events)


def told_of(claim: Claim) -> Counter:
    """Names in all that decides a claim."""
    texts = [claim.mean, claim.only, *claim.parts.values()]
    texts += [text for one in claim.besides for text in (one.mean, one.only)]
    return Counter(name for text in texts if text for name in names_in(text))


def pushed_over(events, claim, column, claimed):
    """The events with a column changed so that the claim's mean lies clearly on the claimed side, or on the other one."""
    if column in names_in(claim.only or "0") or len(claim.bearing(events)) < 10:
        return None
    values = claim.values(events).astype(float)
    mean, spread = float(values.mean()), float(values.std())
    sign = (1.0 if claimed else -1.0) * (-1.0 if claim.side == AT_MOST else 1.0)
    margin = max(0.1 * abs(claim.value), 3.0 * spread, 1e-3)
    target = claim.value + sign * (claim.tolerance + margin)
    old = events[column].astype(float)

    def changed(new):
        other = events.assign(**{column: new})
        return other, float(claim.values(other).astype(float).mean())

    for more in (1.0 + 0.0 * old, old):  # shifted, or scaled
        times, reached = 0.0, mean
        for _ in range(6):  # sizes do not follow in proportion
            slope = changed(old + (times + 1.0) * more)[1] - reached
            times += (target - reached) / slope if slope else 0.0
            other, reached = changed(old + times * more)
            if abs(reached - target) < 0.3 * margin:
                return other
    other, reached = changed(1.0 + target + 0.0 * old)  # of what is a distance from 1
    return other if abs(reached - target) < 0.3 * margin else None
