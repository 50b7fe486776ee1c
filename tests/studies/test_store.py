"""The table on disk: rows resume, replace their like, and survive what goes wrong while they are written."""

import errno
import hashlib
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow.parquet as pq
import pytest
import xarray as xr

from alloc.recording import load
from alloc.sources import ASIDE
from studies.core.cell import Key
from studies.core.store import Store, StoreWarning, write_checked
from studies.files.study_error import StudyError

DAMAGES = (lambda whole: whole[: len(whole) // 2], lambda whole: b"", lambda whole: b"no table")
RUN = xr.Dataset({"speed": ("time", np.arange(100.0))}, {"time": np.arange(100.0)})


def row(seed: int, status: str = "ok", **values) -> dict:
    cell = {"cell": f"cell {seed}", "code_hash": "c0de", "seed": seed}
    return cell | {"status": status, "reason": ""} | values


def files(store) -> list[Path]:
    """Files of the table, in the order of their rows."""
    return sorted(store.path.glob("*.parquet"))


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "a" / "b")


def test_an_empty_folder_has_no_rows(store):
    assert store.read().empty
    assert store.cells() == {}


def test_rows_are_found_again_by_another_store(store):
    store.add([row(0, damage=1.5), row(1, damage=2.5)])
    again = Store(store.folder)
    assert again.cells() == {"cell 0": True, "cell 1": True}
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
    assert store.cells() == {"cell 0": False}
    assert store.read().loc[0, "reason"] == "the wheels came off"


def test_an_interrupted_write_leaves_the_old_rows_and_no_litter(store, monkeypatch):
    store.add([row(0)])

    def interrupted(table, path, **_):
        path.write_text("half a tab")
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("pyarrow.parquet.write_table", interrupted)
        with pytest.raises(KeyboardInterrupt):
            store.add([row(1)])
    assert store.cells().keys() == {"cell 0"}
    assert {path.name for path in store.folder.iterdir()} == {"rows"}
    assert len(files(store)) == 1
    store.add([row(2)])
    assert store.cells().keys() == {"cell 0", "cell 2"}


def test_writers_at_the_same_time_lose_nothing(store):
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda seed: Store(store.folder).add([row(seed)]), range(12)))
    assert store.cells().keys() == {f"cell {seed}" for seed in range(12)}


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


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_broken_part_is_set_aside_with_one_line_and_the_others_stay(store, damage):
    store.add([row(0)])
    Store(store.folder).add([row(1)])
    path = files(store)[0]
    whole = path.read_bytes()
    path.write_bytes(damage(whole))
    with pytest.warns(
        StoreWarning,
        match=rf"{path.name}' is broken \(it is not as .*; it is now '{path.name}\.broken-1'",
    ) as said:
        assert Store(store.folder).cells() == {"cell 1": True}
    assert len(said) == 1
    assert "\n" not in str(said[0].message)
    assert path.with_name(f"{path.name}.broken-1").read_bytes() == damage(whole)
    Store(store.folder).add([row(2)])
    assert Store(store.folder).cells().keys() == {"cell 1", "cell 2"}


def test_damage_between_index_and_reading_is_noticed(store):
    store.add([row(0), row(1)])
    keys = [Key("event", f"cell {seed}", "c0de") for seed in range(2)]
    assert store.cells(keys).keys() == {"cell 0", "cell 1"}
    files(store)[0].write_bytes(b"no table")
    with pytest.warns(StoreWarning, match="it is not as it was written"):
        assert store.rows_of(keys).empty


def test_a_file_that_another_writer_finishes_meanwhile_is_no_fault(store, monkeypatch):
    gone = store.folder / ".1234.part.parquet"
    monkeypatch.setattr(Path, "rglob", lambda *_: iter([gone]))
    assert Store(store.folder).read().empty


def test_any_flipped_bit_is_noticed(store):
    store.add([row(0, damage=1.5)])
    (path,) = files(store)
    whole = path.read_bytes()
    for place in np.random.default_rng(0).choice(len(whole), 40, replace=False):
        broken = bytearray(whole)
        broken[place] ^= 1 << (place % 8)
        path.write_bytes(broken)
        with pytest.warns(StoreWarning, match="it is not as it was written"):
            assert Store(store.folder).read().empty


def test_names_end_with_checksums_of_the_usual_tool(store):
    store.add([row(0)])
    run = store.save_run(Key("event/rule", "0123456789abcdef", "c0de"), RUN)
    for path in (*files(store), run):
        assert path.stem.endswith(f"-{hashlib.sha256(path.read_bytes()).hexdigest()[:16]}")


def test_a_table_of_another_version_is_refused_and_left_alone(store):
    store.add([row(0)])
    (path,) = files(store)
    table = pq.read_table(path).replace_schema_metadata({"readhesion": "99"})
    path.unlink()
    path = write_checked(path.parent / ("0" * 20), ".parquet", partial(pq.write_table, table))
    for use in (store.read, store.cells, lambda: store.rows_of([])):
        with pytest.raises(
            StudyError, match="one of another version of this program; move it away or choose"
        ):
            use()
    assert path.exists()


@pytest.mark.parametrize(
    "label", ["../../out/exact", "/etc/exact", "..", "a/../../b", "C:\\x/y", "né w/α", "x" * 300]
)
def test_no_label_leads_out_of_the_folder(store, label):
    key = Key(label, "0123456789abcdef", "c0de")
    path = store.save_run(key, RUN)
    assert path.resolve().is_relative_to((store.folder / "runs").resolve())
    assert len(path.relative_to(store.folder).parts) <= 3
    assert store.run_path(key) == path


def test_a_broken_run_does_not_count_as_kept(store):
    key = Key("event/rule", "0123456789abcdef", "c0de")
    assert not store.has_run(key)
    path = store.save_run(key, RUN)
    assert store.has_run(key)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.warns(StoreWarning, match="broken-1"):
        assert not store.has_run(key)
    store.save_run(key, RUN)
    assert store.has_run(key)


def test_files_have_the_users_umask(store):
    before = os.umask(0o027)
    try:
        store.add([row(0)])
        run = store.save_run(Key("event/rule", "0123456789abcdef", "c0de"), RUN)
    finally:
        os.umask(before)
    for path in (*files(store), run):
        assert path.stat().st_mode & 0o777 == 0o640


def test_what_a_killed_writer_left_is_deleted_when_it_is_old(store):
    left, fresh = store.folder / ".1234.part.parquet", store.folder / ".5678.part.parquet"
    for path in (left, fresh):
        path.write_text("half")
    os.utime(left, (0, 0))
    Store(store.folder)
    assert not left.exists()
    assert fresh.exists()


def test_a_run_that_is_kept_is_not_written_again(store):
    key = Key("event/rule", "0123456789abcdef", "c0de")
    path = store.save_run(key, RUN)
    assert store.save_run(key, 2.0 * RUN) == path
    assert load(path).equals(RUN)


def test_a_folder_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StudyError, match=r"cannot be written: .*; choose another with --out"):
        Store(tmp_path / "file" / "results")


def test_what_is_no_parquet_under_a_right_checksum_is_set_aside_once(store):
    store.add([row(0)])
    whole = files(store)[0].read_bytes()
    for number, damage in enumerate(DAMAGES):
        beginning = store.path / f"{number + 1:020d}"
        write_checked(beginning, ".parquet", partial(Path.write_bytes, data=damage(whole)))
    with pytest.warns(StoreWarning, match=r"is broken \(.*broken-1'") as said:
        assert Store(store.folder).cells() == {"cell 0": True}
    assert len(said) == len(DAMAGES)
    assert len(Store(store.folder).read()) == 1


def test_a_complete_folder_is_read_where_nothing_can_be_written(store, monkeypatch):
    store.add([row(0)])
    key = Key("event/rule", "0123456789abcdef", "c0de")
    store.save_run(key, RUN)
    broken = write_checked(store.path / ("0" * 20), ".parquet", partial(Path.write_bytes, data=b""))
    (store.folder / f".old{ASIDE}").touch()
    os.utime(store.folder / f".old{ASIDE}", (0.0, 0.0))
    before = sorted(store.folder.rglob("*"))

    def read_only(*_, **__):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    for name in ("unlink", "rename", "mkdir", "touch"):
        monkeypatch.setattr(Path, name, read_only)
    monkeypatch.setattr("os.replace", read_only)
    monkeypatch.setattr("tempfile.TemporaryFile", read_only)
    again = Store(store.folder)
    with pytest.warns(StoreWarning, match="it is passed over") as said:
        assert again.cells() == {"cell 0": True}
    assert len(said) == 1
    assert broken.name in str(said[0].message)
    assert len(again.read()) == 1
    assert again.has_run(key)
    with pytest.raises(
        StudyError, match="cannot be written: Read-only file system; choose another"
    ):
        again.check_writable()
    assert sorted(store.folder.rglob("*")) == before


def test_a_full_disk_is_told_with_the_file_and_nothing_of_before_is_lost(store, monkeypatch):
    store.add([row(0)])
    kept = files(store)

    def full(*_, **__):
        raise OSError(errno.ENOSPC, "Error writing bytes to file")

    def silent(*_, **__):
        raise RuntimeError("NetCDF: HDF error")

    monkeypatch.setattr("pyarrow.parquet.write_table", full)
    with pytest.raises(OSError, match=rf"No space left on device: '{store.path}/\d+\.parquet'"):
        store.add([row(1)])
    monkeypatch.setattr(xr.Dataset, "to_netcdf", silent)
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=0))
    with pytest.raises(OSError, match=r"No space left on device: '.*/rule_0123456789ab\.nc'"):
        store.save_run(Key("event/rule", "0123456789abcdef", "c0de"), RUN)
    assert files(store) == kept
    assert Store(store.folder).cells() == {"cell 0": True}
    assert not list(store.folder.rglob(f"*{ASIDE}*"))


def test_random_kills_and_damages_lose_nothing(tmp_path):
    """500 trials and more: `python -m tests.studies.crashes FOLDER 500 0`."""
    words = [sys.executable, "-m", "tests.studies.crashes", str(tmp_path), "40", "1"]
    done = subprocess.run(words, cwd=Path(__file__).parents[2], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.endswith("60 rows: equal\n")
