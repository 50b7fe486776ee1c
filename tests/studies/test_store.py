"""The table on disk: rows resume, replace their like, and survive what goes wrong while they are written."""

from concurrent.futures import ThreadPoolExecutor

import pandas as pd
import pytest

from studies.core.cell import Key
from studies.core.store import Store
from studies.files.study_error import StudyError


def row(seed: int, status: str = "ok", **values) -> dict:
    cell = {"cell": f"cell {seed}", "code_hash": "c0de", "seed": seed}
    return cell | {"status": status, "reason": ""} | values


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "a" / "b")


def test_an_empty_folder_has_no_rows(store):
    assert store.read().empty
    assert store.cells(failed_too=True) == set()


def test_rows_are_found_again_by_another_store(store):
    store.add([row(0, damage=1.5), row(1, damage=2.5)])
    again = Store(store.folder)
    assert again.cells() == {"cell 0", "cell 1"}
    assert again.read()["damage"].tolist() == [1.5, 2.5]


def test_a_row_replaces_the_one_of_the_same_identity(store):
    store.add([row(0, "failed", reason="because")])
    store.add([row(0, damage=3.0)])
    table = store.read()
    assert len(table) == 1
    assert table.loc[0, "status"] == "ok"
    assert table.loc[0, "damage"] == 3.0


def test_a_failed_row_is_kept_with_its_reason_but_is_not_done(store):
    store.add([row(0, "failed", reason="the wheels came off")])
    assert store.cells() == set()
    assert store.cells(failed_too=True) == {"cell 0"}
    assert store.read().loc[0, "reason"] == "the wheels came off"


def test_an_interrupted_write_leaves_the_old_table_and_no_litter(store, monkeypatch):
    store.add([row(0)])

    def interrupted(self, path, **_):
        with open(path, "w") as file:
            file.write("half a tab")
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(pd.DataFrame, "to_parquet", interrupted)
        with pytest.raises(KeyboardInterrupt):
            store.add([row(1)])
    assert store.cells() == {"cell 0"}
    assert not list(store.folder.glob("*.part"))


def test_writers_at_the_same_time_lose_nothing(store):
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda seed: Store(store.folder).add([row(seed)]), range(12)))
    assert store.cells() == {f"cell {seed}" for seed in range(12)}


def test_rows_come_back_in_the_order_asked_for(store):
    store.add([row(0), row(1), row(2)])
    keys = [Key("event", f"cell {seed}", "c0de") for seed in (2, 0)]
    assert store.rows_of(keys)["seed"].tolist() == [2, 0]


def test_rows_of_one_cell_stay_together_in_their_order_and_are_replaced_as_one(store):
    store.add([row(0, place=2), row(1, place=0), row(0, place=1)])
    keys = [Key("event", f"cell {seed}", "c0de") for seed in (1, 0)]
    assert store.rows_of(keys)["place"].tolist() == [0, 2, 1]
    store.add([row(0, place=3)])
    assert store.rows_of(keys)["place"].tolist() == [0, 3]


def test_a_table_that_is_none_is_refused_with_its_name(store):
    store.path.write_text("not parquet")
    with pytest.raises(StudyError, match=r"table '.*runs\.parquet' cannot be read"):
        store.read()


def test_a_table_of_another_version_is_refused(store):
    pd.DataFrame({"scenario": ["x"], "seed": [0]}).to_parquet(store.path)
    with pytest.raises(StudyError, match="another version of this program wrote it"):
        store.read()


def test_a_folder_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StudyError, match=r"cannot be written: .*; choose another with --out"):
        Store(tmp_path / "file" / "results")
