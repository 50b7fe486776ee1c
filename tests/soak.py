"""Random commands, two at once, killed, on a full disk, on a cluster that loses workers: nothing lost, nothing left behind.

python -m tests.soak --minutes 30 --seed 1

Actions come in rounds. A round has an event, folders and workers of its own, so that there is work to do. An action is a
command or two rivals, each perhaps with a fault; what had a fault is run again. A round ends with the same tables, made
without a fault in a fresh folder: they must be equal. Seed and number draw an action; where a fault meets it is chance.
"""

import argparse
import json
import logging
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from math import inf
from multiprocessing import resource_tracker
from pathlib import Path
from threading import Timer
from typing import Any

import pandas as pd
import psutil  # comes with `distributed`
from distributed import LocalCluster

from alloc.recording import load
from alloc.sources import ASIDE
from studies.core.interruption import listen
from studies.core.store import MEASURED, ROWS, Store, _differences
from studies.core.study import find_study
from tests.studies.conftest import SHORT

MARK = "READHESION_SOAK"
"""Environment variable of all processes of a command; its value names the command."""
ENTRY = "from studies.command_line.__main__ import main; main()"
NO_FORK = (
    "import sys, types, studies.core.run as w; "
    f"w.sys = types.SimpleNamespace(platform='other', stderr=sys.stderr); {ENTRY}"
)
"""The command as on a system whose workers are not forks."""
RULES = ("alone", "greedy", "exact", "qp", "preset")
CONTROLLERS = ("none", "cut-and-ramp", "perturb-observe")
STUDIES = ("claims", "differences")
MOST = 4
"""Seeds of a comparison, events of a study in its steps."""
KINDS = {"compare": 5, "sweep": 5, "simulate": 2, "analyse": 2, "report": 2, "merge": 2, "cite": 1}
"""Commands, and how often each is drawn."""
CODES = {
    "none": {0}, "KILL": {0, -signal.SIGKILL}, "INT": {0, 130}, "TERM": {0, 143}, "keyboard": {0, 130},
    "full disk": {0, 2}, "worker": {0, 2}, "worker of the cluster": {0},
}  # fmt: skip
"""Faults, and the exit codes that a command may have then; 0 also where a fault came too late."""
BAD_WORDS = ("Traceback", "Exception ignored", ".broken-")
WHOLE = (".json", ".nc", ".csv", ".html")
"""Endings of files that must be whole."""
ROUND = 24
"""Actions of a round."""
DISK = 12
"""Size of the small disk [MB]."""
PATIENCE, GRACE = 240.0, 20.0
"""Longest time of a command, and within which its processes are gone after it [s]."""


@dataclass
class Command:
    """A command line, who works for it, and the fault that it meets."""

    words: list[str]
    entry: str = ENTRY
    fault: str = "none"
    cluster: LocalCluster | None = None
    met: bool = field(default=False, init=False)
    """Whether the fault came before the end."""

    def start(self, name: str, scratch: Path) -> None:
        """Begin; `name` marks its processes."""
        self.name = name
        self.files = [scratch / f"{name}.out", scratch / f"{name}.err"]
        with open(self.files[0], "wb") as out, open(self.files[1], "wb") as err:
            self.process = subprocess.Popen(
                [sys.executable, "-c", self.entry, *self.words],
                stdout=out, stderr=err, start_new_session=True,
                env=os.environ | {MARK: name, "TMPDIR": str(scratch)},
            )  # fmt: skip

    def inject(self, disk: Path | None, luck: float) -> None:
        """The fault, now."""
        with suppress(ProcessLookupError, psutil.NoSuchProcess):
            if self.fault == "full disk":
                with suppress(OSError), open(f"{disk}/ballast", "wb") as file:
                    free = shutil.disk_usage(str(disk)).free - int(luck * 100_000)
                    os.posix_fallocate(file.fileno(), 0, max(free, 1))
                self.met = self.process.poll() is None
            elif self.fault.startswith("worker"):
                pids: list[int] = []
                while not pids and self.process.poll() is None:
                    time.sleep(0.05)
                    pids = [one.pid for one in self.workers() if one.pid]
                self.met = bool(pids)
                if pids:
                    os.kill(pids[int(luck * len(pids))], signal.SIGKILL)
            else:
                number = getattr(signal, f"SIG{self.fault.replace('keyboard', 'INT')}")
                while self.process.poll() is None and not self.listens():
                    time.sleep(0.02)
                self.met = self.process.poll() is None
                (os.killpg if self.fault == "keyboard" else os.kill)(self.process.pid, number)

    def workers(self) -> list[Any]:
        """Those who work for it; joblib's process that tidies up is none."""
        if self.cluster is not None:
            return list(self.cluster.workers.values())
        known = psutil.Process(self.process.pid).children(recursive=True)
        return [one for one in known if "resource_tracker" not in " ".join(one.cmdline())]

    def listens(self) -> bool:
        """Whether it handles SIGTERM yet, where the system tells: until then Python starts."""
        with suppress(OSError, StopIteration), open(f"/proc/{self.process.pid}/status") as file:
            mask = next(line for line in file if line.startswith("SigCgt"))
            return bool(int(mask.split()[1], 16) >> signal.SIGTERM - 1 & 1)
        return True

    def end(self) -> tuple[int, str, str]:
        """Exit code, stdout and stderr; a command that hangs is killed."""
        try:
            code = self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            code = 999
            os.killpg(self.process.pid, signal.SIGKILL)
        out, err = (file.read_text() for file in self.files)
        for file in self.files:
            file.unlink()
        return code, out, err


def tables(folder: Path) -> dict[tuple[Path, str], pd.DataFrame]:
    """Every table below `folder`, in the order of its cells."""
    places = sorted(path.parent for path in folder.rglob(ROWS))
    read = {(folder, str(place.relative_to(folder))): Store(place).read() for place in places}
    return {name: table.sort_values("cell", kind="stable") for name, table in read.items()}


def lost(before: pd.DataFrame, after: pd.DataFrame, again: bool = True) -> str:
    """What of `before` is not in `after`, in words; `again`: whether it may have been computed again."""
    gone = set(before["cell"]) - set(after["cell"])
    if gone:
        return f"{len(gone)} of {before['cell'].nunique()} cells are gone, such as {min(gone)}"
    same = after[after["cell"].isin(before["cell"])]
    number, words = _differences(before, same)
    if not number and not again and before["wall_time"].tolist() != same["wall_time"].tolist():
        return "stored rows were computed again"
    return f"{number} cells differ: {words}" if number else ""


def untimed(value: Any) -> Any:
    """JSON without times of computing."""
    if isinstance(value, dict):
        return {k: untimed(v) for k, v in value.items() if not k.startswith(MEASURED)}
    return [untimed(one) for one in value] if isinstance(value, list) else value


def incomplete(path: Path) -> str:
    """Why a file is not whole, in words."""
    try:
        if path.suffix == ".nc":
            load(path)
            return ""
        text = path.read_text()
        if path.suffix == ".json":
            json.loads(text)
        elif path.suffix == ".html":
            assert text.rstrip().endswith("</html>")
        else:
            first, *_, last, end = text.split("\n")
            assert (last.count(","), end) == (first.count(","), "")
    except Exception as error:
        return f"of {path.stat().st_size} bytes is not whole: {error!r:.200}"
    return ""


def processes(mark: str) -> list[psutil.Process]:
    """What still runs of a command, after a while of grace."""
    end = time.monotonic() + GRACE
    while True:
        found = []
        for process in psutil.process_iter():
            with suppress(psutil.Error, OSError):
                if process.environ().get(MARK) == mark:
                    found.append(process)
        if not found or time.monotonic() > end:
            return found
        time.sleep(0.1)


class Soak:
    """The actions of a seed, and what was seen."""

    def __init__(self, base: Path, seed: int, disk: Path | None) -> None:
        self.base, self.seed, self.disk = base, seed, disk
        self.kinds: Counter[str] = Counter()
        self.faults: Counter[str] = Counter()
        self.failures: list[str] = []
        self.rows = self.commands = 0
        self.usual: dict[str, float] = {}
        """What a command of each kind took without a fault [s]."""
        self.number = self.round = -1
        self.stack = ExitStack()
        resource_tracker.ensure_running()  # else it would begin, and seem to stay, with a cluster

    def check(self, fits: bool, words: str) -> None:
        """Keep and print the words where something does not fit."""
        if not fits:
            self.failures.append(f"seed {self.seed}, action {self.number}: {words}")
            print(self.failures[-1], flush=True)

    def begin(self) -> None:
        """A new round."""
        self.round = self.number // ROUND
        self.here = self.base / f"round-{self.round}"
        self.scratch = self.here / "scratch"
        self.folders = [self.here / "results", *([self.disk / "results"] if self.disk else [])]
        for folder in (self.scratch, *self.folders):
            folder.mkdir(parents=True)
        level = 0.04 + 1e-4 * random.Random(f"{self.seed} {self.round}").randrange(400)
        self.event, self.log = self.here / "short.toml", self.here / "log.csv"
        self.event.write_text(SHORT.replace("level = 0.05", f"level = {level:.4f}"))
        self.stored: dict[tuple[Path, str], pd.DataFrame] = {}
        self.files: dict[Path, int] = {}
        self.places = [*self.folders, self.here / "merged"]
        self.litter: set[Path] = set()
        self.said: dict[str, Any] = {}
        self.used: set[str] = set()
        self.cluster: LocalCluster | None = None
        self.run(Command(["simulate", str(self.event), "--log", str(self.log)]))

    def name(self, number: object = "cluster") -> str:
        """Of a command, or of this round's cluster, here and now."""
        return f"{os.getpid()}-{self.round}-{number}"

    def workers(self) -> LocalCluster:
        """The cluster of this round."""
        if self.cluster is None:
            os.environ[MARK] = self.name()
            quiet: Any = {"silence_logs": logging.CRITICAL + 1, "dashboard_address": "127.0.0.1:0"}
            made = LocalCluster(2, threads_per_worker=1, local_directory=str(self.base), **quiet)
            self.cluster = self.stack.enter_context(made)
        return self.cluster

    def draw(self, rng: random.Random, folder: Path) -> Command:
        """A command, and one of the faults that it can meet."""
        (kind,) = rng.choices(list(KINDS), list(KINDS.values()))
        rules = rng.sample(RULES, rng.randint(1, len(RULES)))
        controllers = rng.sample(CONTROLLERS, rng.randint(1, len(CONTROLLERS)))
        one = ["--rule", rules[0], "--controller", controllers[0], "--json"]
        run = folder / f"{rules[0]}-{controllers[0]}"
        study = rng.choice(STUDIES)
        tabled = kind in ("compare", "sweep", "report")
        if kind == "sweep":
            words = self.tabled(study, folder, count=rng.randint(1, MOST))
        elif tabled:
            words = self.tabled(kind, folder, rules, controllers, rng.randint(1, MOST))
            if kind == "compare" and rng.random() < 0.7:
                more = ([], [], ["--keep", "*/cut-and-ramp/0"], ["--shard", "1/2"])
                words += ["--no-figures", *rng.choice(more)]
        elif kind == "simulate":
            words = ["simulate", str(self.event), *one, "--out", f"{run}.nc", "--log", f"{run}.csv"]
        elif kind == "analyse":
            words = ["analyse", str(self.log), "--train", str(self.log.with_suffix(".train.toml"))]
            words += ["--out", f"{folder}/reports", "--events", f"{folder}/slips.csv", "--json"]
        else:
            full = sorted({place for place, _ in self.stored} & set(self.folders))
            words = ["merge", *map(str, full), "--out", str(self.here / "merged")]
            if kind == "cite" or not full:
                words = ["cite", str(self.event), *one]
        made = Command(words)
        where = rng.choice(["fork", "fork", "other", "cluster"]) if tabled else ""
        if where == "cluster" and kind != "report":
            made.cluster = self.workers()
            words += ["--executor", "dask", "--scheduler", made.cluster.scheduler_address]
        elif tabled:
            made.entry = NO_FORK if where == "other" else ENTRY
            words += ["--jobs", str(rng.randint(1, 3))]
        never = {"worker"} if made.cluster or not tabled else set()
        never |= set() if made.cluster else {"worker of the cluster"}
        never |= set() if folder in self.folders[1:] else {"full disk"}
        made.fault = rng.choice([fault for fault in ("none", *CODES) if fault not in never])
        return made

    def tabled(
        self, kind: str, folder: Path, rules: Sequence[str] = RULES,
        controllers: Sequence[str] = CONTROLLERS, count: int = MOST,
    ) -> list[str]:  # fmt: skip
        """A command that makes rows; all that a round can have, if nothing is said."""
        self.used |= {kind}
        place = ["--results", str(folder), "--out", f"{folder}/report.html"]
        place = place if kind == "report" else ["--out", str(folder)]
        if kind in STUDIES:
            events = ["--events", str(count * find_study(kind).step), "--seed", str(self.round)]
            return ["sweep", kind, *events, *place]
        words = [kind, "--scenario", str(self.event), "--rules", *rules]
        return [*words, "--controllers", *controllers, "--seeds", str(count), *place]

    def act(self) -> None:
        """The next action."""
        self.number += 1
        if self.number // ROUND != self.round:
            self.close()
            self.begin()
        rng = random.Random(f"{self.seed} {self.number}")
        folder = rng.choice(self.folders)
        commands = [self.draw(rng, folder) for _ in range(rng.choice((1, 1, 2)))]
        self.kinds.update(command.words[0] for command in commands)
        self.kinds["two at once"] += len(commands) == 2
        self.run(*commands, rng=rng)
        for one in commands:
            self.faults[one.fault] += one.met
            if one.fault != "none":
                self.run(Command(one.words, one.entry, cluster=one.cluster))

    def run(self, *commands: Command, rng: random.Random | None = None) -> None:
        """Run these at once, with their faults, and look at what they leave."""
        timers = []
        for command in commands:
            self.commands += 1
            command.start(self.name(self.commands), self.scratch)
            if rng is not None and command.fault != "none":
                delay = rng.random() * self.usual.get(command.words[0], 4.0)
                timers.append(Timer(delay, command.inject, (self.disk, rng.random())))
                timers[-1].start()
        began = time.monotonic()
        try:
            ended = [command.end() for command in commands]
        finally:
            for timer in timers:
                timer.cancel()
                timer.join()
            for command in commands:  # of which an end by a signal leaves some
                command.process.kill()
            if self.disk:
                (self.disk / "ballast").unlink(missing_ok=True)
        faults = {command.fault for command in commands}
        if faults == {"none"} and len(commands) == 1:
            self.usual[commands[0].words[0]] = time.monotonic() - began
        for command, (code, out, err) in zip(commands, ended, strict=True):
            self.judge(command, faults, code, out, err)
        self.look("KILL" in faults, any("--keep" in command.words for command in commands))

    def judge(self, command: Command, faults: set[str], code: int, out: str, err: str) -> None:
        """How a command ended."""
        allowed = CODES[command.fault] | (CODES["full disk"] if "full disk" in faults else set())
        where = f"{command.fault} {'' if command.met else 'not '}met by {' '.join(command.words)}"
        where += f"; it said: {' | '.join(err.strip().splitlines()[-25:])}"
        left = processes(command.name)
        self.check(code in allowed, f"exit code {code}, {where}")
        self.check(not any(word in err for word in BAD_WORDS), where)
        self.check(code <= 0 or "readhesion: " in err, f"no word of exit code {code}, {where}")
        self.check(not left, f"{len(left)} processes are left, {where}")
        for process in left:
            with suppress(psutil.Error):
                process.kill()
        if code == 0 and "--json" in command.words:
            found = untimed(json.loads(out))
            before = self.said.setdefault(" ".join(command.words), found)
            self.check(found == before, f"it gave other numbers than before: {where}")

    def look(self, killed: bool, again: bool) -> None:
        """What the folders hold."""
        present = [path for place in self.places for path in place.rglob("*.*")]
        litter = {path for path in present if ASIDE in path.name}
        litter |= {one for one in self.scratch.iterdir() if not one.name.startswith("readhesion-")}
        new = sorted(litter - self.litter)
        self.check(killed or not new, f"litter is left: {new[:3]}")
        self.litter |= litter
        for place in self.places:
            with warnings.catch_warnings(record=True) as caught:
                now = tables(place)
            self.check(not caught, f"{place}: {[str(one.message) for one in caught]}")
            for name, before in self.stored.items():
                if name[0] == place:
                    self.rows += len(before)
                    other = again or place.name == "merged"
                    words = lost(before, now.get(name, before[:0]), other)
                    self.check(not words, f"{name[1]} of {place}: {words}")
            self.stored |= now
            for table in now.values():
                failed = table[table["status"] != "ok"]
                self.check(failed.empty, f"{place}: {failed['reason'].tolist()[:1]}")
        whole = [path for path in present if path.suffix in WHOLE and path not in litter]
        files = {path: path.stat().st_mtime_ns for path in whole if path.parent.name != "figures"}
        for path in files.keys() | self.files.keys():
            words = "is gone"
            if path in files:
                words = "" if files[path] == self.files.get(path) else incomplete(path)
            self.check(not words, f"{path} {words}")
        self.files = files

    def close(self) -> None:
        """The end of a round: all its tables, also made without a fault in a fresh folder."""
        if self.round < 0:
            return
        kinds = sorted(self.used - ({"compare"} if "report" in self.used else set()))
        clean = self.here / "clean"
        clean.mkdir()
        for folder in (*self.folders, clean):
            for kind in kinds:
                self.run(Command(self.tabled(kind, folder)))
        whole = {name: table for (_, name), table in tables(clean).items()}
        for (folder, name), table in self.stored.items():
            self.rows += len(table)
            made = whole.get(name, table[:0])
            words = lost(table, made)
            self.check(not words, f"{name} of {folder} is not as without faults: {words}")
            some = folder in self.folders and len(table) != len(made)
            self.check(not some, f"{name} of {folder} has {len(table)} of {len(made)} rows")
        self.stack.close()
        self.check(not processes(self.name()), "workers of the cluster are left")
        for folder in (self.here, *self.folders[1:]):
            shutil.rmtree(folder)
        self.round = -1


@contextmanager
def small_disk(place: Path) -> Iterator[Path | None]:
    """A file system of `DISK` MB; None where one may not mount."""
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={DISK}m", "tmpfs", str(place)]
    if not shutil.which("mount") or subprocess.run(mount, capture_output=True).returncode:
        print("no full disk: this user may not mount a small one")
        yield None
        return
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)


def soak(
    base: Path,
    seed: int,
    disk: Path | None,
    minutes: float = inf,
    actions: int = -1,
    first: int = 0,
) -> list[str]:
    """Act for so long, or so many times; prints a summary and returns what was wrong."""
    began = time.monotonic()
    one = Soak(base, seed, disk)
    one.number = first - 1
    with suppress(KeyboardInterrupt), one.stack:
        while time.monotonic() - began < 60 * minutes and one.number - first + 1 != actions:
            one.act()
        one.close()
    kinds, met = (
        ", ".join(f"{name} {count}" for name, count in sorted(counts.items()) if count)
        for counts in (one.kinds, one.faults)
    )
    took = (time.monotonic() - began) / 60
    print(f"seed {seed}: {one.number - first + 1} actions in {took:.1f} minutes")
    print(f"{one.commands} commands, with those run again or for comparison; drawn: {kinds}")
    print(f"faults met: {met}\n{one.rows} rows compared, {len(one.failures)} failures")
    return one.failures


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument(
        "--actions", type=int, default=-1, help="number of actions, if that is less"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first action")
    given = vars(parser.parse_args())
    listen()  # an end by a signal ends what it started too
    with (
        tempfile.TemporaryDirectory(prefix="soak-") as folder,
        small_disk(Path(folder) / "disk") as small,
    ):
        failures = soak(Path(folder), disk=small, **given)
    sys.exit(1 if failures else 0)
