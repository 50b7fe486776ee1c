"""What there is and what belongs to it: `readhesion list`, `check`, `schema`, `new-scenario`."""

import hashlib
import json
import sys
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from studies.command_line.options import FilePath, console
from studies.files.study_error import StudyError
from studies.files.writable import check_file, check_place, make_folder


def list_names(*, as_json: Annotated[bool, Parameter("--json", negative=())] = False) -> None:
    """List scenarios, rules, controllers, train sets, sweeps, figures, metrics and columns of logs.

    Parameters
    ----------
    as_json
        Print JSON instead of tables.
    """
    from rich.markup import escape
    from rich.table import Table

    content = _kept_catalogue()
    if as_json:
        print(json.dumps(content, indent=2))
        return
    screen = console()
    for kind, entries in content.items():
        table = Table(title=f"[bold]{kind}[/bold]", title_justify="left", show_header=False)
        table.add_column(no_wrap=True)
        table.add_column()
        for name, meaning in entries.items():
            table.add_row(escape(name), escape(meaning))
        screen.print(table)


# `readhesion check`: the conformance kit on a rule, a readhesion controller or an adhesion curve.


def check(
    name: str,
    *,
    promise: str | None = None,
    as_json: Annotated[bool, Parameter("--json", negative=())] = False,
) -> int:
    """Ask a rule, a controller or an adhesion curve whether it keeps the laws of its kind; exit code 1 where it does not.

    Parameters
    ----------
    name
        Name of the part, one of a plug-in too.
    promise
        What is asked of a rule: exact, reference, heuristic or baseline [default: what it promises].
    as_json
        Print JSON instead of a table.
    """
    from rich.markup import escape
    from rich.table import Table

    from alloc.plant.adhesion import CURVES
    from alloc.rules.rule import PROMISES, Rule
    from alloc.rules.testing import measured, verdict
    from alloc.testing import laws_of_part
    from studies.core.own_parts import registry_of
    from studies.files.study_error import StudyError

    registry = registry_of(name)
    part = registry[name]() if registry is CURVES else registry[name]
    if promise is not None:
        if not isinstance(part, Rule) or promise not in PROMISES:
            raise StudyError(f"--promise {promise}: give one of {', '.join(PROMISES)}, of a rule")
        part = part.promising(promise)
    found = [verdict(law, part) for law in laws_of_part(part)]
    broken = [one for one in found if one.fault]
    if as_json:
        rows = [
            {"law": one.law.name, "meaning": one.law.meaning, "kept": not one.fault, "worst": str(one.worst),
             "fault": one.fault, "counterexample": one.counterexample}
            for one in found
        ]  # fmt: skip
        print(json.dumps({"name": name, "kind": registry.kind, "laws": rows}, indent=2))
        return int(bool(broken))
    screen = console()
    table = Table(title=f"{registry.kind} {name}", title_justify="left")
    for heading in ("law", "kept", "worst", "meaning"):
        table.add_column(heading)
    for one in found:
        kept = "no" if one.fault else "yes"
        table.add_row(one.law.name, kept, f"{one.worst:.2g}", escape(one.law.meaning))
    screen.print(table)
    for one in broken:
        screen.print(f"[bold]{one.law.name}[/bold]: {escape(one.fault)}; worst {one.worst:.3g}")
        screen.print(f"  counterexample: {escape(one.counterexample)}", soft_wrap=True)
    if isinstance(part, Rule) and not broken:
        beside = measured(part)
        screen.print(
            f"8 units on slippery rail: gap to the exact level {100 * beside.gap:.2f} % of the plan, that of the reference "
            f"rule {100 * beside.reference_gap:.2f} %; over-delivery {100 * beside.over_delivery:.2f} %; "
            f"{1e6 * beside.time:.0f} µs a call"
        )
    return int(bool(broken))


# `readhesion schema`: every key of the project's own files, for editors and for readers.


def schema(
    kind: Literal["scenario", "train", "line"] | None = None,
    *,
    reference: Annotated[bool, Parameter(negative=())] = False,
    out: FilePath | None = None,
) -> None:
    """Print the JSON schema of a kind of file: every key with its unit, default, meaning and source.

    Parameters
    ----------
    kind
        What the file describes [default: scenario].
    reference
        Print the reference page of the keys of all kinds of files instead, in Markdown.
    out
        File to write instead (.json, with --reference .md); one that exists is replaced.
    """
    from alloc.sources import write_whole
    from studies.scenario.file_kinds import reference_page, schema_of_kind

    if reference and kind is not None:
        raise StudyError("--reference has the keys of all kinds of files; leave out the kind")
    check_file(out, (".md",) if reference else (".json",))
    if reference:
        text = reference_page()
    else:
        text = json.dumps(schema_of_kind(kind or "scenario"), indent=2, ensure_ascii=False) + "\n"
    if out is None:
        print(text, end="")
    else:
        write_whole(out, partial(Path.write_text, data=text, encoding="utf-8"))


# `readhesion new-scenario`: a scenario file of your own to begin with.

USUAL = "wet-start"


def new_scenario(name: str, *, like: str = USUAL, out: FilePath | None = None) -> None:
    """Write a scenario file that runs as it stands and shows every key with its meaning and default.

    Parameters
    ----------
    name
        Name of the scenario: letters, digits, and . + - _; the file is NAME.toml.
    like
        Scenario whose keys it begins with: the name of one that ships, or the path of a TOML file.
    out
        Folder for the file, or the file itself (.toml) [default: the present folder].
    """
    from studies.scenario.file_kinds import commented_scenario
    from studies.scenario.scenario import load_scenario, read_scenario, safe_name

    if not name or safe_name(name) != name:
        raise StudyError(f"name {name!r}: give letters, digits, and . + - _ only")
    place = Path() if out is None else out
    path = place if place.suffix.lower() == ".toml" else place / f"{name}.toml"
    check_place(path.parent)
    load_scenario(like)  # what does not run is no beginning
    keys = {"title": f"as {like}", **read_scenario(like)}
    text = commented_scenario(name, like, _of_new_file(keys, name, path))
    make_folder(path.parent)
    try:
        with open(path, "x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise StudyError(
            f"file {str(path)!r} exists, and is left as it is; choose another NAME or --out"
        ) from None
    except OSError as error:
        raise StudyError(f"file {str(path)!r} cannot be written: {error.strerror}") from None
    console().print(f"{path} runs as it stands: readhesion simulate {path}", highlight=False)


def _of_new_file(keys: dict[str, object], name: str, path: Path) -> dict[str, object]:
    """The keys as they stand in the new file: its name, where the file has another, and paths that hold from there."""
    from studies.scenario.train_file import is_file

    keys = {key: value for key, value in keys.items() if key != "name"}
    train, line = keys.get("train"), keys.get("line")
    if isinstance(train, str) and is_file(train):
        keys["train"] = str(Path(train).absolute())
    if isinstance(line, dict) and isinstance(line.get("file"), str):
        keys["line"] = line | {"file": str(Path(line["file"]).absolute())}
    return keys if path.stem == name else {"name": name, **keys}


# What there is to choose from, by kind and name.


def catalogue() -> dict[str, dict[str, str]]:
    """Kind -> name -> one line of meaning, of all that a command can be told."""
    from alloc.metrics import METRICS
    from alloc.onboard.host import CONTROLLERS
    from alloc.plant.adhesion import CURVES
    from alloc.plant.sets import SETS
    from alloc.rules import RULES
    from studies.core.gallery import gallery
    from studies.core.study import all_studies
    from studies.lines.named_files import LINES, TRAINS, shipped
    from studies.logs.mapping import column_names
    from studies.scenario.scenario import SCENARIOS, load_scenario

    scenarios = {name: load_scenario(name) for name in SCENARIOS}
    return {
        "scenarios": {name: item.title for name, item in scenarios.items()},
        "rules": {name: _first_line(rule) for name, rule in RULES.items()},
        "controllers": {name: found.meaning for name, found in CONTROLLERS.items()},
        "adhesion curves": {name: _first_line(curve) for name, curve in CURVES.items()},
        "trains": {name: _train(name) for name in SETS},
        "lines (run-line)": shipped(LINES),
        "trains (run-line)": shipped(TRAINS),
        "sweeps": {
            name: f"{study.question}{''.join(f' [--{own}]' for own in study.settings).replace('_', '-')}"
            for name, study in all_studies().items()
        },
        "figures": dict(gallery().descriptions()),
        "metrics": {
            name: m.description + ("" if m.unit == "1" else f" [{m.unit}]")
            for name, m in METRICS.items()
        },
        "columns of a log": column_names(),
    }


def _kept_catalogue() -> dict[str, dict[str, str]]:
    """The catalogue. To make it imports everything, so it is kept for as long as no file of a package with parts changes."""
    from importlib.metadata import entry_points

    from alloc.sources import PACKAGES, keep, kept, path_of

    if "studies.core.plugins" in sys.modules:  # plug-ins are loaded, which belong to no package
        return catalogue()
    found = entry_points()
    groups = sorted(one for one in found.groups if one.startswith("readhesion."))
    offered = [entry for group in groups for entry in found.select(group=group)]
    digest = hashlib.sha256(repr(offered).encode())
    for top in sorted({*PACKAGES, *(entry.module.partition(".")[0] for entry in offered)}):
        file = path_of(top) or Path(top)
        several = file.parent.rglob("*") if file.name == "__init__.py" else [file]
        for path in sorted(one for one in several if one.suffix in (".py", ".toml")):
            digest.update(f"{path} {path.stat().st_size} ".encode() + path.read_bytes())
    name = f"catalogue-{digest.hexdigest()[:32]}"
    content = kept(name)
    if content is None:
        content = json.dumps(catalogue()).encode()
        keep(name, content)
    return dict(json.loads(content))


def _train(name: str) -> str:
    """Meaning of a train set: what its file says, or the module of one that a package or a plug-in brings, and its size."""
    from alloc.plant.sets import SETS, find_set

    train = find_set(name)
    cars = len(train.cars)
    said = getattr(SETS[name], "description", None) or _first_line(sys.modules[SETS.origin(name)])
    return f"{said} {cars} car{'s' if cars > 1 else ''}, {train.mass / 1e3:.0f} t."


def _first_line(item: object) -> str:
    text = getattr(item, "description", None) or item.__doc__ or ""
    return str(text).strip().splitlines()[0] if str(text).strip() else ""
