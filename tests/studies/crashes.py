"""Kill a study at random moments of its work and damage its files; says what became of the table.

python -m tests.studies.crashes FOLDER TRIALS SEED
"""

import os
import signal
import sys
import time
import warnings
from pathlib import Path

import numpy as np

import studies.core.run
import studies.core.store
from studies.core.cell import Task
from studies.core.run import run_cells
from studies.core.store import Store


def square(k: int) -> dict[str, object]:
    return {"k": k, "square": float(k) ** 2, "label": f"number {k}"}


def cells(count: int) -> list[Task]:
    return [Task(str(k), square, (k,)) for k in range(count)]


def compute(folder: Path, count: int):
    with warnings.catch_warnings(action="ignore"):
        return run_cells(cells(count), Store(folder))


def begin(folder: Path, count: int) -> int:
    """Compute in a process of its own."""
    child = os.fork()
    if child == 0:
        try:
            compute(folder, count)
        finally:
            os._exit(0)
    return child


def damage(folder: Path, rng: np.random.Generator) -> str:
    """Truncate, empty, overwrite, delete or change one bit of a file of the study."""
    names = sorted(path.name for path in folder.glob("rows/*.parquet"))
    if not names:
        return "nothing"
    path = folder / "rows" / str(rng.choice(names))
    content = bytearray(path.read_bytes())
    how = str(rng.choice(["truncated", "emptied", "overwritten", "deleted", "flipped"]))
    place = int(rng.integers(max(len(content), 1)))
    if how == "deleted":
        path.unlink()
        return how
    if how == "flipped" and content:
        content[place] ^= 1 << int(rng.integers(8))
    elif how == "overwritten":
        content[place:] = rng.bytes(len(content) - place)
    else:
        content = content[: place if how == "truncated" else 0]
    path.write_bytes(content)
    return how


def rows(folder: Path) -> int:
    with warnings.catch_warnings(action="ignore"):
        return len(Store(folder).read())


def main(folder: Path, trials: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    studies.core.run.FLUSH_INTERVAL = 0.01
    studies.core.store.FULL, studies.core.store.MANY, studies.core.store.LARGE = 16, 4, 64
    studies.core.store.AGE = -1.0
    kills = damages = 0
    started = time.monotonic()
    os.waitpid(begin(folder / "timed", 20), 0)
    longest = 1.5 * (time.monotonic() - started)
    for trial in range(trials):
        before = rows(folder)
        for child in [begin(folder, 20 + trial) for _ in range(int(rng.integers(1, 3)))]:
            time.sleep(rng.uniform(0.0, longest))
            os.kill(child, signal.SIGKILL)
            killed = os.WIFSIGNALED(os.waitpid(child, 0)[1])
            kills += killed
        assert rows(folder) >= before, "a kill lost rows"
        if rng.random() < 0.3:
            damages += damage(folder, rng) != "nothing"
    table = compute(folder, 20 + trials)
    broken = len(list(folder.glob("rows/*.broken-*")))
    columns = ["k", "square", "label", "status", "cell", "code_hash"]
    whole = compute(folder / "uninterrupted", 20 + trials)
    assert table[columns].equals(whole[columns]), "the table differs from an uninterrupted one"
    print(f"{kills} kills, {damages} damages, {broken} files set aside, {len(table)} rows: equal")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
