"""The readhesion paper's limit cycle, simulated beside what the reduced model predicts of it."""

import math
from collections.abc import Sequence

import pandas as pd

from alloc.plant.sets import find_set
from studies.readhesion_paper.limit_cycle import LimitCycle, ReducedModel, growth, reduced_model
from studies.readhesion_paper.paper import CALIBRATED, CASE_A, COMMAND, Case, Unprinted, assess

NO_CYCLE = LimitCycle(math.nan, (math.nan, math.nan), (math.nan, math.nan))


def paper_model(
    width: float = CASE_A.width, limit: float = CASE_A.limit, unprinted: Unprinted = CALIBRATED
) -> ReducedModel:
    """The loop of the readhesion paper, a_w in its numbers, on a rail of mu_lim, with a_0 of its case A."""
    table = unprinted.table(CASE_A.margin, width)
    train, acceleration = find_set("one-axle"), COMMAND.accelerations[0]
    return reduced_model(train, table, unprinted.curve, limit, acceleration)


def compare_cycles(
    widths: Sequence[float],
    limits: Sequence[float],
    jobs: int = 1,
    unprinted: Unprinted = CALIBRATED,
) -> pd.DataFrame:
    """Limit cycles simulated and predicted, a row per a_w and mu_lim in their order.

    Columns: those of `studies.readhesion_paper.paper.assess`, with predicted_period [s], predicted_slip_swing [m/s] and
    predicted_torque_swing (share of the plan); nan where there is no cycle.
    """
    cases = [Case(width=width, limit=limit) for width in widths for limit in limits]
    table = assess(unprinted, cases, jobs)
    models = [paper_model(case.width, case.limit, unprinted) for case in cases]
    cycles = [model.limit_cycle() or NO_CYCLE for model in models]
    swings = [(c.torque[1] - c.torque[0]) / m.target for c, m in zip(cycles, models, strict=True)]
    return table.assign(
        predicted_period=[cycle.period for cycle in cycles],
        predicted_slip_swing=[cycle.slip[1] - cycle.slip[0] for cycle in cycles],
        predicted_torque_swing=swings,
    )


def growth_over_widths(widths: Sequence[float], unprinted: Unprinted = CALIBRATED) -> list[float]:
    """`growth` of the paper's loop for each a_w in its numbers."""
    models = [paper_model(width, unprinted=unprinted) for width in widths]
    return [growth(model.table, model.lag, model.gain) for model in models]
