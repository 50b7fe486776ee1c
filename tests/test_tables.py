"""Tables and the cache of compiled code: every column says what it is, and only its owner can change what is run."""

import copy
import pickle
import re

import numpy as np
import pytest

import readhesion
from alloc.compilation import is_private
from alloc.onboard.columns import TABLES, UNIT
from alloc.schema.tables import Column, Table, memory_words
from mpc.problem import BELIEVED, Problem

FACTOR = r"(N|Pa|J|W|kg|km|m|s|h|rad)(-?[1-9])?"
UNITS = re.compile(rf"1|{FACTOR}( {FACTOR})*")
"""Those that udunits reads as meant: it takes the point of a fractional exponent for a product."""
ALL_TABLES = dict.fromkeys((*TABLES, *(one.memory for one in readhesion.CONTROLLERS.values())))


@pytest.mark.parametrize("table", ALL_TABLES, ids=lambda one: one.name)
def test_every_column_has_unit_and_meaning(table):
    for name, column in table.columns.items():
        assert UNITS.fullmatch(column.unit), name
        assert len(column.meaning) >= 4, name
        assert not column.meaning.endswith("."), name


def test_a_name_stands_for_one_recorded_quantity():
    names = [name for one in TABLES for name, column in one.columns.items() if column.recorded]
    assert len(names) == len(set(names))


def test_recorded_columns_are_the_first_words_of_a_row():
    rows = UNIT.rows(3, limit=[0.1, 0.2, 0.3], slipping=[0, 1, 0])
    told = np.ascontiguousarray(memory_words(rows)[:, : UNIT.recorded.itemsize // 8]).view(
        UNIT.recorded
    )
    for name in UNIT.recorded.names:
        np.testing.assert_array_equal(told[name][:, 0], rows[name])


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda kept: pickle.loads(pickle.dumps(kept))])
def test_copies_of_rows_are_rows(copied):
    rows = UNIT.rows(3, limit=[0.1, 0.2, 0.3])
    for kept in (rows, rows[1], UNIT.record(2, 3)):
        made = copied(kept)
        assert type(made) is type(kept)
        assert made.tobytes() == kept.tobytes()
        assert made.dtype == kept.dtype
    problem = Problem(BELIEVED.rows(2))
    np.testing.assert_array_equal(copied(problem).rows, problem.rows)


@pytest.mark.parametrize("name", ["base", "shape", "fill", "mean"])
def test_a_column_cannot_hide_an_attribute_of_rows(name):
    with pytest.raises(TypeError, match=f"no column can be called {name}"):
        Table("own", **{name: Column(0.0, "1", "what it is")})


def test_an_unknown_column_is_told():
    with pytest.raises(TypeError, match="unit: no column limt"):
        UNIT.rows(1, limt=0.2)


def test_a_folder_that_others_can_change_holds_no_code(tmp_path):
    folder = tmp_path / "cache"
    folder.mkdir(mode=0o700)
    tmp_path.chmod(0o700)
    assert is_private(folder)
    folder.chmod(0o770)
    assert not is_private(folder)
    folder.chmod(0o700)
    (tmp_path / "link").symlink_to(folder)
    assert not is_private(tmp_path / "link")
    tmp_path.chmod(0o777)
    assert not is_private(folder)
