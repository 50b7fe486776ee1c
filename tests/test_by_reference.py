"""Records by reference: compiled code sees the fields of the `NamedTuple`, shares its arrays, and keeps its types apart."""

import copy
import gc
import pickle
from typing import NamedTuple

import numpy as np
import pytest

from alloc.compilation import jit
from alloc.records import LINE, ByReference, LaidOut, Made


class Inner(NamedTuple):
    values: np.ndarray
    count: int
    on: bool
    nothing: None = None


class Outer(NamedTuple):
    factor: float
    inner: Inner
    grid: np.ndarray
    index: np.ndarray


@jit
def _read(record, out):
    inner = record.inner
    out[0] = record.factor
    out[1] = inner.count
    out[2] = 1.0 if inner.on else 0.0
    out[3] = inner.values[record.index[1]]
    out[4] = record.grid[1, 2]
    out[5] = record.grid.shape[0] + 10 * record.grid.shape[1] + 100 * record.grid.size
    out[6] = record.grid[1][0]
    out[7] = record[0] + inner[1]
    inner.values[0] = -7.0
    record.grid[0, 1] += 0.5


def _outer(**changes):
    values = {
        "factor": 0.25,
        "inner": Inner(np.arange(4.0), -3, True),
        "grid": np.arange(6.0).reshape(2, 3),
        "index": np.array([0, 2]),
    }
    return Outer(**(values | changes))


@pytest.mark.parametrize("on", [True, False, np.bool_(True)])
def test_fields_are_those_of_the_tuple(on):
    record = _outer(inner=Inner(np.arange(4.0), -3, on))
    by_value, by_reference = np.zeros(8), np.zeros(8)
    _read(ByReference(record), by_reference)
    assert (record.inner.values[0], record.grid[0, 1]) == (-7.0, 1.5), "arrays are shared"
    _read(record, by_value)
    np.testing.assert_array_equal(by_reference, by_value)
    expected = [0.25, -3.0, float(on), 2.0, 5.0, 2 + 30 + 600, 3.0, 0.25 - 3.0]
    np.testing.assert_array_equal(by_reference, expected)


def test_python_reads_the_same_fields():
    record = _outer()
    assert ByReference(record).inner is record.inner
    with pytest.raises(AttributeError, match="absent"):
        _ = ByReference(record).absent


def test_records_of_records_by_reference_are_flat():
    inside = ByReference(Inner(np.arange(4.0), 5, False))
    out = np.zeros(8)
    _read(ByReference(_outer(inner=inside)), out)
    assert (out[1], out[2]) == (5.0, 0.0)


def test_equal_fields_are_one_type_and_others_are_not():
    """A type must not be taken for another whose fields lie elsewhere: the wrong memory would be read."""
    kind = ByReference(_outer()).kind
    assert ByReference(_outer(factor=9.0, grid=np.ones((5, 5)))).kind == kind
    for changes in (
        {"factor": 1}, {"grid": np.zeros(6)}, {"index": np.zeros(2)},
        {"inner": Inner(np.zeros(1, dtype=np.int64), 1, True)}, {"inner": Inner(np.zeros(1), 1.0, True)},
    ):  # fmt: skip
        assert ByReference(_outer(**changes)).kind != kind


def test_arrays_live_as_long_as_the_record():
    record = ByReference(_outer(inner=Inner(np.arange(1e6), 1, True), index=np.array([0, 999_999])))
    gc.collect()
    out = np.zeros(8)
    _read(record, out)
    assert out[3] == 999_999.0


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"grid": np.ones((4, 4)).T[1:]}, "Outer.grid: the array is not contiguous"),
        ({"index": "text"}, "Outer.index: str is neither number, array nor record"),
        ({"inner": Inner(np.zeros(1), [1], True)}, "Inner.count: list is neither"),
    ],
)
def test_what_cannot_be_handed_over_is_named(changes, said):
    with pytest.raises(TypeError, match=said):
        ByReference(_outer(**changes))


def test_a_record_laid_out_once_is_given_afresh_each_time():
    block = np.arange(6.0).reshape(2, 3)
    made = LaidOut(_outer(inner=Inner(block[1], 7, True), grid=block))
    first, second = made.fresh(), made.fresh()
    assert first.kind == second.kind == ByReference(_outer()).kind
    before = [np.array(values) for values in (block, second.grid, second.index)]
    outs = np.zeros((2, 8))
    _read(first, outs[0])
    assert (first.inner.values[0], first.grid[1, 0]) == (-7.0, -7.0), "rows overlap their block"
    assert first.grid[0, 1] == 1.5
    for values, kept in zip((block, second.grid, second.index), before, strict=True):
        np.testing.assert_array_equal(values, kept, err_msg="a copy of its own")
    _read(second, outs[1])
    expected = np.zeros(8)
    _read(ByReference(_outer(inner=Inner(block[1], 7, True), grid=block)), expected)
    np.testing.assert_array_equal(outs, [expected, expected])
    addresses = [array.ctypes.data for array in (first.grid, first.index, second.grid)]
    assert not np.any(np.array(addresses) % LINE)


def test_what_is_made_once_stays_behind_in_copies():
    made, calls = Made(), []
    for _ in range(2):
        assert made.once("key", lambda: calls.append(1) or len(calls)) == 1
    assert (made.once("other", lambda: 2), calls) == (2, [1])
    assert pickle.loads(pickle.dumps(made)) == copy.deepcopy(made) == {}
