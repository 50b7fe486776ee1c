"""JP H07-322414 with readings that its studies do not have: commanded values to learn from, position by ground coils.

`docs/numbers.toml` takes sentences and the table of docs/running-resistance.md from here.
"""

from dataclasses import replace

import numpy as np
import pandas as pd

from alloc.estimation.running_resistance import RunLog, Source, learn_from_log
from alloc.onboard.line_memory import CoilCounter, PositionDetector
from studies.resistance import events, line_position_study
from studies.resistance.driven_cases import (
    CARS,
    EXACT,
    FEEDBACK,
    FILTER_TIME,
    RIGHT,
    SPEED_NOISE,
    SQUARES,
    CaseRun,
    drive_case,
    learners,
)
from studies.resistance.routes import Route

SPACINGS = (1.0, 10.0, 100.0)
"""Between ground coils [m]; assumed."""
SOURCES: tuple[Source, ...] = ("measured", "commanded")


def learnt(of: Route, done: CaseRun, source: Source, seed: int) -> dict[str, float]:
    """Relative errors of W1 and W3 that least squares leave on a run: measured speed with noise, or commanded values."""
    log = RunLog.of_run(done.run, SPEED_NOISE, seed)
    speed, rate = of.command.at(log.time)
    learner = learners(of)[SQUARES]
    learn_from_log(
        replace(log, commanded_speed=speed, commanded_acceleration=rate), of.memory(), learner,
        of.train.rotating_mass, FILTER_TIME, of.length, source,
    )  # fmt: skip
    off = learner.weights / of.true_weights() - 1.0
    return {"air": float(off[0]), "mass": float(abs(off[2]))}


def sources_rows(seed: int, event: int) -> list[dict[str, object]]:
    """What is learnt from either source on a route of the sweep `resistance`, under feedback alone and true feedforward."""
    drawn = events.draw(seed, event)
    of, noise = events.drawn_route(drawn), 1000 * seed + 10 * event
    signals = PositionDetector(speed_noise=SPEED_NOISE, seed=noise)
    rows: list[dict[str, object]] = []
    for case in (FEEDBACK, EXACT):
        done = drive_case(of, case, drawn["control"], detector=signals)
        rows += [{"reading": one, "case": case, **learnt(of, done, one, noise)} for one in SOURCES]
    return rows


def coils_row(seed: int, event: int, spacing: float) -> dict[str, object]:
    """Peaks of the speed on a route of the sweep `line-position`, over those of the feedback alone; 0: true signals."""
    drawn = line_position_study.draw(seed, event)
    counter = CoilCounter(spacing) if spacing else None
    signals = PositionDetector(counter, 0.0, SPEED_NOISE, 1000 * seed + 10 * event)
    peaks = {}
    for case in (FEEDBACK, RIGHT, CARS):
        done = drive_case(drawn.route, case, drawn.control, detector=signals)
        found = events.felt(drawn.route, done, case, line_position_study.LEAD)
        peaks[case] = np.array(
            [found[events.column("speed_peak", kind, case)] for kind in line_position_study.KINDS]
        )
    return {
        "reading": f"{spacing:g} m",
        "one": float((peaks[RIGHT] / peaks[FEEDBACK]).mean()),
        "cars": float((peaks[CARS] / peaks[FEEDBACK]).mean()),
    }


def measured(events: int, seed: int) -> pd.DataFrame:
    """A row per event and reading."""
    rows: list[dict[str, object]] = []
    for event in range(events):
        own = [*sources_rows(seed, event), *(coils_row(seed, event, x) for x in (0.0, *SPACINGS))]
        rows += [{"event": event} | row for row in own]
    return pd.DataFrame(rows)
