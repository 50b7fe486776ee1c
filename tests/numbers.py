"""Numbers of README and docs: what each is computed from, what is stored of it, and whether a page still says so.

`docs/numbers.toml` names the numbers, `docs/results` keeps what was computed, `docs/tables` has the tables that are made of
it, and `docs/developing.md` explains them. Tests compare pages, tables, manifest and stored values. `python -m tests.numbers
compute STUDY` computes a study's values again, stores them, and writes tables and sentences.
"""

import argparse
import hashlib
import json
import re
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from functools import cache
from itertools import product
from pathlib import Path
from string import Formatter
from typing import Any

import joblib

ROOT = Path(__file__).parents[1]
MANIFEST = ROOT / "docs" / "numbers.toml"
STORED = ROOT / "docs" / "results"
TABLES = ROOT / "docs" / "tables"
GUARDS = ROOT / "tests" / "results_hash.json"
OVER_ROWS = {"mean": 1, "median": 1, "max": 1, "sum": 1, "count": 1, "interval": 3}
"""What a cell may ask of a column of a study's table -> how many values that gives; an interval is mean, low and high."""
SLOTS = {
    "f": r"([-+]?\d+(?:\.\d+)?)",
    "s": r"([a-z, ]+?)",
}
"""Kind of a slot -> what a sentence may have in it: numbers, and words of verdicts."""


@dataclass(frozen=True)
class Source:
    """What is run: a study with its events and seed, or the comparison."""

    name: str
    study: str
    events: int | None
    seed: int
    settings: Mapping[str, Any]
    """Options of the study beside these."""
    compared: Mapping[str, Any] | None
    """Options of `readhesion compare`, where it is no study that runs."""
    module: str | None
    """Module whose `measured` gives the table, called with the settings, where it is neither a study nor the comparison."""
    before: str
    """What has changed since the values were computed, and is not in them; empty where nothing has."""
    guard: tuple[str, ...]
    """Patterns of names in `tests/results_hash.json`: where numbers of one of these change, the values count as old."""

    @property
    def command(self) -> str:
        """The command that runs it."""
        if self.compared is not None:
            words = [f"--{key} {_words(value)}" for key, value in self.compared.items()]
            return " ".join(["readhesion compare", *words])
        words = [f"--{key} {_words(value)}" for key, value in self.settings.items()]
        if self.module is not None:
            return " ".join([f"python -m {self.module}", *words])
        start = f"readhesion sweep {self.study} --events {self.events} --seed {self.seed}"
        return " ".join([start, *words])

    def guard_digest(self) -> str:
        """One hash of the hashes of all numbers that guard it."""
        hashes = json.loads(GUARDS.read_text())["hashes"]
        chosen = {
            name: three.split()[1]
            for name, three in hashes.items()
            if any(fnmatch(name, one) for one in self.guard)
        }
        if not chosen:
            raise ValueError(f"{self.name}: no stored hash has a name like {self.guard}")
        return hashlib.sha256(json.dumps(chosen, sort_keys=True).encode()).hexdigest()[:16]

    @property
    def path(self) -> Path:
        """File of its stored values."""
        return STORED / f"{self.name}.json"


def _words(value: Any) -> str:
    return " ".join(value) if isinstance(value, list) else str(value)


@dataclass(frozen=True)
class Number:
    """Some numbers of one sentence or table row: the text with a slot for each, and where they come from."""

    pages: tuple[str, ...]
    text: str
    cells: tuple[str, ...]
    """`study | statement | number | parts * factor`, or `study | mean | column * factor | column=value; ...`."""

    @property
    def sources(self) -> set[str]:
        """Studies that it needs."""
        return {cell.split(" | ")[0] for cell in self.cells}

    def filled(self, stored: Mapping[str, Mapping[str, Any]]) -> list[str]:
        """What each slot shows, from values stored by study and cell."""
        values = []
        for cell in self.cells:
            name = cell.split(" | ")[0]
            if cell not in stored[name]:
                raise ValueError(f"{cell!r} is not stored: make results STUDY={name}")
            values += stored[name][cell]
        forms = [spec for _, _, spec, _ in Formatter().parse(self.text) if spec is not None]
        if len(forms) != len(values):
            raise ValueError(f"{self.text!r} has {len(forms)} slots for {len(values)} values")
        return [_shown(value, form) for value, form in zip(values, forms, strict=True)]

    def pattern(self) -> re.Pattern[str]:
        """The text as it may stand on a page: any white space between words, anything that fits in a slot."""
        parts = []
        for words, _, spec, _ in Formatter().parse(self.text):
            parts.append(re.sub(r"(?:\\ )+", r"\\s+", re.escape(words)))
            if spec is not None:
                parts.append(SLOTS[spec[-1:] or "s"])
        return re.compile("".join(parts))

    def line(self, stored: Mapping[str, Mapping[str, Any]]) -> str:
        """The text with its values."""
        values = iter(self.filled(stored))
        parts = Formatter().parse(self.text)
        return "".join(
            words + ("" if form is None else next(values)) for words, _, form, _ in parts
        )


@dataclass(frozen=True)
class Table:
    """A table that pages include: its heading, and a text with its cells for each row."""

    name: str
    head: str
    rows: tuple[Number, ...]

    @property
    def path(self) -> Path:
        """File of the table."""
        return TABLES / f"{self.name}.md"

    def made(self, stored: Mapping[str, Mapping[str, Any]]) -> str:
        """The table as Markdown, from values stored by study and cell; columns of numbers stand at the right."""
        lines = [row.line(stored) for row in self.rows]
        columns = zip(*(line[1:-1].split("|") for line in lines), strict=True)
        numeric = [all(re.match(r" *([-+>\d]|$)", one) for one in column) for column in columns]
        sides = ["--:" if one else "---" for one in numeric]
        known = sources()
        needed = sorted({name for row in self.rows for name in row.sources})
        changed = dict.fromkeys(known[name].before for name in needed if known[name].before)
        notes = [f"\n*Computed before {one}.*" for one in changed]
        return "\n".join([self.head, f"|{'|'.join(sides)}|", *lines, *notes, ""])


def expanded(cell: str) -> list[str]:
    """A cell for each of its alternatives `<one; other>`; those that stand first change fastest."""
    parts = re.split(r"<(.*?)>", cell)
    choices = [part.split("; ") if k % 2 else [part] for k, part in enumerate(parts)]
    return ["".join(reversed(one)) for one in product(*reversed(choices))]


def _rows(part: Mapping[str, Any]) -> Iterator[Number]:
    """The rows of a part: `$1`, `$2` in text and cells stand for the words of each row."""
    for row in part.get("rows", [[]]):
        words = [row] if isinstance(row, str) else row
        text, *cells = [
            re.sub(r"\$(\d)", lambda match, words=words: words[int(match[1]) - 1], one)
            for one in (part["text"], *part.get("cells", []))
        ]
        yield Number((), text, tuple(cell for one in cells for cell in expanded(one)))


def _shown(value: Any, form: str) -> str:
    """A value in a slot; what is rounded to zero has no minus."""
    text = format(value, form)
    return text if isinstance(value, str) or float(text) else format(0.0, form)


@cache
def manifest() -> dict[str, Any]:
    """The manifest as it is written."""
    return tomllib.loads(MANIFEST.read_text(encoding="utf-8"))


def sources() -> dict[str, Source]:
    """Every source by name."""
    return {
        name: Source(
            name,
            entry.get("study", name),
            entry.get("events"),
            entry.get("seed", 0),
            entry.get("settings", {}),
            entry.get("compare"),
            entry.get("module"),
            entry.get("before", ""),
            tuple(entry["guard"]),
        )
        for name, entry in manifest()["study"].items()
    }


def numbers() -> list[Number]:
    """Every entry in its order."""
    return [
        Number(tuple(entry["pages"]), entry["text"], tuple(entry["cells"]))
        for entry in manifest()["number"]
    ]


def tables() -> list[Table]:
    """Every table in its order."""
    return [
        Table(name, entry["head"], tuple(row for part in parts for row in _rows(part)))
        for name, entry in manifest()["table"].items()
        for parts in [[entry, *entry.get("more", [])]]
    ]


def cells_of(name: str) -> list[str]:
    """Cells that the manifest asks of a source."""
    rows = [row for table in tables() for row in table.rows]
    found = [cell for number in (*rows, *numbers()) for cell in number.cells]
    return list(dict.fromkeys(cell for cell in found if cell.split(" | ")[0] == name))


def stored() -> dict[str, dict[str, Any]]:
    """Stored values by source and cell."""
    return {
        name: json.loads(source.path.read_text())["values"] if source.path.exists() else {}
        for name, source in sources().items()
    }


def drifts(
    number: Number, page: str, text: str, values: Mapping[str, Mapping[str, Any]]
) -> Iterator[str]:
    """What a page says otherwise than the stored values, in words."""
    expected = number.filled(values)
    found = list(number.pattern().finditer(text))
    if not found:
        yield f"{page} has no text like {number.text!r}"
    for match in found:
        for shown, value, cell in zip(match.groups(), expected, _per_slot(number), strict=True):
            if shown != value:
                yield f"{page} says {shown} where {cell!r} is {value}: make results STUDY={cell.split(' | ')[0]}"


def _per_slot(number: Number) -> list[str]:
    return [cell for cell in number.cells for _ in _parts(cell)]


def _parts(cell: str) -> list[str]:
    words = cell.split(" | ")
    if words[1] in OVER_ROWS:
        return [words[1]] * OVER_ROWS[words[1]]
    return words[-1].partition(" * ")[0].split(", ")


def rewritten(number: Number, text: str, values: Mapping[str, Mapping[str, Any]]) -> str:
    """The page's text with the stored values in the slots; white space stays."""
    expected = number.filled(values)

    def fill(match: re.Match[str]) -> str:
        whole, start, parts = match.group(), match.start(), []
        last = 0
        for k, value in enumerate(expected, 1):
            parts += [whole[last : match.start(k) - start], value]
            last = match.end(k) - start
        return "".join([*parts, whole[last:]])

    return number.pattern().sub(fill, text)


def unnamed(text: str, entries: Sequence[Number], given: Sequence[str]) -> list[str]:
    """Numbers of a page that neither an entry nor `given` (patterns of what is no result) covers."""
    text = re.sub(r"```.*?```", " ", text, flags=re.DOTALL)
    text = re.sub(r"\]\([^)]*\)", "]", text)
    for pattern in [*(one.pattern() for one in entries), *(re.compile(one) for one in given)]:
        text = pattern.sub(" ", text)
    return re.findall(r"\S*\d\S*", text)


def compute(names: Sequence[str], folder: Path, jobs: int) -> None:
    """Compute sources, store their values, write them into the pages."""
    from tests.study_values import StudyValues

    for name in names:
        source = sources()[name]
        print(f"{name}: {source.command}", flush=True)
        values_of = StudyValues(source, folder, jobs)
        content = {
            "command": source.command,
            "guard": source.guard_digest(),
            "values": {cell: values_of(cell) for cell in cells_of(name)},
        }
        STORED.mkdir(exist_ok=True)
        source.path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    write(names)


def write(names: Sequence[str]) -> None:
    """Write what is stored of these sources into tables and pages."""
    values = stored()
    TABLES.mkdir(exist_ok=True)
    for table in tables():
        needed = {name for row in table.rows for name in row.sources}
        if needed & set(names) and all(values[one] for one in needed):
            table.path.write_text(table.made(values), encoding="utf-8")
    for number in numbers():
        if number.sources & set(names) and all(values[one] for one in number.sources):
            for page in number.pages:
                path = ROOT / page
                before = path.read_text(encoding="utf-8")
                after = rewritten(number, before, values)
                if after != before:
                    path.write_text(after, encoding="utf-8")
                for words in drifts(number, page, after, values):
                    print(f"  {words}")


def main() -> int:
    """Compute, write into pages what is stored, or list the sources with their commands."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("task", choices=("list", "compute", "write"))
    parser.add_argument("studies", nargs="*", metavar="STUDY", help="all without it")
    parser.add_argument("--out", type=Path, default=ROOT / "results", help="folder of results")
    parser.add_argument("--jobs", type=int, default=joblib.cpu_count())
    chosen = parser.parse_args()
    unknown = set(chosen.studies) - set(sources())
    if unknown:
        parser.error(
            f"no number comes from {', '.join(sorted(unknown))}; known: {', '.join(sources())}"
        )
    names = chosen.studies or list(sources())
    if chosen.task == "compute":
        compute(names, chosen.out, chosen.jobs)
    elif chosen.task == "write":
        write(names)
    else:
        for source in sources().values():
            print(f"{source.name}: {source.command}; {len(cells_of(source.name))} cells")
    return 0


if __name__ == "__main__":
    sys.exit(main())
