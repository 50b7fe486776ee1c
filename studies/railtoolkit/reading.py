"""Real lines and trains from railtoolkit files, schemas 2022.05 and 2024.07: running paths and rolling stock."""

import math
import warnings
from collections.abc import Hashable, Sequence
from pathlib import Path
from typing import Any

import yaml

from alloc.plant.train import Train
from studies.files.limits import DEEPEST, limits, small_text, too_large
from studies.files.strict import parse, warn_of_unknown
from studies.files.study_error import FileWarning, StudyError, unknown
from studies.railtoolkit.vehicles import (
    VERSIONS,
    NamedPathFile,
    PathFile,
    PointOfInterest,
    RollingStock,
    RunningPath,
    StockFile,
    VehicleKeys,
    build_formation,
    default_deceleration,
    sections,
)

RUNNING_PATH = "https://railtoolkit.org/schema/running-path.json"
LONGEST_NUMBER = 300
"""Digits of a number that are read."""
ROLLING_STOCK = "https://railtoolkit.org/schema/rolling-stock.json"


def read_path(path: str | Path) -> RunningPath:
    """Read the first running path of a file; raises `StudyError` naming file, key and reason.

    Gradient and speed limit of a section apply up to the start of the next one; the last entry only marks the end of the
    line. Warns of further paths, and of keys that the format does not have.
    """
    content = _document(path, RUNNING_PATH, "running path")
    named = str(content["schema_version"]) == "2024.07"
    kind: type[PathFile | NamedPathFile] = NamedPathFile if named else PathFile
    found = parse(kind, content, str(path))
    warn_of_unknown(kind, content, str(path))
    first, *others = found.paths
    _warn_of_others(path, "path", first.id, [other.id for other in others])
    points = tuple(PointOfInterest(*point) for point in first.points())
    return RunningPath(first.title, sections(first.rows()), points, _source(path))


def read_train(path: str | Path) -> Train:
    """Read the first train of a rolling-stock file, empty and without air brake.

    A file without trains is taken as one train of its first vehicle. See `studies.railtoolkit.vehicles` for
    what the format leaves open and what is assumed. Raises `StudyError` naming file, key and reason.
    """
    name, members = _formation(path)
    return build_formation(name, members, _source(path))


def read_rolling_stock(path: str | Path, load_share: float = 1.0) -> RollingStock:
    """Read the first train of a file as one that runs a line: loaded, and braked to its `a_braking`.

    `load_share` of the vehicles' `load_limit`, 0 to 1. Of several vehicles with an `a_braking` or a `speed_limit` the
    least one counts. Where no vehicle has an `a_braking` the format's usual one is taken, with a warning. Raises
    `StudyError` naming file, key and reason.
    """
    if not 0.0 <= load_share <= 1.0:
        raise StudyError(f"load_share = {load_share!r} must lie between 0 and 1")
    name, members = _formation(path)
    braking = [-vehicle.a_braking for vehicle in members if vehicle.a_braking is not None]
    if not braking:
        braking = [default_deceleration(members)]
        kind = (
            "a train with freight wagons" if braking[0] < 0.3 else "a train without freight wagons"
        )
        warnings.warn(
            f"{path}: no vehicle of the train has the key 'a_braking'; taken as {-braking[0]:g} m/s2, the format's "
            f"usual one for {kind}",
            FileWarning,
            stacklevel=2,
        )
    limit = min((v.speed_limit for v in members if v.speed_limit is not None), default=math.inf)
    for vehicle in members:
        pairs = vehicle.tractive_effort or ((math.inf, 0.0),)
        if pairs[-1][0] < limit < math.inf:
            warnings.warn(
                f"{path}: tractive_effort of vehicle {vehicle.id!r} ends at {pairs[-1][0]:g} km/h; its last effort holds "
                f"up to the train's {limit:g} km/h",
                FileWarning,
                stacklevel=2,
            )
    train = build_formation(name, members, _source(path), load_share, min(braking))
    return RollingStock(train, limit / 3.6, min(braking))


def _source(path: str | Path) -> str:
    return f"railtoolkit file {Path(path).name}"


def _warn_of_others(path: str | Path, what: str, taken: str, others: Sequence[str]) -> None:
    if others:
        names = ", ".join(repr(other) for other in others[:5]) + (" ..." if others[5:] else "")
        warnings.warn(
            f"{path}: holds {len(others) + 1} {what}s; the first, {taken!r}, is taken, not {names}",
            FileWarning,
            stacklevel=3,
        )


def _formation(path: str | Path) -> tuple[str, list[VehicleKeys]]:
    """Name and vehicles, front to rear, of the first train of a file."""
    data = _document(path, ROLLING_STOCK, "rolling stock")
    content = parse(StockFile, data, str(path))
    warn_of_unknown(StockFile, data, str(path))
    vehicles = {vehicle.id: vehicle for vehicle in content.vehicles}
    train = content.trains[0] if content.trains else None
    if train is not None:
        _warn_of_others(path, "train", train.id, [other.id for other in content.trains[1:]])
    formation = train.formation if train else (content.vehicles[0].id,)
    for member in formation:
        if member not in vehicles:
            raise StudyError(
                f"{path}: key 'trains[1].formation': {unknown('vehicle', member, vehicles)}"
            )
    members = [vehicles[member] for member in formation]
    if not any(vehicle.powered for vehicle in members):
        raise StudyError(f"{path}: key 'trains[1].formation': no vehicle of the train has traction")
    return train.name if train else content.vehicles[0].name, members


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Plain data only; a key that is there twice is an error, where YAML's own loader keeps the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        """The mapping of a node."""
        seen: set[str] = set()
        for key, _ in node.value:
            if key.value in seen and isinstance(key.value, str):
                raise yaml.constructor.ConstructorError(
                    None, None, f"key {key.value!r} is there twice", key.start_mark
                )
            seen.add(str(key.value))
        found: dict[Hashable, Any] = super().construct_mapping(node, deep)
        return found


def _check_size(text: str, owner: str) -> None:
    """Raise where a document, with aliases written out, is larger or deeper than any line or train: programs walk all of it.

    Also where a number is so long that its conversion would take minutes. Raises `ValueError`, `StudyError` for the size.
    """
    most = limits().file_bytes
    total = 0
    inside: list[tuple[str | None, int]] = []  # anchor, and size before it, of open collections
    heights = [0]  # of what stands in each of them
    known: dict[str, tuple[int, int]] = {}  # size and height by anchor
    for event in yaml.parse(text, _Loader):
        size, height = 1, 0
        if isinstance(event, yaml.AliasEvent):
            if event.anchor in (anchor for anchor, _ in inside):
                raise ValueError(f"alias {event.anchor!r} stands in what it repeats")
            size, height = known.get(event.anchor or "", (1, 0))
        elif isinstance(event, yaml.ScalarEvent):
            size = max(len(event.value), 1)
            if event.implicit[0] and size > LONGEST_NUMBER and event.value[0] in "+-.0123456789":
                raise ValueError(f"a number of {size} digits")
            if event.anchor:
                known[event.anchor] = size, 0
        elif isinstance(event, yaml.CollectionStartEvent):
            inside.append((event.anchor, total))
            heights.append(0)
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = inside.pop()
            size, height = 0, heights.pop() + 1
            if anchor:
                known[anchor] = total - before, height
        else:
            continue
        total += size
        heights[-1] = max(heights[-1], height)
        if len(inside) + height > DEEPEST:
            raise ValueError(f"lists and mappings are nested more than {DEEPEST} deep")
        if total > most:
            raise too_large(owner, "file_bytes", "bytes where its aliases are written out")


def _document(path: str | Path, schema: str, what: str) -> dict[str, Any]:
    text, owner = small_text(str(path), what), f"{what} file {str(path)!r}"
    try:
        _check_size(text, owner)
        content = yaml.load(text, _Loader)  # a safe loader
    except StudyError:
        raise
    except Exception as error:  # a wrong tag makes the library raise what it likes
        reason = " ".join(str(error).split()) or type(error).__name__
        raise StudyError(f"{owner} is not YAML: {reason}") from None
    if not isinstance(content, dict):
        raise StudyError(f"{path}: not a railtoolkit {what}: no keys at the top")
    for key, wanted in (("schema", (schema,)), ("schema_version", VERSIONS)):
        must = " or ".join(repr(one) for one in wanted)
        if key not in content:
            raise StudyError(f"{path}: key {key!r} is missing; a railtoolkit {what} has {must}")
        if str(content[key]) not in wanted:
            raise StudyError(f"{path}: key {key!r} = {content[key]!r}: must be {must}")
    return content
