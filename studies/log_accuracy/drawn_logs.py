"""Drawn runs, the logs that recorders would write of them, and what the analysis makes of each."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from alloc.metrics import METRICS
from alloc.plant.sets import find_set
from alloc.plant.train import Train
from alloc.simulation import simulate
from studies.core.cell import Row
from studies.core.job import Job, simulate_job
from studies.files.study_error import StudyError
from studies.ladder.events import scenario as drawn_start
from studies.log_accuracy.drawn_defects import DEFECTS, Defect, Logged
from studies.log_accuracy.forms import FORMS
from studies.logs.measured_log import MeasuredLog, read_log
from studies.logs.measured_run import Findings, analyse_run
from studies.logs.report import fit_remarks, withheld
from studies.logs.simulated import log_table, rounded
from studies.logs.train import MeasuredTrain
from studies.scenario.scenario import shipped_scenario
from studies.stops.blended_events import scenario as drawn_stop
from studies.stops.wsp_acceptance_study import CURVES, stop_of

STREAM = 41
"""Number that distinguishes the draws from those of other studies."""
LOGS = 8
"""Spoiled logs of a run."""
RULES = ("alone", "cooperative", "exact")
CONTROLLERS = ("cut-and-ramp", "perturb-observe", "mpc")
TRAINS = ("commuter-8car", "gb-unit-8car", "jp4209318-3car")
"""Sets that stop by air brakes and slide protection."""
SHIPPED_STARTS = "long-train", "gradient-start", "freight-start", "uneven-load"
"""Scenarios of starts from rest: sixteen cars, a hill, a locomotive and wagons behind slack couplers, full cars."""
PERIOD = 0.01
"""Of the recorder of the clean log [s]."""
CLEAN, PLAIN = "none", "own names"
TOLERANCE = 0.02
"""Error of Q, as a share, up to which a log is right ..."""
LITTLE = 0.5
"""... or that much [kJ] where Q is little."""
FAULTS, LOCKED = ("delay", "radius", "balance", "sign", "stuck", "faulty"), "a locked wheel"
"""Kinds of remarks that say that figures may be wrong, and what no fault of the log is."""
SLIPS, SHARE_OF_SLIPS = 2, 2.0 / 24.0
"""Slips too many or too few up to which it is right: two, or two of 24."""


def drawn_run(seed: int, k: int) -> tuple[str, xr.Dataset, Train]:
    """Run `k`, its name and its train.

    In turn: a start on a drawn rail, a stop with motors and air, a stop by air and slide protection, and a shipped start
    with a drawn seed. Trains take turns within each: multiple units, sixteen cars, locomotives with wagons or coaches.
    """
    g = np.random.default_rng([seed, k, STREAM])
    kind, number, own_seed = k % 4, k // 4, 0
    if kind == 2:
        train, curve = find_set(str(g.choice(TRAINS))), str(g.choice(list(CURVES)))
        level, speed = float(g.uniform(0.03, 0.09)), float(g.uniform(40.0, 90.0)) / 3.6
        stop = stop_of(train, curve, level, speed).event
        return f"air stop, {curve}, {level:.3f}", simulate(stop, "alone", "none"), stop.model.train
    if kind == 3:
        scenario = shipped_scenario(SHIPPED_STARTS[number % len(SHIPPED_STARTS)])
        own_seed = int(g.integers(1, 1000))
    else:
        scenario = drawn_start(seed, number) if kind == 0 else drawn_stop(seed, number)
    job = Job(scenario, str(g.choice(RULES)), str(g.choice(CONTROLLERS)), own_seed)
    return scenario.name, simulate_job(job), scenario.event(own_seed).model.train


def rows_of(seed: int, k: int, logs: int = LOGS) -> list[Row]:
    """Rows of run `k`: its clean log, and `logs` that are spoiled and written as recorders do.

    Defects take turns over the runs; of two logs one has a drawn form.
    """
    name, run, train = drawn_run(seed, k)
    every = max(1, round(PERIOD / float(np.median(np.diff(run["time"].values)))))
    clean = Logged(rounded(log_table(run, train, every)), MeasuredTrain.of(train), run)
    damage = METRICS.find("damage").function(run)
    own = {
        "run": name,
        "number": k,
        "coupled": clean.train.coupler is not None,
        "damage_simulated": damage,
    }
    rows: list[Row] = []
    slips = np.nan
    for i in range(logs + 1):
        turn = (k * logs + i - 1) % len(DEFECTS)
        defect = CLEAN if i == 0 else list(DEFECTS)[turn]
        g = np.random.default_rng([seed, k, i, STREAM])
        form = str(g.choice(list(FORMS))) if i > 0 and g.random() < 0.5 else PLAIN
        row = own | {"log": i, "defect": defect, "form": form}
        found = _judged(clean, DEFECTS.get(defect), form, g, damage, slips)
        slips = float(found["slips"]) if i == 0 else slips
        rows.append(row | found)
    return rows


def _judged(
    clean: Logged, defect: Defect | None, form: str, g: np.random.Generator, damage: float, slips: float
) -> dict[str, Any]:  # fmt: skip
    """What the analysis says of a log with this defect in this form; `damage` and `slips`: what would be right."""
    table, train, drawn = clean.table, clean.train, ""
    if defect is not None:
        table, train, drawn = defect.spoil(clean, g)
    with tempfile.TemporaryDirectory() as folder:
        path = FORMS[form](table, train.radius, Path(folder) / "log")
        try:
            log = read_log(path, train)
            found = analyse_run(log.run, log.train)
        except StudyError as error:
            return _refused(drawn, defect, str(error).replace(folder, ""))
    if reason := withheld(log, found):
        return _refused(drawn, defect, f"no Q: {reason}")
    return {"drawn": drawn, "refused": False, "proper": 0.0} | _figures(
        log, found, defect, damage, slips
    )


def _refused(drawn: str, defect: Defect | None, said: str) -> dict[str, Any]:
    """Of a log that is refused, or whose Q is withheld: neither right nor silent, proper where the defect is such."""
    proper = float(defect is not None and defect.refusable)
    found = {"drawn": drawn, "refused": True, "proper": proper, "said": said}
    return (
        found
        | dict.fromkeys(("right", "slips_right", "silent"), 0.0)
        | dict.fromkeys(_NUMBERS, np.nan)
    )


_NUMBERS = ("damage", "error", "stated", "slips", "covered", "named", "remarked")


def _figures(
    log: MeasuredLog, found: Findings, defect: Defect | None, damage: float, slips: float
) -> dict[str, Any]:
    remarks = [*log.remarks, *fit_remarks(log, found)]
    kinds = {remark.kind for remark in remarks}
    q = 1e-3 * found.total_damage
    stated = np.nan if found.errors is None else 1e-3 * found.errors.total
    apart, many = abs(q - damage), len(found.events)
    right = apart <= max(TOLERANCE * damage, LITTLE)
    counted = np.isnan(slips) or abs(many - slips) <= max(SLIPS, SHARE_OF_SLIPS * slips)
    covered = bool(apart <= 2.0 * stated)
    named = defect is not None and bool(kinds & defect.named_by)
    remarked = any(remark.kind in FAULTS and LOCKED not in remark.text for remark in remarks)
    return {
        "damage": q,
        "error": apart / max(damage, LITTLE),
        "stated": stated,
        "slips": float(many),
        "right": float(right),
        "slips_right": float(counted),
        "covered": float(covered),
        "named": float(named),
        "remarked": float(remarked),
        "silent": float(not right and not covered and not named and not remarked),
        "said": "; ".join(f"{remark.kind}: {remark.text}" for remark in remarks)[:600],
    }
