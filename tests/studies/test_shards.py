"""Shares of a study: each event is in one of them, and what they computed apart is one study again."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

import studies.core.study
from alloc.recording import load
from studies.core.cell import Key, Task
from studies.core.job import Job
from studies.core.run import Shard, read_shard
from studies.core.statement import HOLDS, Statement
from studies.core.store import Store, StoreWarning, unite
from studies.core.study import EachEvent, Study, all_studies
from studies.files.study_error import StudyError
from tests.studies.test_store import DAMAGES, RUN

calls: list[int] = []


@pytest.fixture(autouse=True)
def fresh():
    calls.clear()


def square(seed: int, k: int) -> dict[str, float]:
    calls.append(k)
    return {"k": k, "square": float(k**2 + seed)}


def cells(seed, k):
    return [Task(f"{seed}/{k}/{arm}", square, (seed, k), (("arm", arm),)) for arm in "ab"]


def sum_of_first(seed, events, table):
    return [Task(f"{seed}/sum", square, (seed, int(table["square"].sum())), (("arm", "sum"),))]


def judge(table):
    return [Statement("sum", f"the squares sum to {table['square'].sum():g}", HOLDS)]


STUDY = Study("tiny", "what is a square", 7, EachEvent(cells), judge)
STAGED = Study(
    "staged", "what is their sum", 7, lambda seed, events: EachEvent(cells)(seed, events), judge,
    later=(sum_of_first,),
)  # fmt: skip
NO_SHARES = (
    "0/3",
    "4/3",
    "1/0",
    "-1/3",
    "1",
    "/",
    "1/",
    "a/b",
    "1/2/3",
    "",
    "1.0/3",
    "1/1000000",
    "٣/٤",
)


@pytest.fixture
def tiny(monkeypatch):
    """The study as one that the command knows."""
    monkeypatch.setitem(all_studies(), "tiny", STUDY)


@pytest.mark.parametrize("text", NO_SHARES)
def test_a_share_that_is_none_is_refused(text):
    with pytest.raises(StudyError, match=r"^--shard .*: give k/n, part k of n"):
        read_shard(text)


@given(shares=st.integers(1, 9), events=st.integers(0, 20))
def test_every_cell_is_in_one_share(shares, events):
    every = [Task(f"{k}/{arm}", square) for k in range(events) for arm in range(2)]
    parts = [Shard(number, shares).of_cells(every) for number in range(1, shares + 1)]
    assert sorted(cell.label for part in parts for cell in part) == sorted(
        cell.label for cell in every
    )
    sizes = [len(part) for part in parts]
    assert max(sizes) - min(sizes) <= 1


def test_the_arms_of_an_event_are_in_one_share(short):
    jobs = [Job(short, rule, "none", seed) for rule in ("alone", "exact") for seed in range(5)]
    first = Shard(1, 3).of_cells(jobs)
    assert [(job.rule, job.seed) for job in first] == [
        (r, s) for r in ("alone", "exact") for s in (0, 3)
    ]


@pytest.mark.parametrize("study", [STUDY, STAGED])
@pytest.mark.parametrize("apart", [True, False])
def test_shares_united_are_the_study_and_nothing_is_computed_again(
    tmp_path, study, apart, monkeypatch
):
    monkeypatch.setattr(studies.core.study, "BLOCK", 2)
    folders = [tmp_path / (f"part {number}" if apart else "part") for number in (1, 2, 3)]
    for number, folder in enumerate(folders, 1):
        study.run(folder, 7, shard=Shard(number, 3))
    assert sorted(calls) == sorted(2 * list(range(7)))
    if apart:
        unite(folders, tmp_path / "whole")
    calls.clear()
    table = study.run(tmp_path / "whole" if apart else folders[0], 7)
    assert len(calls) == len(study.later)
    alone = study.run(tmp_path / "alone", 7)
    columns = ["cell", "k", "square", "arm", "status"]
    assert table[columns].equals(alone[columns])


def test_blocks_change_neither_the_table_nor_what_is_told_of_progress(tmp_path, monkeypatch):
    one, more = [], []
    table = STUDY.run(tmp_path / "one", 7, on_row=lambda *step: one.append(step))
    monkeypatch.setattr(studies.core.study, "BLOCK", 2)
    blocks = STUDY.run(tmp_path / "blocks", 7, on_row=lambda *step: more.append(step))
    columns = ["cell", "k", "square", "arm", "status"]
    assert table[columns].equals(blocks[columns])
    assert {step[2] for step in more} == {14}
    assert more[-1] == one[-1]
    assert [step[1] for step in more] == sorted(step[1] for step in more)


def test_held_events_are_looked_at_once(tmp_path):
    STUDY.run(tmp_path, 6)
    asked = []
    counting = Study(
        "tiny", "", 7, EachEvent(lambda seed, k: asked.append(k) or cells(seed, k)), judge
    )
    assert counting.held(tmp_path) == 6
    assert asked == list(range(7))


def test_a_command_shared_out_and_united_states_what_it_states_alone(tiny, call, tmp_path):
    words = ("sweep", "tiny", "--events", 5, "--jobs", 1, "--json", "--out")
    for number in (1, 2):
        code, out, _ = call(*words, tmp_path / f"part {number}", "--shard", f"{number}/2")
        content = json.loads(out)
        assert (code, content["shard"], content["statements"]) == (0, f"{number}/2", [])
    code, out, err = call(
        "merge", tmp_path / "part 1", tmp_path / "part 2", "--out", tmp_path / "whole"
    )
    assert (code, err) == (0, "")
    assert "10 cells" in out
    calls.clear()
    code, out, _ = call(*words, tmp_path / "whole")
    assert (code, calls) == (0, [])
    _, alone, _ = call(*words, tmp_path / "alone")
    assert json.loads(out)["statements"] == json.loads(alone)["statements"] != []


def test_a_share_without_events_is_no_error(tiny, call, tmp_path):
    words = ("sweep", "tiny", "--events", 1, "--jobs", 1, "--out")
    for number in (1, 2):
        assert call(*words, tmp_path / f"{number}", "--shard", f"{number}/2")[0] == 0
    assert call("merge", tmp_path / "1", tmp_path / "2", "--out", tmp_path / "whole")[0] == 0
    assert len(Store(tmp_path / "whole" / "sweeps" / "tiny").read()) == 2


def test_a_comparison_shared_out_is_summarised_and_drawn_when_united(call, short_file, tmp_path):
    words = (
        "compare", "--scenario", short_file, "--rules", "alone,exact", "--controllers", "none",
        "--seeds", 3, "--jobs", 1, "--keep", "*/exact/*/2", "--out",
    )  # fmt: skip
    for number in (1, 2):
        code, out, _ = call(*words, tmp_path / f"{number}", "--shard", f"{number}/2")
        assert code == 0
        assert f"runs of shard {number}/2; `readhesion merge` unites the shards" in " ".join(
            out.split()
        )
        assert not (tmp_path / f"{number}" / "figures").exists()
    code, out, err = call("merge", tmp_path / "1", tmp_path / "2", "--out", tmp_path / "whole")
    assert (code, err) == (0, "")
    assert "6 cells and 1 recorded runs" in out
    before = Store(tmp_path / "whole").read()
    code, out, _ = call(*words, tmp_path / "whole")
    assert code == 0
    assert "paired over 3 seeds" in out
    assert (tmp_path / "whole" / "figures" / "rule-comparison.pdf").exists()
    assert Store(tmp_path / "whole").read().equals(before)


# what is united


def row(cell: int, **values) -> dict:
    kept = {
        "cell": f"{cell:016x}",
        "code_hash": "c0de",
        "scenario": "wet",
        "rule": "exact",
        "controller": "none",
    }
    return kept | {"seed": cell, "status": "ok", "reason": "", "wall_time": 1.0} | values


def test_rows_that_differ_in_times_alone_are_the_same(tmp_path, recwarn):
    Store(tmp_path / "a").add([row(1, slip=1.5, rule_time=1.0), row(2, slip=float("nan"))])
    Store(tmp_path / "b").add(
        [row(1, slip=1.5, rule_time=2.0), row(2, slip=None, wall_time=3.0), row(3)]
    )
    assert unite([tmp_path / "a", tmp_path / "b"], tmp_path / "c").cells == 3
    assert not recwarn.list


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (
            [row(1, slip=1.25)],
            r"1 cells .*: cell 0+1 wet/exact/none/1 has slip = 1\.25, not 1\.5; .* added later count",
        ),
        ([row(1, slip=1.5, status="failed")], "has status = failed, not ok"),
        ([row(1, slip=1.5, damage=2.0)], r"has damage = 2\.0, not nan"),
        ([row(1, slip=1.5), row(1, slip=1.5)], "1 cells .*: cell 0+1 has other numbers of rows"),
    ],
)
def test_rows_that_differ_are_named_and_the_later_ones_count(tmp_path, other, words):
    Store(tmp_path / "a").add([row(1, slip=1.5), row(2)])
    Store(tmp_path / "b").add([*other, row(3)])
    with pytest.warns(StoreWarning, match=words) as said:
        unite([tmp_path / "a", tmp_path / "b"], tmp_path / "c")
    assert len(said) == 1
    table = Store(tmp_path / "c").read()
    assert len(table) == len(other) + 2
    assert table["slip"].max() == other[0]["slip"]


def test_stores_at_every_depth_and_their_runs_are_united(tmp_path):
    keys = [Key("event/rule", 16 * f"{k}", "c0de") for k in range(2)]
    for k, name in enumerate("ab"):
        Store(tmp_path / name).add([row(k)])
        Store(tmp_path / name / "sweeps" / "claims").add([row(k), row(10 + k)])
        Store(tmp_path / name).save_run(keys[k], RUN)
    assert unite([tmp_path / "a", tmp_path / "b"], tmp_path / "c") == (6, 2)
    assert len(Store(tmp_path / "c").read()) == 2
    assert len(Store(tmp_path / "c" / "sweeps" / "claims").read()) == 4
    assert all(load(Store(tmp_path / "c").run_path(key)).equals(RUN) for key in keys)


def test_a_union_may_be_one_of_the_folders_and_repeated(tmp_path, recwarn):
    for k, name in enumerate("ab"):
        Store(tmp_path / name).add([row(k)])
    for _ in range(2):
        assert unite([tmp_path / "a", tmp_path / "b"], tmp_path / "a").cells == 2
    assert len(list(tmp_path.glob("a/rows/*"))) == 2
    assert not recwarn.list


@pytest.mark.parametrize("damage", DAMAGES)
def test_what_is_damaged_is_left_behind(tmp_path, damage):
    for k in range(2):
        Store(tmp_path / "a").add([row(k)])
    path = sorted(tmp_path.glob("a/rows/*"))[0]
    path.write_bytes(damage(path.read_bytes()))
    with pytest.warns(StoreWarning, match="is broken"):
        assert unite([tmp_path / "a"], tmp_path / "b").cells == 1


def test_a_folder_that_can_only_be_read_is_united(tmp_path):
    Store(tmp_path / "a").add([row(1)])
    folders = [tmp_path / "a" / "rows", tmp_path / "a"]
    for folder in folders:
        folder.chmod(0o555)
    try:
        assert unite([tmp_path / "a"], tmp_path / "b").cells == 1
    finally:
        for folder in folders:
            folder.chmod(0o755)


def test_what_is_no_result_is_refused_before_anything_is_written(tmp_path):
    Store(tmp_path / "a").add([row(1)])
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "text").write_text("")
    with pytest.raises(StudyError, match=r"notes' holds no table of a study"):
        unite([tmp_path / "a", tmp_path / "notes"], tmp_path / "b")
    assert not (tmp_path / "b").exists()


def test_a_union_that_was_interrupted_is_finished_by_the_same_command(tmp_path, monkeypatch):
    for k, name in enumerate("abc"):
        Store(tmp_path / name).add([row(k)])
    folders = [tmp_path / name for name in "abc"]
    copied = []

    def killed(content):
        copied.append(content)
        if len(copied) == 2:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(
            "studies.core.store.write_whole", lambda path, write: (killed(path), write(path))
        )
        with pytest.raises(KeyboardInterrupt):
            unite(folders, tmp_path / "whole")
    assert len(Store(tmp_path / "whole").read()) == 1
    assert unite(folders, tmp_path / "whole").cells == 3
