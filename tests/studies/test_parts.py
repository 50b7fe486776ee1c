"""Parts of a table: the last rows of a cell count wherever they stand, and joining files changes nothing."""

import hashlib
import os
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import studies.core.store
from studies.core.cell import Key
from studies.core.store import SUMS, TABLE, Store, StoreWarning
from studies.files.study_error import StudyError


def row(cell: int, value: object = 0, status: str = "ok", **values) -> dict:
    """A row; `values` are further columns."""
    kept = {"cell": f"{cell:016x}", "code_hash": "c0de", "status": status, "reason": ""}
    return kept | {"value": value} | values


def files(folder: Path) -> list[Path]:
    return sorted(folder.glob("rows/*.parquet"))


@pytest.fixture
def small_files(monkeypatch):
    monkeypatch.setattr(studies.core.store, "FULL", 5)
    monkeypatch.setattr(studies.core.store, "MANY", 3)
    monkeypatch.setattr(studies.core.store, "LARGE", 12)
    monkeypatch.setattr(studies.core.store, "AGE", -1.0)


WRITES = st.lists(
    st.tuples(
        st.integers(0, 2),  # writer
        st.lists(st.tuples(st.integers(0, 6), st.integers(1, 3)), min_size=1, max_size=4, unique_by=lambda one: one[0]),
        st.sampled_from(["", "look", "join", "open"]),
    ),
    min_size=1,
    max_size=25,
)  # fmt: skip
"""Who writes how many rows of which cells, and what it does before."""


@given(writes=WRITES)
@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_several_writers_give_the_table_that_one_would(writes, small_files, tmp_path_factory):
    folder = tmp_path_factory.mktemp("store")
    writers = [Store(folder) for _ in range(3)]
    expected: dict[str, list[int]] = {}
    for number, (writer, cells, before) in enumerate(writes):
        if before == "look":
            writers[writer].read()
        elif before == "join":
            writers[writer].cells()
        elif before == "open":
            writers[writer] = Store(folder)
        rows = [row(cell, 10 * number + k) for cell, count in cells for k in range(count)]
        writers[writer].add(rows)
        expected |= {
            f"{cell:016x}": [10 * number + k for k in range(count)] for cell, count in cells
        }
    keys = [Key("", cell, "c0de") for cell in reversed(expected)]
    for store in (*writers, Store(folder)):
        table = store.read()
        assert {c: v["value"].tolist() for c, v in table.groupby("cell")} == expected
        assert store.cells() == dict.fromkeys(expected, True)
        assert store.rows_of(keys)["value"].tolist() == [
            v for key in keys for v in expected[key.digest]
        ]


def test_a_writer_whose_clock_is_late_still_replaces_what_it_saw(tmp_path, monkeypatch):
    Store(tmp_path).add([row(1, status="failed")])
    late = Store(tmp_path)
    assert late.cells() == {f"{1:016x}": False}
    monkeypatch.setattr("time.time_ns", lambda: 1)
    late.add([row(1)])
    assert Store(tmp_path).cells() == {f"{1:016x}": True}


def test_a_writer_lengthens_its_file_until_it_is_full(tmp_path, small_files):
    store = Store(tmp_path)
    counts = []
    for k in range(12):
        store.add([row(k)])
        counts.append([pq.read_metadata(path).num_rows for path in files(tmp_path)])
    assert counts[3:6] == [[4], [5], [5, 1]]
    assert counts[-1] == [5, 5, 2]


@pytest.mark.parametrize("after", range(1, 6))
def test_a_crash_while_files_are_joined_loses_nothing(tmp_path, small_files, monkeypatch, after):
    for k in range(6):
        Store(tmp_path).add([row(k % 4, k)])
    before = Store(tmp_path).read()
    calls = []

    def killed(self, *arguments, **options):
        calls.append(self)
        if len(calls) == after:
            raise KeyboardInterrupt
        return unlink(self, *arguments, **options)

    unlink = Path.unlink
    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", killed)
        with pytest.raises(KeyboardInterrupt):
            Store(tmp_path).cells()
    pd.testing.assert_frame_equal(Store(tmp_path).read(), before)
    Store(tmp_path).cells()
    pd.testing.assert_frame_equal(Store(tmp_path).read(), before)
    assert len(files(tmp_path)) <= 2


@given(schedule=st.lists(st.integers(0, 3), max_size=30), joins=st.integers(1, 4))
@settings(
    max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_no_order_of_what_several_joiners_do_loses_a_row(
    schedule, joins, small_files, tmp_path_factory
):
    folder = tmp_path_factory.mktemp("store")
    for k in range(7):
        Store(folder).add([row(k % 5, k), row(5 + k)])
    before = Store(folder).read()
    unlink, remaining, depth = Path.unlink, list(schedule), [0]

    def interrupted(path: Path, **options) -> None:
        """Remove a file; before that a new joiner may do its whole work, or this one may be killed."""
        turn = remaining.pop() if remaining else 0
        if turn == 3:
            raise KeyboardInterrupt
        if turn and path.suffix == ".parquet" and depth[0] < 3:
            depth[0] += 1
            join()
            depth[0] -= 1
        unlink(path, **options)

    def join() -> None:
        with suppress(KeyboardInterrupt):
            Store(folder).cells()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Path, "unlink", interrupted)
        for _ in range(joins):
            join()
    after = Store(folder).read()
    columns = ["cell", "value"]
    assert sorted(after[columns].values.tolist()) == sorted(before[columns].values.tolist())


def test_a_file_that_another_process_joins_meanwhile_is_found_again(
    tmp_path, small_files, monkeypatch
):
    for k in range(4):
        Store(tmp_path).add([row(k)])
    reader = Store(tmp_path)
    assert len(reader.read()) == 4  # knows the four files
    listed, joined = reader.parts.index, []

    def index():
        found = listed()
        if not joined:
            joined.append(Store(tmp_path).cells())
        return found

    monkeypatch.setattr(reader.parts, "index", index)
    assert sorted(reader.read()["cell"]) == sorted(joined[0])
    assert len(files(tmp_path)) == 1


def test_writers_that_join_files_at_the_same_time_lose_nothing(tmp_path, small_files):
    def work(writer: int) -> None:
        store = Store(tmp_path)
        for k in range(8):
            store.add([row(100 * writer + k, k), row(100 * writer, k)])
            if k % 2:
                assert store.cells().keys() >= {f"{100 * writer + j:016x}" for j in range(k + 1)}

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(work, range(4)))
    table = Store(tmp_path).read()
    assert len(table) == len(set(table["cell"])) == 32
    assert table["value"][table["cell"].isin([f"{100 * w:016x}" for w in range(4)])].eq(7).all()


@pytest.mark.parametrize("looked", [False, True])
def test_a_list_that_misses_what_this_writer_knows_is_asked_for_again(
    tmp_path, small_files, monkeypatch, looked
):
    store = Store(tmp_path)
    store.add([row(1)])
    if looked:
        store.read()
    other = Store(tmp_path)
    other.add([row(2)])
    (missing,) = {path.name for path in files(tmp_path)} - {store.parts._tail_path.name}
    present, short = os.listdir, [[missing]] * 4  # the list of a folder whose files are joined
    monkeypatch.setattr(os, "listdir", lambda path: short.pop() if short else present(path))
    assert store.cells().keys() == {f"{k:016x}" for k in (1, 2)}
    assert not short


def test_a_list_of_files_that_comes_late_is_asked_for_again(tmp_path, small_files, monkeypatch):
    for k in range(4):
        Store(tmp_path).add([row(k)])
    late = [os.listdir(tmp_path / "rows")] * 7  # as a network file system may answer
    Store(tmp_path).cells()
    present = os.listdir
    monkeypatch.setattr(os, "listdir", lambda path: late.pop() if late else present(path))
    assert len(Store(tmp_path).read()) == 4


def test_files_that_may_still_be_lengthened_are_left_alone(tmp_path, small_files, monkeypatch):
    monkeypatch.setattr(studies.core.store, "AGE", 600.0)
    for k in range(7):
        Store(tmp_path).add([row(k)])
    before = files(tmp_path)
    for path in before[:4]:
        os.utime(path, (0, 0))
    Store(tmp_path).cells()
    after = files(tmp_path)
    assert (len(after), set(after) & set(before)) == (4, set(before[4:]))
    assert len(Store(tmp_path).read()) == 7


def test_a_writer_goes_on_whose_file_was_joined_with_others(tmp_path, small_files):
    writer = Store(tmp_path)
    writer.add([row(0, 1)])
    for k in (1, 2, 3):
        Store(tmp_path).add([row(k, 1)])
    Store(tmp_path).cells()
    writer.add([row(4, 1)])
    table = Store(tmp_path).read()
    assert sorted(table["cell"]) == [f"{k:016x}" for k in range(5)]
    assert (table["value"] == 1).all()


def test_columns_of_different_rows_are_united(tmp_path):
    Store(tmp_path).add([row(0, 1, status="failed"), row(1, 2, extra=True)])
    Store(tmp_path).add([row(2, 2.5, extra=None, text="a", empty=float("nan"))])
    table = Store(tmp_path).read()
    assert table["value"].tolist() == [1.0, 2.0, 2.5]
    assert table["extra"].tolist() == [None, True, None]
    assert table["text"].isna().tolist() == [True, True, False]
    assert table["empty"].dtype == float
    assert "added" not in table


def test_types_that_clash_neither_stop_a_writer_nor_a_reader(tmp_path, small_files):
    writer = Store(tmp_path)
    for k, value in enumerate([1, "one", 2, "two", 3]):
        writer.add([row(k, value)])
    for _ in range(2):
        assert Store(tmp_path).read()["value"].tolist() == [1, "one", 2, "two", 3]
        assert len(Store(tmp_path).cells()) == 5


def test_of_a_large_table_only_the_files_that_hold_the_rows_are_read(
    tmp_path, small_files, monkeypatch
):
    store = Store(tmp_path)
    for k in range(20):
        store.add([row(k)])
    store.cells()
    read = []
    monkeypatch.setattr(
        studies.core.store, "read_checked", lambda path: read.append(path) or path.read_bytes()
    )
    assert len(store.rows_of([Key("", f"{k:016x}", "") for k in (6, 8)])) == 2
    assert len(read) == 1


# the table of before, one file


def single_table(folder: Path, table: pd.DataFrame, listed: bool = True) -> bytes:
    folder.mkdir(parents=True, exist_ok=True)
    table.attrs["schema"] = 1
    table.to_parquet(folder / TABLE, index=False)
    content = (folder / TABLE).read_bytes()
    if listed:
        (folder / SUMS).write_text(f"{hashlib.sha256(content).hexdigest()}  {TABLE}\n")
    (folder / ".lock").touch()
    return content


@pytest.mark.parametrize("listed", [True, False])
def test_a_single_table_of_before_becomes_a_part(tmp_path, listed):
    table = pd.DataFrame([row(k, 0.5 * k, text=f"number {k}") for k in range(7)])
    single_table(tmp_path, table, listed)
    store = Store(tmp_path)
    assert store.read().equals(table)
    store.add([row(3, 9.0)])
    assert Store(tmp_path).read()["value"].tolist() == [0.0, 0.5, 1.0, 2.0, 2.5, 3.0, 9.0]
    assert [path.name for path in tmp_path.iterdir()] == ["rows"]


def test_a_crash_while_a_single_table_is_taken_over_loses_nothing(tmp_path, monkeypatch):
    table = pd.DataFrame([row(k) for k in range(3)])
    single_table(tmp_path, table)
    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", lambda *_, **__: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            Store(tmp_path)
    for _ in range(2):
        assert Store(tmp_path).read().equals(table)


@pytest.mark.parametrize("listed", [True, False])
@pytest.mark.parametrize(
    "damage", [lambda whole: whole[:100], lambda whole: b"", lambda whole: b"no table"]
)
def test_a_broken_single_table_is_set_aside(tmp_path, listed, damage):
    whole = single_table(tmp_path, pd.DataFrame([row(0)]), listed)
    (tmp_path / TABLE).write_bytes(damage(whole))
    with pytest.warns(
        StoreWarning, match=r"runs\.parquet' is broken .* it is now 'runs\.parquet\.broken-1'"
    ):
        assert Store(tmp_path).read().empty


@pytest.mark.parametrize("column", ["scenario", "other version"])
def test_a_single_table_of_another_version_is_refused_and_left_alone(tmp_path, column):
    table = pd.DataFrame({"scenario": ["x"], "seed": [0]})
    if column == "other version":
        table = pd.DataFrame([row(0)])
        table.attrs["schema"] = 99
    table.to_parquet(tmp_path / TABLE)
    whole = (tmp_path / TABLE).read_bytes()
    with pytest.raises(
        StudyError, match="one of another version of this program; move it away or choose"
    ):
        Store(tmp_path)
    assert (tmp_path / TABLE).read_bytes() == whole
