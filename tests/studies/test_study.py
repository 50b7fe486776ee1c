"""A study made of tasks: its rows are kept one by one, what fails is a row, and what is held is counted in events."""

import pandas as pd
import pytest

from studies.core.cell import Task
from studies.core.statement import HOLDS, Statement
from studies.core.store import Store
from studies.core.study import EachEvent, Study, all_studies, find_study
from studies.files.study_error import StudyError

calls: list[tuple[int, int]] = []


@pytest.fixture(autouse=True)
def fresh():
    calls.clear()


def squares(seed, k):
    calls.append((seed, k))
    return [{"number": k, "power": power, "value": float(k**power)} for power in (1, 2)]


def fragile(seed, k):
    if k == 1:
        raise ValueError("one is\nno number")
    return squares(seed, k)[0]


def study(function=squares, **more):
    def cells(seed, k, arms=("a",)):
        return [Task(f"{seed}/{k}/{arm}", function, (seed, k), (("arm", arm),)) for arm in arms]

    def judge(table):
        return [Statement("x", "all is well", HOLDS if (table["status"] == "ok").all() else "")]

    return Study("tiny", "what is a square", 5, EachEvent(cells), judge, **more)


def second_stage(seed, events, table):
    best = int(table["number"][table["value"].idxmax()])
    return [Task(f"{seed}/more", squares, (seed, 10 * best), (("arm", "late"),))]


def test_rows_of_a_cell_carry_its_columns_and_come_in_the_order_of_cells(tmp_path):
    table = study().run(tmp_path, 3, 7, arms=("a", "b"))
    assert table["number"].tolist() == [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2]
    assert table["arm"].tolist() == ["a", "a", "b", "b"] * 3
    assert (table["status"] == "ok").all()
    assert (table["reason"] == "").all()


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_interrupt_keeps_the_cells_that_are_finished(tmp_path, jobs):
    def interrupt(label, done, total):
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        study().run(tmp_path, 5, jobs=jobs, on_row=interrupt)
    kept = Store(tmp_path).read()
    assert kept["cell"].nunique() == 3
    assert len(kept) == 6
    calls.clear()
    table = study().run(tmp_path, 5)
    assert len(calls) == 2
    assert table["number"].tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4]


def test_a_longer_study_runs_what_is_new_and_a_second_one_nothing(tmp_path):
    first = study().run(tmp_path, 2)
    more = study().run(tmp_path, 3)
    assert calls == [(0, 0), (0, 1), (0, 2)]
    pd.testing.assert_frame_equal(more.head(4), first)
    pd.testing.assert_frame_equal(study().run(tmp_path, 3), more)
    assert len(calls) == 3


def test_what_fails_is_a_row_with_its_reason(tmp_path):
    table = study(fragile).run(tmp_path, 3)
    assert table["status"].tolist() == ["ok", "failed", "ok"]
    reason = table["reason"][1]
    assert reason.startswith("ValueError: one is no number (at tests/studies/test_study.py:")
    assert reason.split(" in ")[1].startswith("fragile, from studies/core/cell.py:")
    assert table["arm"].tolist() == ["a"] * 3
    assert study(fragile).held(tmp_path) == 3
    assert study(fragile).statements(table)[0].verdict == ""
    with pytest.raises(
        StudyError, match="1 rows are not ok, the first by ValueError: one is no number"
    ):
        study(fragile, whole=True).statements(table)


def test_events_held_are_counted_from_the_first_under_the_same_settings(tmp_path):
    assert study().held(tmp_path) == 0
    study().run(tmp_path, 4)
    study().run(tmp_path, 9, 1)
    assert [study().held(tmp_path, seed) for seed in range(3)] == [4, 9, 0]
    assert study(step=3).held(tmp_path) == 3
    assert study(step=5).held(tmp_path) == 0
    assert study().held(tmp_path, arms=("a", "b")) == 0


def test_later_stages_follow_from_the_rows_before_them_and_count_as_held(tmp_path):
    staged = study(later=(second_stage,), step=3)

    def interrupt(label, done, total):
        if label == "0/more":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        staged.run(tmp_path, 3, on_row=interrupt)
    calls.clear()
    table = staged.run(tmp_path, 3)  # goes on as one that was not interrupted
    assert set(calls) <= {(0, 20)}
    assert table["number"].tolist() == [0, 0, 1, 1, 2, 2, 20, 20]
    assert staged.held(tmp_path, 0) == 3
    study().run(tmp_path, 4)  # the first stage alone
    assert staged.held(tmp_path, 0) == 3


def test_every_study_is_found_by_its_name_and_one_to_which_events_add_nothing_is_held_once(
    tmp_path,
):
    for name, one in all_studies().items():
        assert find_study(name) is one
        assert one.name == name
    fixed = Study("fixed", "the same", 1, lambda seed, events: [Task("x", squares, (0, 1))], list)
    fixed.run(tmp_path, 1)
    assert fixed.held(tmp_path) == 1


def test_a_column_without_values_stays(tmp_path):
    def empty(seed, k):
        return {"number": k, "slip": float("nan")}

    table = study(empty).run(tmp_path, 2)
    assert table["slip"].isna().all()
