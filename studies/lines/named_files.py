"""Lines and trains for a line run by name, for those that ship, or by the path of a file."""

import math
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

from alloc.plant.sets import SETS, find_set
from alloc.plant.train import Train
from studies.files.study_error import FileWarning, StudyError, unknown
from studies.railtoolkit.reading import read_rolling_stock
from studies.railtoolkit.vehicles import (
    BRAKE_LAG,
    FREIGHT_BRAKING,
    PASSENGER_BRAKING,
    RollingStock,
    RunningPath,
)
from studies.scenario.line_file import read_line
from studies.scenario.scenario import Scenario, safe_name
from studies.scenario.train_file import read_train_keys

LINES, TRAINS = (Path(__file__).parent / folder for folder in ("shipped_lines", "shipped_trains"))
FILE_ENDINGS = (".toml", ".yaml", ".yml", ".json")


def shipped(folder: Path) -> dict[str, str]:
    """Name of each shipped line or train, and the first line of its file."""
    files = sorted(folder.glob("*.toml"))
    return {file.stem: file.read_text("utf-8").partition("\n")[0].lstrip("# ") for file in files}


def find_line(name_or_path: str) -> RunningPath:
    """A line; raises `StudyError` with the nearest name, or naming file and key."""
    return read_line(line_file(name_or_path))


def find_stock(name_or_path: str, load_share: float = 1.0) -> RollingStock:
    """A train that can run a line, with this share of its load; raises `StudyError` as `find_line`.

    A set of `alloc.plant.sets` by its name runs as a rigid train with a quick brake. The load of a train in TOML is the
    `load_t` of its cars; of its running resistance, what does not grow with the square of the speed is in proportion to the
    mass.
    """
    if name_or_path in SETS:
        return _of_a_set(name_or_path, load_share)
    file = _file(name_or_path, "train", TRAINS)
    if not file.lower().endswith(".toml"):
        return read_rolling_stock(file, load_share)
    keys, train = read_train_keys(file)
    if train.couplers is not None:
        _warn(f"train {file!r} is run as rigid, with a quick brake")
        train = _rigid(train)
    if keys.service_deceleration_kmhs is None:
        deceleration = _usual_deceleration(
            train, f"{file}: key 'service_deceleration_kmhs' is missing"
        )
    else:
        deceleration = keys.service_deceleration_kmhs / 3.6
    limit = math.inf if keys.speed_limit_kmh is None else keys.speed_limit_kmh / 3.6
    return RollingStock(_loaded(train, load_share), limit, deceleration)


def _of_a_set(name: str, load_share: float) -> RollingStock:
    train = find_set(name)
    what = f"train {name!r} is run as rigid, with a quick brake"
    deceleration = _usual_deceleration(train, what)
    return RollingStock(_loaded(_rigid(train), load_share), math.inf, deceleration)


def _rigid(train: Train) -> Train:
    quick: dict[str, Any] = {"fill_time": BRAKE_LAG, "release_time": BRAKE_LAG, "dead_time": 0.0}
    cars = tuple(
        replace(car, air_brake=replace(car.air_brake, **quick)) if car.air_brake else car
        for car in train.cars
    )
    return replace(train, cars=cars, couplers=None)


def _usual_deceleration(train: Train, why: str) -> float:
    """[m/s2]; says that it is assumed, and why. Wagons whose axles no computer knows are freight wagons."""
    freight = not all(car.speed_sensors for car in train.cars)
    usual = FREIGHT_BRAKING if freight else PASSENGER_BRAKING
    kind = "freight" if freight else "passenger"
    _warn(f"{why}; its deceleration is taken as {3.6 * usual:g} km/h/s, usual for {kind} trains")
    return usual


def _warn(text: str) -> None:
    warnings.warn(text, FileWarning, stacklevel=4)


def _loaded(train: Train, share: float) -> Train:
    if not 0.0 <= share <= 1.0:
        raise StudyError(f"load_share = {share!r} must lie between 0 and 1")
    loaded = train.loaded(tuple(share * car.load for car in train.cars))
    constant, linear, quadratic = train.resistance
    less = loaded.mass / train.mass
    return replace(loaded, resistance=(less * constant, less * linear, quadratic))


def line_file(name_or_path: str) -> str:
    """The path of a line's file; a name without folder and ending is that of one that ships."""
    return _file(name_or_path, "line", LINES)


def _file(name_or_path: str, what: str, folder: Path) -> str:
    path = Path(name_or_path)
    if path.suffix.lower() in FILE_ENDINGS or len(path.parts) != 1 or path.exists():
        return name_or_path
    found = folder / f"{name_or_path}.toml"
    if not found.is_file():
        known = unknown(what, name_or_path, [*shipped(folder), *(SETS if what == "train" else ())])
        raise StudyError(
            f"{known}; or give the path of a file, ending in {', '.join(FILE_ENDINGS)}"
        )
    return str(found)


# Real lines and trains put into a scenario from the command line.


def with_real_input(scenario: Scenario, line: str | None, train: str | None) -> Scenario:
    """The same event with the line and the train of files; it starts where the line's steepest climb starts.

    Loads, couplers and failures belong to the scenario's own train. Raises `StudyError` where files and scenario do not fit.
    """
    changes: dict[str, object] = {}
    name = scenario.name
    if line is not None:
        line = line_file(line)
        path = read_line(line)
        section = path.steepest()
        grade = 1e3 * section.grade
        changes["line"] = {"file": line}
        changes["start_m"] = section.start
        changes["title"] = (
            f"{scenario.title}; on {Path(line).name}, {section.start:.0f} m to {section.end:.0f} m, "
            f"{grade:g} per mille"
        )
        name += f"+{safe_name(Path(line).stem)}"
    if train is not None:
        if scenario.load_t is not None or scenario.failures:
            raise StudyError(
                f"--train does not fit scenario {scenario.name!r}, which loads or fails cars of its own "
                "train; choose another --scenario"
            )
        changes |= {"train": train, "coupler": None}
        name += f"+{safe_name(Path(train).stem)}"
    changed = scenario.changed(name=name, **changes)
    changed.event()  # a file that does not hold a train shows now, not as a failed row
    return changed
