"""The table of a study: one flush, opening and reading, with few and with many rows before, all in one run: `make bench`.

100,000 rows; a million with READHESION_FULL=1.
"""

import os
from functools import partial

import numpy as np
import pyarrow as pa
import pytest

from alloc.metrics import METRICS
from studies.core.cell import Key
from studies.core.parts import FULL
from studies.core.store import Store

MANY = 1_000_000 if os.environ.get("READHESION_FULL") else 100_000
FLUSH = 80
"""Rows of two seconds at 40 rows per s."""
NUMBERS = [*METRICS, *(f"measured {k}" for k in range(54 - len(METRICS)))]
TEXTS = {"code_hash": 16 * "c", "scenario_hash": 16 * "5", "scenario": "random-0-0001", "rule": "exact",
         "controller": "cut-and-ramp", "status": "ok", "reason": "", "messages": "{}"}  # fmt: skip
"""As many columns as a row of the sweep `claims` has."""
rng = np.random.default_rng(1)


def columns(first: int, count: int) -> pa.Table:
    numbers = {name: rng.standard_normal(count) for name in NUMBERS}
    texts = {name: count * [text] for name, text in TEXTS.items()}
    cells = {
        "cell": [f"{k * 0x9E3779B97F4A7C15 % 2**64:016x}" for k in range(first, first + count)]
    }
    return pa.table(cells | texts | {"seed": np.arange(count)} | numbers)


@pytest.fixture(scope="module")
def filled(tmp_path_factory):
    """Table by its number of rows."""
    folders = {rows: tmp_path_factory.mktemp(f"rows-{rows}") for rows in (0, MANY)}
    store = Store(folders[MANY])
    for first in range(0, MANY, FULL):
        store.parts.add(columns(first, FULL))
    return folders


@pytest.mark.parametrize("before", [0, MANY])
def test_flush(benchmark, filled, before):
    benchmark.group = f"flush of {FLUSH} rows"
    rows = iter([columns(10**8 + k, FLUSH).to_pylist() for k in range(0, 110 * FLUSH, FLUSH)])
    store = Store(filled[before])
    benchmark.pedantic(lambda: store.add(next(rows)), rounds=100, warmup_rounds=5)


def test_opening(benchmark, filled):
    benchmark.group = f"table of {MANY} rows"
    keys = [Key("", cell, "") for cell in columns(0, 40_000)["cell"].to_pylist()]
    found = benchmark.pedantic(lambda: Store(filled[MANY]).cells(keys), rounds=3)
    assert len(found) == 40_000


def test_reading_of_40000(benchmark, filled):
    benchmark.group = f"table of {MANY} rows"
    store = Store(filled[MANY])
    keys = [Key("", cell, "") for cell in columns(10_000, 40_000)["cell"].to_pylist()]
    store.cells(keys)
    assert len(benchmark.pedantic(partial(store.rows_of, keys), rounds=3)) == 40_000
