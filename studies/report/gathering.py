"""All data of a page, from the results folder, or run where it lacks them."""

from functools import partial
from pathlib import Path

from studies.comparison.grid import Grid
from studies.core.cell import OnRow
from studies.core.own_parts import try_parts
from studies.core.runner import run_cells
from studies.core.store import Store
from studies.core.workers import Workers
from studies.report.gains import drawn_gains, gains_of
from studies.report.page import Material
from studies.report.replay import ReplayCell, replays_of

REPLAYS = "replays"
"""Folder of the results in which what is replayed is kept."""


def gather(
    grid: Grid, results: Path, command: str, workers: Workers | None = None, on_row: OnRow | None = None
) -> Material:  # fmt: skip
    """The comparison and a replay of each of its lines on the first seed; runs that `results` lacks are made and stored."""
    table = run_cells(
        grid.jobs(),
        Store(results),
        workers,
        on_row=on_row,
        check=partial(try_parts, grid.rules, grid.controllers),
    )
    cells = wanted(grid)
    rows = run_cells(cells, Store(results / REPLAYS), workers, on_row=on_row)
    replays = replays_of(cells, rows)
    controllers = (*grid.controllers, *grid.once)
    gains = [*gains_of(table, replays), *drawn_gains(results, grid.rules, controllers)]
    return Material(grid, table, replays, gains, command)


def wanted(grid: Grid) -> list[ReplayCell]:
    """Runs to replay: on the first seed, rule by rule, so that what a full page leaves out are whole rules."""
    first = [job for job in grid.jobs() if job.seed == grid.seeds[0]]
    return [ReplayCell(job) for job in sorted(first, key=lambda job: grid.rules.index(job.rule))]
