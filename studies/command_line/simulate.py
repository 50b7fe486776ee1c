"""`readhesion simulate`: one slip event under one rule and one controller."""

import json
import sys
from contextlib import redirect_stdout
from functools import partial
from typing import Annotated

from cyclopts import Parameter

from studies.command_line.options import (
    GREATEST_SEED,
    FilePath,
    Format,
    Whole,
    check_whole,
    command_of,
    console,
)
from studies.files.writable import LOG, MOVING_FIGURE, RUN, check_file

HEADLINES = (
    "bound_use", "headroom", "over_delivery", "acceleration_ratio", "slip_time", "damage", "jerk_rms", "search_time",
)  # fmt: skip
"""What is printed of a run where not all is asked for."""


def simulate(
    scenario: str,
    *,
    rule: str = "greedy",
    controller: str = "cut-and-ramp",
    seed: Whole = 0,
    out: FilePath | None = None,
    log: FilePath | None = None,
    figure: FilePath | None = None,
    every_metric: Annotated[bool, Parameter("--all", negative=())] = False,
    text: Format = None,
    as_json: Annotated[bool, Parameter("--json", negative=())] = False,
) -> None:
    """Run one slip event and print its main metrics.

    Parameters
    ----------
    scenario
        Name of a shipped scenario or path of a TOML file.
    rule
        Allocation rule.
    controller
        Readhesion controller.
    seed
        Seed of the event's random draws, 0 or greater.
    out
        File for the recorded run (netCDF, .nc, or MATLAB, .mat).
    log
        File for a log (csv, parquet or mat) as `readhesion analyse` reads it; the train's data go beside
        it, with the ending .train.toml.
    figure
        File for a figure of the run (pdf, png or svg), or for one that moves (gif).
    every_metric
        Print every metric.
    text
        Print them as CSV, Markdown or LaTeX, and nothing else.
    as_json
        Print JSON with every metric instead of a table.
    """
    from rich.table import Table

    from alloc.metrics import METRICS, evaluate
    from alloc.recording import save
    from alloc.sources import write_whole
    from studies.comparison.summary import check_names
    from studies.comparison.table import as_text, minus
    from studies.core.job import Job, simulate_job
    from studies.core.own_parts import try_parts
    from studies.logs.simulated import train_beside, write_log
    from studies.scenario.scenario import load_scenario

    chosen = load_scenario(scenario)
    check_names([rule], [controller])
    try_parts([rule], [controller])
    check_whole("--seed", seed, 0, GREATEST_SEED)
    beside = None if log is None else train_beside(log)
    for path, endings in ((out, RUN), (log, LOG), (beside, (".toml",)), (figure, MOVING_FIGURE)):
        check_file(path, endings)
    job = Job(chosen, rule, controller, seed)
    with redirect_stdout(sys.stderr):  # a part of one's own may print; stdout is for results
        run = simulate_job(job)
        values = evaluate(run)
    if out is not None:
        write_whole(out, partial(save, run))
    if log is not None:
        write_log(run, chosen.event(seed).model.train, log)
    if figure is not None:
        from studies.core.gallery import gallery

        parts = {"rule": [rule], "controller": [controller], "seed": [str(seed)]}
        gallery().draw_run(run, figure, job, command_of("simulate", scenario, **parts))
    if as_json:
        about = {"scenario": chosen.name, "rule": rule, "controller": controller, "seed": seed}
        numbers = {name: None if value != value else value for name, value in values.items()}
        print(json.dumps({**about, "metrics": numbers}, indent=2, allow_nan=False))
        return
    head = ["metric", "value", "unit", "meaning"]
    rows = [
        (name, values[name], METRICS[name].unit.removeprefix("1"), METRICS[name].description)
        for name in (values if every_metric else HEADLINES)
    ]
    if text is not None:
        print(as_text(text, "lrll", head, rows), end="")
        return
    table = Table(title=f"{chosen.name}: {rule}, {controller}, seed {seed}", title_justify="left")
    for heading in head:
        table.add_column(heading, justify="right" if heading == "value" else "left")
    for name, value, unit, meaning in rows:
        table.add_row(name, "–" if value != value else minus(f"{value:.4g}"), unit, meaning)
    console().print(table)
    if not every_metric:
        console().print(f"{len(values) - len(HEADLINES)} more metrics: --all")
