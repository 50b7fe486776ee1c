"""Where the lead of the MPC comes from: its parts exchanged one by one, and differences over the same events.

Search and horizon of "mpc" and of "perturb-observe" in every pairing, and less of each; units act alone on the population.
"""

from dataclasses import replace
from functools import cache

import pandas as pd

from alloc.evaluation.metrics import evaluate
from alloc.onboard.columns import ONE
from alloc.onboard.controllers import CONTROLLERS, Controller
from alloc.onboard.controllers.creep import CREEP_ROW, pi_creep
from alloc.onboard.controllers.search import PERTURB_ROW, perturb_observe
from alloc.onboard.signatures import control
from alloc.run.simulation import simulate
from alloc.schema.tables import Column, Table
from mpc.plan import plan_torques, torque_scale
from mpc.unit import MPC, PROBLEM_ROW, command_torque, memory_of, pose_problem
from studies import run_cell
from studies.files.scenario import Scenario
from studies.population import population
from studies.runner.study import Cell, Row, Study
from studies.standing import Statistic

COLUMNS = {
    "adhesion used [points]": Statistic("bound_use", 2, 100.0),
    "wheel damage Q [kJ]": Statistic("damage", 0),
    "torque fluctuation [% of plan]": Statistic("torque_fluctuation", 2, 100.0),
    "jerk [m/s3]": Statistic("jerk_rms", 2),
}
WHOLE = "mpc"
"""What its exchanges are compared with."""


def _join_memories(name: str, part: str) -> Table:
    """The MPC's memory with that of another controller beside it."""
    return Table(name, **MPC.columns, other=Column(memory_of(part), ONE, f"memory of {part}"))


ABOVE_PI = _join_memories("above pi", "pi-creep")
CLIMBS = _join_memories("climbs", "perturb-observe")
ABOVE_PI_ROW, CLIMBS_ROW, MPC_ROW = ABOVE_PI.dtype, CLIMBS.dtype, MPC.dtype


@control
def search_above_pi(unit, axles, memory, run):
    """The MPC's slip limit is held by the PI control that all other searches have."""
    m = memory.view(ABOVE_PI_ROW)[0]
    if pose_problem(unit, axles, m, run):
        held = m.other.view(CREEP_ROW)[0]
        held.reference = m.problem.view(PROBLEM_ROW)[0].limit
        pi_creep(unit, axles, m.other, run)
    else:
        command_torque(unit, axles, m, False, run)


@control
def climbing_above_horizon(unit, axles, memory, run):
    """The slip that perturb-observe seeks is the limit of the MPC's problem."""
    m = memory.view(CLIMBS_ROW)[0]
    perturb_observe(unit, axles, m.other, run)
    sought, b = m.other.view(PERTURB_ROW)[0], m.problem.view(PROBLEM_ROW)[0]
    solved = pose_problem(unit, axles, m, run)
    if solved:
        b.limit = sought.reference
        solved = plan_torques(m, b, run.period)
    command_torque(unit, axles, m, solved, run)
    wanted = unit.torque_target
    sought.share = unit.torque_command / wanted if wanted > 0.0 else 1.0


@control
def invert_line(unit, axles, memory, run):
    """The torque at which the believed line would hold the slip limit at once: no horizon, and no feedback of the slip."""
    m = memory.view(MPC_ROW)[0]
    b = m.problem.view(PROBLEM_ROW)[0]
    solved = pose_problem(unit, axles, m, run)
    if solved:
        held = b.coefficient * (1.0 + b.elasticity * (b.limit - b.pair_slip) / b.pair_slip)
        turning = b.inertia * b.acceleration / (b.radius * b.radius)
        wanted = (held * b.load - b.air + turning) * b.radius / b.gear / torque_scale(b)
        m.torques[0] = min(max(wanted, 0.0), b.upper / torque_scale(b))
    command_torque(unit, axles, m, solved, run)


@cache
def exchange_parts() -> dict[str, Controller]:
    """Controllers with parts of "mpc" and of "perturb-observe", by what they are."""
    whole = CONTROLLERS["mpc"]
    return {
        "solved by CasADi": CONTROLLERS["mpc-casadi"],
        "perturb-observe": CONTROLLERS["perturb-observe"],
        "climbing of perturb-observe above the horizon": replace(
            whole, name="climbs", control=climbing_above_horizon, memory=CLIMBS
        ),
        "own search above PI": replace(
            whole, name="above pi", control=search_above_pi, memory=ABOVE_PI
        ),
        "own search above the believed line, inverted": replace(
            whole, name="inverts", control=invert_line
        ),
        "horizon of 2": whole.tuned(horizon=2),
        "no swing": whole.tuned(swing=1e-6, loud=0.0),
    }


def cells(events: int, seed: int) -> list[Cell]:
    """Each event under the MPC and under every exchange."""
    return [
        Cell(f"{event.name}/{part}", (event, part, k), {"scenario": event.name, "part": part})
        for k in range(events)
        for event in [population.event(seed, k)]
        for part in (WHOLE, *exchange_parts())
    ]


def run(scenario: Scenario, part: str, k: int) -> Row:
    """What is measured of one event where units act alone."""
    controller = CONTROLLERS[WHOLE] if part == WHOLE else exchange_parts()[part]
    metrics = evaluate(simulate(run_cell.event_of(scenario, k), "alone", controller))
    return {column.metric: metrics[column.metric] for column in COLUMNS.values()}


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Means of the MPC, and of the others what they have more, event by event."""
    good, lines, whole = run_cell.complete(rows), [], None
    for part in (WHOLE, *exchange_parts()):
        runs = good[good["part"] == part].set_index("scenario")
        line: Row = {"part": part, "events": len(runs)}
        lines.append(line | {name: column.text(runs, whole) for name, column in COLUMNS.items()})
        whole = runs if whole is None else whole
    return pd.DataFrame(lines)


QUESTION = "Which part of the MPC gives its lead over a search by perturb and observe?"
STUDY = Study("mpc_parts", QUESTION, cells, run, table, events=100, seed=population.SEED)
