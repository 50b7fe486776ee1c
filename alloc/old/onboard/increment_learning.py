"""Learning the increments of adhesion along the train on board, JP5484215 embodiment 2: from reports, during the run.

A datum is the coefficient at a slip of unit j less that of the leader, the foremost unit that works. Every report repeats
the instant of the unit's last detection, so a lost telegram delays a datum, and no datum counts twice. The stored increments
are relative to the foremost unit of all. Where another unit leads, its own increment is added, so a change of the leader
does not change any difference between units.
"""

import math
from dataclasses import astuple, dataclass, fields
from typing import Literal, NamedTuple

import numpy as np

from alloc.old.compilation import equation, inlined_jit, jit
from alloc.old.errors import OnboardError
from alloc.old.onboard.reference_speed import is_relieved
from alloc.old.onboard.telegrams import DETECTED, ESTIMATE
from alloc.old.plant.model import Floats
from alloc.old.records import quantity

NO_LEARNING, RUNNING_MEAN, GAUSSIAN = range(3)
KINDS = {"none": NO_LEARNING, "running-mean": RUNNING_MEAN, "gaussian": GAUSSIAN}
"""Learners by name."""

FOLLOWS = 0.5
"""Share of the command that the leader's torque must reach. Below it, its own coefficient is that of failed motors: the
train learns of the failure only some telegrams later."""


@dataclass(frozen=True)
class IncrementLearning:
    """Whether and how the leader learns the increments.

    Source: JP5484215, embodiment 2, which names no numbers; the values are assumed.
    """

    kind: Literal["none", "running-mean", "gaussian"] = "none"
    """Learner: none, the running mean (16), (17), or a Gaussian posterior per unit. Source: JP5484215 (16), (17); the
    Gaussian one is this project's."""
    reference: Literal["received", "held"] = "received"
    """The leader's coefficient against which a report counts. Received: that when the report arrives; if the leader does not
    slip then, this is what it delivers and not what its rail could carry. Held: that of its own last slip, as long as
    this is in force. Source: JP5484215, par. 0064, says received."""
    first: int = 10
    """Running mean: number of new data of a unit for the first update, N_min."""
    further: int = 5
    """Running mean: number of new data of a unit for each later update, N_arg."""
    stored: float = quantity(10.0, "1")
    """Running mean: number of data for which the increments believed at first count, N_z."""
    noise: float = quantity(0.012, "1")
    """Gaussian: standard deviation by which data scatter. Source: JP5484215, par. 0055, scatter of the rail."""
    deviation: float = quantity(0.010, "1")
    """Gaussian: standard deviation of the prior of each unit about the believed increment, where the belief has no
    `unit_deviation`. Source: assumed: half of the largest increment."""
    drift: float = quantity(0.0, "1")
    """Gaussian: variance added after every datum, so that the train can follow the seasons."""
    update: Literal["run", "next run"] = "run"
    """Running mean: when new data change an increment. Run: as soon as there are enough of them. Next run: before the next
    run, as after several stations. Source: JP5484215, par. 0065, says after several stations."""
    weight: Literal["all", "original"] = "all"
    """Running mean: data that count behind the stored increment, N_z. All: those of earlier updates too, so that later ones
    change it less and less. Original: those of the original table. Source: JP5484215, par. 0067, says original."""

    def __post_init__(self) -> None:
        OnboardError.check_choice("learning", "kind", self.kind, KINDS)
        OnboardError.check_choice("learning", "reference", self.reference, ("received", "held"))
        OnboardError.check_choice("learning", "update", self.update, ("run", "next run"))
        OnboardError.check_choice("learning", "weight", self.weight, ("all", "original"))
        nonnegative = ("stored", "deviation", "drift")
        OnboardError.check("learning", self, ("noise",), nonnegative, infinite=())
        for name in ("first", "further"):
            number = getattr(self, name)
            if not isinstance(number, int) or number < 1:
                raise OnboardError(
                    f"learning: {name} = {number!r} must be a whole number, 1 or greater"
                )


@dataclass(frozen=True)
class LearntIncrements:
    """Increments that a train has learnt so far, one per traction unit from the front; its next run begins with them.

    `increment` over the foremost unit and its `deviation`; `behind`: N_z, the data behind it; `waiting_sum`, `waiting`: sum
    and number of the data that wait for (16); `updates`: how often (17) was used.
    """

    increment: tuple[float, ...]
    deviation: tuple[float, ...]
    behind: tuple[float, ...]
    waiting_sum: tuple[float, ...]
    waiting: tuple[float, ...]
    updates: tuple[float, ...]

    def __post_init__(self) -> None:
        names = [one.name for one in fields(self)]
        if len({len(values) for values in astuple(self)}) > 1:
            raise OnboardError(
                f"learnt increments: {', '.join(names)} must have a number per traction unit each"
            )
        signed = ("increment", "waiting_sum")
        OnboardError.check(
            "learnt increments",
            self,
            nonnegative=[f"{name}[]" for name in names if name not in signed],
            finite=[f"{name}[]" for name in signed],
        )
        if not all(math.isfinite(value) for values in astuple(self) for value in values):
            raise OnboardError("learnt increments: every number must be finite")


class Increments(NamedTuple):
    """As `LearntIncrements`, (units,) each; equal to the believed increments where nothing is learnt."""

    increment: Floats
    deviation: Floats
    behind: Floats
    waiting_sum: Floats
    waiting: Floats
    updates: Floats


class LearningSeries(NamedTuple):
    """What is recorded of learning, (units,) each; a field is a name in `alloc.old.recording.VARIABLES`."""

    increment: Floats
    increment_data: Floats
    increment_datum: Floats


class LearningMemory(NamedTuple):
    """Stored values of the leader on the units' slips, (units,) unless said otherwise."""

    series: LearningSeries
    block: Floats  # (fields, units): the same numbers, to be recorded by one copy
    taken_at: Floats  # instant of the unit's last detection that the leader has heard of [s]


def first_increments(
    learning: IncrementLearning,
    learnt: LearntIncrements | None,
    increment: Floats,
    deviation: tuple[float, ...] | None,
) -> Increments:
    """Initial increments of the leader: the learnt ones, else `increment` (units,) as believed; `deviation` if known.

    Where it learns, increments are those over the foremost unit; otherwise only their differences count.
    """
    if learnt is not None:
        found = Increments(*(np.array(values, dtype=float) for values in astuple(learnt)))
        if learning.kind == "running-mean" and learning.update == "next run":
            for j in range(increment.size):
                update_mean(found, j, learning.first, learning.further, learning.weight == "all")
        return found
    if learning.kind != "none":
        increment = increment - increment[:1]
    empty = np.zeros((4, increment.size))
    empty[0] = learning.stored if learning.kind == "running-mean" else 0.0
    if deviation is not None:
        return Increments(increment, np.array(deviation, dtype=float), *empty)
    spread = np.zeros_like(increment)
    if learning.kind == "gaussian":
        spread[1:] = learning.deviation  # the foremost unit has none over itself
    return Increments(increment, spread, *empty)


def learning_memory(believed: Increments) -> tuple[Increments, LearningMemory]:
    """Memory at the start of a run: copies of what is believed, and no data."""
    block = np.zeros((len(LearningSeries._fields), believed.increment.size))
    block[0], block[2] = believed.increment, np.nan
    series = LearningSeries(*block)
    learnt = Increments(series.increment, *(values.copy() for values in believed[1:]))
    return learnt, LearningMemory(series, block, np.full(believed.increment.size, -np.inf))


@equation
def running_mean(increment, behind, waiting_sum, waiting):
    """(16), (17): the stored increment, `behind` data behind it, after `waiting` new data of the sum `waiting_sum`."""
    mean = waiting_sum / waiting  # (16)
    return (increment * behind + mean * waiting) / (behind + waiting)  # (17)


@jit
def update_mean(k, j, first, further, grows):
    """Change the increment of unit `j` by data that wait, if there are enough; if `grows`, these count behind it then."""
    if k.waiting[j] >= (further if k.updates[j] > 0.0 else first):
        k.increment[j] = running_mean(k.increment[j], k.behind[j], k.waiting_sum[j], k.waiting[j])
        if grows:
            k.behind[j] += k.waiting[j]
        k.waiting_sum[j] = k.waiting[j] = 0.0
        k.updates[j] += 1.0


@equation
def gaussian_posterior(increment, deviation, datum, noise, drift):
    """Posterior mean and standard deviation after a datum that scatters by `noise` about the true increment."""
    prior = deviation**2 + drift
    gain = prior / (prior + noise**2)
    return increment + gain * (datum - increment), ((1.0 - gain) * prior) ** 0.5


@inlined_jit
def take_datum(learning, k, j, datum, leader):
    """Learn from a datum of unit `j`, an increment over the foremost unit of all; `leader`: unit it was compared with."""
    if learning.learner == GAUSSIAN:
        # it is as uncertain as what the leader itself has over the foremost unit
        noise = np.sqrt(learning.noise**2 + k.deviation[leader] ** 2)
        k.increment[j], k.deviation[j] = gaussian_posterior(
            k.increment[j], k.deviation[j], datum, noise, learning.drift
        )
        k.behind[j] += 1.0
        return
    k.waiting_sum[j] += datum
    k.waiting[j] += 1.0
    if learning.at_once:
        update_mean(k, j, learning.first, learning.further, learning.grows)


@inlined_jit
def _leader_knows(st, m, time):
    """Whether the leader has a coefficient to compare with; while it is blind, relieved or failed it finds none."""
    first = m.lead.unit[0]
    if st.learning.held:
        return time - m.lead.detected[0] <= st.hold_time
    asked = m.unit.torque_command[first]
    able = m.unit.axles_seen[first] > 0.0 and not is_relieved(m, first)
    return able and asked != 0.0 and m.torque[first] / asked >= FOLLOWS


@inlined_jit
def learn_increments(st, m, time):
    """Take the detections of all reports that arrived since the last period; own slips cause an allocation too.

    A detection older than the hold time is no datum. Nor is one that arrives while the leader has no coefficient.
    """
    first, knows = m.lead.unit[0], _leader_knows(st, m, time)
    reference = m.lead.estimate[0] if st.learning.held else m.unit.coefficient_estimate[first]
    for j in range(m.cap.size):
        reports = m.report.own if j == first else m.report.line.read
        if not reports[j, DETECTED] > m.learning.taken_at[j]:
            continue
        m.learning.taken_at[j] = reports[j, DETECTED]
        if j == first:
            continue
        m.lead.allocate[0] = True
        if knows and time - reports[j, DETECTED] <= st.hold_time:
            datum = reports[j, ESTIMATE] - reference + m.learnt.increment[first]
            m.learning.series.increment_data[j] += 1.0
            m.learning.series.increment_datum[j] = datum
            take_datum(st.learning, m.learnt, j, datum, first)
