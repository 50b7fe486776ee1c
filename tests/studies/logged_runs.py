"""Logs of simulated runs, each made once, which tests of logs spoil, and what is wrong with the reading of a spoilt one."""

from functools import cache
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from alloc.metrics import METRICS
from alloc.plant.sets import find_set
from alloc.plant.train import Coupler, Train
from alloc.simulation import simulate
from studies.core.job import Job, simulate_job
from studies.ladder.events import scenario as drawn_start
from studies.logs.mapping import Mapping, column_of
from studies.logs.measured_log import MeasuredLog, check_log
from studies.logs.measured_run import Findings, analyse_run
from studies.logs.report import fit_remarks
from studies.logs.simulated import log_table, rounded
from studies.logs.train import MeasuredTrain
from studies.scenario.scenario import load_scenario
from studies.stops.blended_events import scenario as drawn_stop
from studies.stops.wsp_acceptance_study import stop_of
from tests.simulation.slides import CLEANED_RAIL, TRAIN, braked, driven, readhering

SHARE, SLIPS = 0.02, 2
"""Error of Q, as a share, and of the number of slips, within which a reading is right."""


class Logged(NamedTuple):
    """A run and its log without a defect."""

    run: xr.Dataset
    model: Train
    train: MeasuredTrain
    table: pd.DataFrame
    damage: float
    """Q by the simulator [J]."""

    def found(
        self, table: pd.DataFrame, mapping: Mapping | None = None
    ) -> tuple[MeasuredLog, Findings]:
        log = check_log(table, self.train, "log", mapping)
        return log, analyse_run(log.run, log.train)


def _run_of(name: str) -> tuple[xr.Dataset, Train]:
    """A run by name: one of `tests.simulation.slides`, a drawn one, or a scenario and its seed."""
    if name == "braked":  # three cars whose wheels slide and readhere
        return braked(readhering, rail=CLEANED_RAIL), TRAIN
    if name == "coupled":
        train = TRAIN.coupled(Coupler())
        return braked(readhering, train=train, rail=CLEANED_RAIL), train
    if name == "driven":  # eight cars whose wheels run away; their trailers roll freely
        return driven(), find_set("commuter-8car")
    if name == "locomotive":  # before wagons without sensors
        event = drawn_start(50, 2).event(0)
        return simulate(event, "alone", "perturb-observe"), event.model.train
    if name == "long stop":
        event = stop_of(find_set("jp4209318-3car"), "slip-ratio", 0.05, 60.0 / 3.6).event
        return simulate(event, "alone", "none"), event.model.train
    if name == "patch":  # cars that meet a wet patch under the patent's rule
        scenario = load_scenario("wet-patch")
        run = simulate_job(Job(scenario, "greedy-literal", "cut-and-ramp", 0))
        return run, scenario.event(0).model.train
    what, _, number = name.rpartition(" ")
    seed, rule, controller = int(number), "cooperative", "perturb-observe"
    if what in ("hill", "crawl"):
        draw, of = (drawn_stop, 211) if what == "hill" else (drawn_start, 307)
        scenario, seed = draw(of, seed), 0
        controller = {"crawl 18": "mpc", "hill 1": "cut-and-ramp"}.get(name, controller)
    else:
        scenario = load_scenario(what)
        if what == "wet-stop":
            rule, controller = "greedy", "cut-and-ramp"
    run = simulate_job(Job(scenario, rule, controller, seed))
    return run, scenario.event(seed).model.train


@cache
def logged(name: str) -> Logged:
    run, model = _run_of(name)
    every = max(round(0.01 / float(np.median(np.diff(run["time"])))), 1)
    table = rounded(log_table(run, model, every))
    damage = 1e3 * METRICS.find("damage").function(run)
    return Logged(run, model, MeasuredTrain.of(model), table, damage)


@cache
def clean(name: str) -> tuple[MeasuredLog, Findings]:
    return logged(name).found(logged(name).table)


def said(log: MeasuredLog, found: Findings) -> list[str]:
    """All remarks, each with its kind."""
    return [f"{one.kind}: {one.text}" for one in [*log.remarks, *fit_remarks(log, found)]]


def misread(
    name: str, table: pd.DataFrame, words: str = "", share: float = SHARE, slips: int | None = SLIPS
) -> str:
    """What is wrong with the reading of a spoilt log; "" where Q and slips are right and `words` are said.

    `share`, `slips`: error of Q and of the number of slips that is right; None: slips are not counted.
    """
    log, found = logged(name).found(table)
    wrong, remarks = [], said(log, found)
    q = found.total_damage / logged(name).damage - 1.0
    if not abs(q) <= share:
        wrong.append(f"Q {100.0 * q:+.1f} %, stated {found.errors.total / logged(name).damage:.1%}")
    if slips is not None:
        more = len(found.events) - len(clean(name)[1].events)
        if abs(more) > slips:
            wrong.append(f"{more:+d} slips")
    if words and not any(words in one for one in remarks):
        wrong.append(f"not said: {words!r}, but {remarks}")
    if not np.isfinite([found.errors.total, log.run.rim_deviation.max()]).all():
        wrong.append("errors are not finite")
    return ", ".join(wrong)


def at_contact(one: Logged) -> pd.DataFrame:
    """The log with forces between wheel and rail in place of those at the rim."""
    every = round(len(one.run["time"]) / len(one.table))
    rail = one.run["rail_force"].values[::every].T
    return one.table.assign(
        **{column_of("axleN_force", i, "kn"): 1e-3 * force for i, force in enumerate(rail, 1)}
    )
