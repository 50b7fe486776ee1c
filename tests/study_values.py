"""What a study, the comparison or a measurement computes, by the cells that `docs/numbers.toml` names."""

import json
import math
import operator
import re
from collections.abc import Mapping, Sequence
from functools import reduce
from importlib import import_module
from pathlib import Path
from typing import Any

import pandas as pd

from studies.comparison.summary import Grid, make_grid, summarise, to_json
from studies.core.run import run_cells
from studies.core.statement import column_interval
from studies.core.store import Store
from studies.core.study import find_study, study_folder
from studies.scenario.scenario import default_scenarios, load_scenario
from tests.numbers import OVER_ROWS, Source

DIGITS = 8
"""Significant digits that are stored."""


class StudyValues:
    """What a source computed: statements or lines of a comparison by name, and the table, which is all of a measurement."""

    def __init__(self, source: Source, folder: Path, jobs: int) -> None:
        self.source = source
        if source.compared is not None:
            self.table = run_cells(_grid(source.compared).jobs(), Store(folder), jobs)
            rows = json.loads(to_json(summarise(self.table), {}))["rows"]
            self.named = {
                f"{row['scenario']}/{row['rule']}/{row['controller']}": row["metrics"]
                | {f"{name}, less alone": value for name, value in row["differences"].items()}
                for row in rows
            }
            return

        if source.module is not None:
            self.table = import_module(source.module).measured(**source.settings)
            self.table["status"] = "ok"
            self.named = {}
            return

        study = find_study(source.study)
        events = study.default_events if source.events is None else source.events
        where = study_folder(folder, source.study)
        self.table = study.run(where, events, source.seed, jobs, **source.settings)
        found = [one.content() for one in study.statements(self.table)]
        self.named = {
            one["name"]: one["numbers"] | {"statement": one | {"words": _words(one)}}
            for one in found
        }

    def __call__(self, cell: str) -> list[Any]:
        """Values of a cell."""
        _, name, *rest = cell.split(" | ")
        last, _, factor = rest[0 if name in OVER_ROWS else -1].partition(" * ")
        times = float(factor or 1.0)
        if name in OVER_ROWS:
            chosen = self._rows(rest[1:]).astype({last: float})
            if chosen.empty:
                raise ValueError(f"{cell!r}: no row is so; what was left out is printed above")
            if name == "interval":
                found = column_interval(chosen, last, times)
                return [_kept(one, cell) for one in (found.value, found.low, found.high)]
            return [_kept(float((times * chosen[last]).agg(name)), cell)]
        try:
            number = reduce(operator.getitem, rest[:-1], self.named[name])
            found = [number[part] for part in last.split(", ")]
        except KeyError as error:
            raise KeyError(
                f"{cell!r} has no {error}; {list(self.named.get(name, self.named))}"
            ) from None
        found = [
            "; ".join(one) or "none" if isinstance(one, tuple | list) else one for one in found
        ]
        return [
            one if isinstance(one, str) else _kept(times * (math.nan if one is None else one), cell)
            for one in found
        ]

    def _rows(self, conditions: Sequence[str]) -> pd.DataFrame:
        """Rows that are ok and meet `column=value` or `column!=value`, several of them after `; `."""
        table = self.table[self.table["status"] == "ok"]
        for condition in [one for part in conditions for one in part.split("; ")]:
            column, sign, value = re.fullmatch(r"(\w+)(!?=)(.*)", condition).groups()  # type: ignore[union-attr]
            compare = operator.eq if sign == "=" else operator.ne
            table = table[compare(table[column].astype(str), value)]
        return table


def _grid(options: Mapping[str, Any]) -> Grid:
    """The grid of `readhesion compare` with these options."""
    names = options.get("scenario")
    scenarios = default_scenarios() if names is None else [load_scenario(one) for one in names]
    return make_grid(
        scenarios, options.get("rules"), options.get("controllers"), options.get("seeds")
    )


def _words(statement: Mapping[str, Any]) -> str:
    return statement["verdict"] + (", fragile" if statement["fragile"] else "")


def _kept(value: float, cell: str) -> float:
    if not math.isfinite(value):
        raise ValueError(f"{cell!r} is {value}")
    return float(f"{value:.{DIGITS}g}")
