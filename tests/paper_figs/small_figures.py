"""Small runs, made-up tables, and every figure from them; each run is computed when a figure first asks.

Figures that need no run have stored pictures: marks, lines and colours, without letters, for these differ between versions
of FreeType; other tests read the text. Tables are made up, so a picture changes where the drawing changes and not where a
run does. `python -m pytest tests/paper_figs/test_every_figure.py --mpl-generate-path tests/paper_figs/pictures` stores them
anew: look at each before you keep it.
"""

import io
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.text import Text

from alloc.plant.train import Coupler
from paper_figs.brakes import FAULT, faulty_car, member_runs, slide_control
from paper_figs.controllers import DROP_EVENT, DROPPED, adhesion_drop, curve_of
from paper_figs.drawing import FIGURES
from paper_figs.events import sharing_wanders, slip_event
from paper_figs.lines import late_passages, line_position, real_line
from paper_figs.logs import measured_log
from paper_figs.readhesion_paper import (
    CASES,
    HALF_SLIP,
    SETS,
    half_slip,
    limit_cycle,
    readhesion_factor,
    readhesion_slip,
    readhesion_torque,
    readhesion_trajectory,
)
from paper_figs.replay import slip_replay
from paper_figs.saving import MovingFigure
from paper_figs.style import STYLE_FILE
from studies.brake_force.faulty_car import allocated_stops
from studies.core.job import Job, simulate_job
from studies.lines.line_run import run_line
from studies.logs.measured_log import check_log
from studies.logs.measured_run import MeasuredTrain, analyse_run
from studies.logs.simulated import log_table
from studies.readhesion_paper.limit_cycle_comparison import compare_cycles
from studies.readhesion_paper.paper import CALIBRATED, RIVAL, run_cases
from studies.report.replay import drawing
from studies.scenario.scenario import load_scenario
from studies.slides.jp4209318 import CALIBRATED as DEMONSTRATION
from studies.slides.jp4209318 import brake, brake_event
from tests.simulation.slides import TRAIN, braked, readhering
from tests.studies.blended_tables import blended_table
from tests.studies.brake_tables import brake_table
from tests.studies.example_lines import EXAMPLE_PATH, example_stock, short_route
from tests.studies.headroom_tables import headroom_table
from tests.studies.ladder_tables import curve_table, ladder_table
from tests.studies.made_tables import (
    SCENARIOS,
    comparison_table,
    falling,
    sander_table,
    slide_table,
    sweep_table,
    synthetic,
)
from tests.studies.mismatch_tables import mismatch_table
from tests.studies.position_tables import position_table
from tests.studies.sweep_tables import claim_table, difference_table
from tests.studies.test_equal_effort_study import effort_table
from tests.studies.test_information_study import information_table
from tests.studies.test_robustness_study import robustness_table

DPI = 50


def learning_table() -> pd.DataFrame:
    """Errors that fall from station to station, of two trains."""
    return synthetic(falling, trains=2)


def six_events() -> pd.DataFrame:
    """A comparison with enough events for an interval over them, and enough seeds for one over these."""
    return comparison_table(seeds=5, scenarios=(*SCENARIOS, "four", "five", "six"))


def solver_times() -> pd.DataFrame:
    """Times of a solver of each kind [ms], the fastest last."""
    names = ("fatrop", "QP by daqp", "compiled step")
    return pd.DataFrame({"time": [50.0, 2.0, 0.1], "time_p99": [80.0, 3.0, 0.3]}, names)


TABLES = {
    "allocation-bars": (), **dict.fromkeys(("rule-comparison", "rule-events"), (six_events,)),
    "ladder": (ladder_table,), "curves": (curve_table,), "headroom": (headroom_table,), "mismatch": (mismatch_table,),
    "information": (information_table,), "robustness": (robustness_table,), "mpc-times": (solver_times,),
    "equal-effort": (effort_table,),
    "differences": (difference_table,), "brake-cut-out": (brake_table,), "learning": (learning_table,),
    **dict.fromkeys(("claim-verdicts", "claim-verdicts-search"), (lambda: claim_table(60),)),
    "adhesion-curve": (), "open-rails": (), "model": (),
    **dict.fromkeys(("slide-pareto", "slide-electric"), (slide_table,)),
    **dict.fromkeys(("margin-sweep", "width-sweep", "downhill"), (sweep_table,)),
    "blended": (blended_table,), "sanders": (sander_table,),
}  # fmt: skip
"""Figures that have a picture, and what makes their tables."""


def from_tables(name: str) -> Figure:
    """A figure of its made-up tables."""
    return FIGURES[name](*(make() for make in TABLES[name]))


def without_letters(drawn: Figure) -> Figure:
    """The same figure, whose text is no longer seen."""
    for text in drawn.findobj(Text):
        text.set_visible(False)
    return drawn


def pixels(drawn: Figure) -> np.ndarray:
    """The figure as it would be stored, (height, width, 3)."""
    file = io.BytesIO()
    with mpl.rc_context(fname=STYLE_FILE):
        without_letters(drawn).savefig(file, dpi=DPI)
    file.seek(0)
    return (255 * mpl.image.imread(file)[..., :3]).astype(np.uint8)


OTHER = replace(DEMONSTRATION, front_adhesion=0.1)


@cache
def runs():
    scenario = load_scenario("very-low-adhesion").changed(duration_s=3.0)
    return [simulate_job(Job(scenario, rule, "cut-and-ramp", 0)) for rule in ("alone", "exact")]


@cache
def drops():
    """Runs of the adhesion drop until shortly after it."""
    scenario = load_scenario(DROP_EVENT).changed(duration_s=8.0)
    return [simulate_job(Job(scenario, "alone", one, 0)) for one in DROPPED]


@cache
def cases():
    """Cases A and B of the readhesion paper in both units at a tenth of its resolution."""
    return [
        run_cases(one, tuple(CASES.values()), recovers=True, step=5e-4) for one in SETS.values()
    ]


@cache
def half_slips():
    """The case just below the plan under each set."""
    return [
        run_cases(unprinted, [HALF_SLIP], recovers=True, step=5e-4) for unprinted in SETS.values()
    ]


@cache
def logged():
    """A log with a gap that is too long to be filled in, of coupled cars that slide."""
    train = TRAIN.coupled(Coupler())
    table = log_table(
        braked(readhering, train=train, rail=DEMONSTRATION.rail(), duration=24.0), train, 5
    )
    log = check_log(table.drop(index=range(60, 280)), MeasuredTrain.of(train), "log")
    return log, analyse_run(log.run, log.train)


@cache
def line_run():
    return run_line(EXAMPLE_PATH, example_stock())


@cache
def faulty_stops():
    return allocated_stops(FAULT, 0)


def a_train():
    """What the train of `runs` is drawn from."""
    return drawing(load_scenario("very-low-adhesion").event().model)


def few_instants(moving: MovingFigure) -> MovingFigure:
    """The same with fewer instants, so that it is sooner written."""
    moving.motion = moving.motion._replace(instants=3)
    return moving


DRAWN: dict[str, Callable[[], Figure]] = {
    **{name: partial(from_tables, name) for name in TABLES},
    "slip-event": lambda: slip_event(*runs()),
    "slip-replay": lambda: few_instants(slip_replay(a_train(), runs()[1])),
    "adhesion-drop": lambda: adhesion_drop(curve_of(DROP_EVENT), *drops()),
    "sharing-wanders": lambda: sharing_wanders(*runs()),
    "readhesion-slip": lambda: readhesion_slip(*cases()),
    "readhesion-torque": lambda: readhesion_torque(*cases()),
    "readhesion-factor": lambda: readhesion_factor(*cases()),
    "readhesion-trajectory": lambda: readhesion_trajectory(*cases()),
    "half-slip": lambda: half_slip(*half_slips()),
    "limit-cycle": lambda: limit_cycle(
        {one.unit: compare_cycles((0.1, 0.3), (0.13, 0.15), 1, one) for one in (CALIBRATED, RIVAL)},
        (0.3, 0.5),
    ),
    "real-line": lambda: real_line(line_run()),
    "measured-log": lambda: measured_log(*logged()),
    "faulty-car": lambda: faulty_car(
        faulty_stops(), brake_table()[lambda t: t["part"] == "driven"]
    ),
    "line-position": lambda: line_position(
        short_route(), late_passages(short_route()), position_table()
    ),
    "slide-control": lambda: slide_control(
        brake(brake_event(DEMONSTRATION)), member_runs((DEMONSTRATION, OTHER))
    ),
}
"""Every figure by name, and what draws it from small runs."""
