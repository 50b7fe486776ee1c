"""What a runner needs of every study that can be asked for by its name."""

import pickle

import pytest

from studies.runner.catalogue import STUDIES, find_study
from studies.runner.row_key import hash_cell

SEED = 3


@pytest.fixture(scope="module", params=STUDIES)
def study(request):
    return find_study(request.param)


def keys(study, cells):
    return [hash_cell(study.run, one.args, one.sources) for one in cells]


def test_its_question_is_a_sentence_in_one_line(study):
    assert 5 <= len(study.question.split()) <= 25
    assert "\n" not in study.question


def test_its_cells_travel_to_workers(study):
    cells = list(study.cells(2, SEED))
    again = pickle.loads(pickle.dumps(cells))
    assert keys(study, again) == keys(study, cells)
    assert [one.columns for one in again] == [one.columns for one in cells]


def test_its_cells_are_different(study):
    cells = list(study.cells(2, SEED))
    assert len(set(keys(study, cells))) == len(cells)
    assert len({one.name for one in cells}) == len(cells)


def test_rows_of_the_mpc_follow_its_sources(study):
    """Controllers are called by name, so no definition that is followed leads to them."""
    for one in study.cells(1, SEED):
        if study.name.startswith("mpc") or "mpc" in map(str, one.columns.values()):
            found = hash_cell(study.run, one.args, one.sources)
            assert found == hash_cell(study.run, one.args, (*one.sources, "mpc.unit")), one.name


def test_more_events_add_cells_and_change_none(study):
    few, many = (keys(study, study.cells(events, SEED)) for events in (2, 3))
    assert set(few) < set(many)
    assert [one for one in many if one in set(few)] == few
