"""After an edit of a part, of what it imports, or of a file that it reads, rows are of the part as it is now."""

import importlib
import subprocess
import sys
import textwrap
from itertools import count

import pytest

import readhesion
from studies import SourcesChanged
from studies.runner import row_key, workers
from studies.runner.plugins import load_plugins
from studies.runner.rows import read_rows
from studies.runner.study import run_study
from tests.cases import looped
from tests.studies.made_study import make

READ_AT_ONCE = "SHARE = float(np.loadtxt(Path(__file__).with_name('share.csv')))"
IMPORTED = "from amount import SHARE"
PLAIN = """
    def answer(problem):
        return np.minimum(problem.upper, SHARE * problem.expected)

    RULE = readhesion.Rule(NAME, "a share of the plan", answer=answer, belief="delivered always")
"""
COMPILED = """
    @readhesion.law
    def answer(units, run):
        for u in units:
            u.wanted = min(u.most, SHARE * run.needed)
        run.case = 1
        return math.nan

    RULE = readhesion.Rule(NAME, "a share of the plan", answer, belief="delivered always")
"""
SHORT = readhesion.load_scenario("wet-patch").changed(duration_s=4.0)


def write(folder, name, source, share, body):
    """A plug-in whose rule asks every unit for a `share` of the plan, which it has from another file."""
    folder.mkdir(exist_ok=True)
    (folder / "share.csv").write_text(str(share))
    (folder / "amount.py").write_text(f"SHARE = {share}")
    imports = "import math\nfrom pathlib import Path\n\nimport numpy as np\nimport readhesion\n"
    ending = "\nreadhesion.RULES.register(NAME, RULE)\n"
    path = folder / f"{name.replace('-', '_')}.py"
    path.write_text(f"{imports}{source}\nNAME = {name!r}\n{textwrap.dedent(body)}{ending}")
    return path


def used(name, **more):
    return readhesion.compare(SHORT, name, "none", seeds=1, **more)["bound_use"].tolist()


@looped(("name", "source", "body"), [
    ("plain-data", READ_AT_ONCE, PLAIN), ("plain-import", IMPORTED, PLAIN),
    ("compiled-data", READ_AT_ONCE, COMPILED), ("compiled-import", IMPORTED, COMPILED),
])  # fmt: skip
def test_in_one_session_rows_follow_an_edit(tmp_path, monkeypatch, name, source, body):
    """A plug-in, and a module that a notebook imports; with kept rows and without."""
    folder = tmp_path / name
    path = write(folder, name, source, 0.5, body)
    if name.endswith("data"):
        load_plugins([path])
    else:
        monkeypatch.syspath_prepend(folder)
        importlib.import_module(path.stem)
    for share in (0.5, 0.9, 0.5):
        write(folder, name, source, share, body)
        stored, fresh = used(name, out=folder / "results"), used(name)
        assert stored == fresh == pytest.approx([share], abs=0.05)
    sys.modules.pop("amount", None)


def test_machine_code_follows_an_edit(tmp_path):
    """In a new process: Numba's cache knows the file of a function alone."""
    for share in (0.5, 0.9):
        path = write(tmp_path, "own-share", READ_AT_ONCE, share, COMPILED)
        program = (
            f"from studies.runner.plugins import load_plugins; load_plugins([{str(path)!r}]); "
            + (
                "import readhesion; s = readhesion.load_scenario('wet-patch').changed(duration_s=4.0); "
                "print(readhesion.evaluate(readhesion.simulate(s, 'own-share', 'none'))['bound_use'])"
            )
        )
        process = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
        assert float(process.stdout) == pytest.approx(share, abs=0.05), process.stderr


def test_a_living_cluster_follows_an_edit(tmp_path):
    distributed = pytest.importorskip("distributed")
    path = write(tmp_path, "cluster-share", READ_AT_ONCE, 0.5, PLAIN)
    load_plugins([path])
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=None, silence_logs=50
    ) as cluster:
        for share in (0.5, 0.9):
            write(tmp_path, "cluster-share", READ_AT_ONCE, share, PLAIN)
            load_plugins([path])
            study = readhesion._compare.make_study(
                readhesion._compare.choose_grid([SHORT], ["cluster-share"], ["none"], 1)
            )
            rows = run_study(study, tmp_path / "results", scheduler=cluster.scheduler_address)
            assert rows["bound_use"].tolist() == pytest.approx([share], abs=0.05)


def test_a_fault_of_the_place_is_no_row(tmp_path, monkeypatch):
    """Of a process with other sources, and of one that has loaded what the project was before an edit."""
    keys = map(str, count())
    monkeypatch.setattr(workers, "hash_cell", lambda *cell: next(keys))
    with pytest.raises(SourcesChanged, match="other sources than the program"):
        run_study(make(), tmp_path, 5)
    monkeypatch.undo()
    monkeypatch.setattr(row_key, "_LOADED", "before")
    with pytest.raises(SourcesChanged, match="the project was edited since it was loaded"):
        run_study(make(), tmp_path, 5)
    assert not read_rows(tmp_path)
