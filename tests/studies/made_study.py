"""A study of nothing: its cells wait, one of them fails, one may kill its worker."""

import os
import signal
import time

import pandas as pd

from studies.runner.study import Cell, Row, Study

FAILS, KILLS = 13, 20


def run(k: int, pause: float, kill: bool) -> Row:
    """The number again."""
    time.sleep(pause)
    if kill and k == KILLS:
        os.kill(os.getpid(), signal.SIGKILL)
    if k == FAILS:
        raise ValueError("unlucky")
    return {"value": float(k), "pid": os.getpid()}


def make(pause: float = 0.0, kill: bool = False, label: str = "") -> Study:
    """The study, of cells that wait `pause` [s]."""

    def cells(events: int, seed: int) -> list[Cell]:
        return [
            Cell(f"cell {k}", (k, pause, kill), {"k": k, "label": label}) for k in range(events)
        ]

    def table(rows: pd.DataFrame) -> pd.DataFrame:
        return rows[["k", "value"]]

    return Study("made", "what a runner survives", cells, run, table)
