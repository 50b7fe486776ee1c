"""Slip events as files: TOML in, `alloc.simulation.Event` out.

A scenario fixes everything that rules and controllers share. The seed of `Scenario.event` draws the scatter of the rail, the
errors of the sensors, the losses of telegrams, the phase of the receptivity and what `[variation]` names. Nothing else draws
them, so runs that differ only in rule or controller meet the same event.
"""

import hashlib
import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import ConfigDict, Field, ValidationError, model_validator

from alloc.display import displayed
from alloc.errors import OnboardError, PlantError
from alloc.plant.adhesion import CURVES
from alloc.plant.model import build
from alloc.plant.sets import SETS
from alloc.plant.train import InverterGroup
from alloc.registry import Registry
from alloc.simulation import DriverCommand, Event, SimulationError, inputs_hash
from studies.files.json_schema import Names
from studies.files.strict import Strict, explain, in_file_words, parse, read_toml
from studies.files.study_error import StudyError
from studies.scenario.onboard_keys import BeliefKeys, OnboardKeys
from studies.scenario.rail_keys import LineKeys, RailKeys, ReceptivityKeys
from studies.scenario.train_file import (
    FILES,
    CouplerKeys,
    DraftGearKeys,
    FailureKeys,
    MotorChangeKeys,
    build_train,
    is_file,
)

# What differs from day to day in a scenario that is the same by its file.


@dataclass(frozen=True)
class Day:
    """What is drawn for one day; the defaults are those of the event as the file states it."""

    level: float = 1.0
    """Factor on the level of the rail."""
    start: float = 0.0
    """Shift of the place where the train starts [m]."""
    delay: float = 0.0
    """Time by which the driver's commands come later [s]."""


class VariationKeys(Strict):
    """Draws of a seed of 1 or more, uniform within bounds: `[variation]`. Seed 0 is the event as the file states it.

    The bounds are assumed. JP5484215 (on (12) to (15)) has a scatter of 0.012 of the coefficient, over rail of all kinds.
    Here the rail is of one kind, so `level` bounds a factor of a few per cent.

    Source: assumed.
    """

    level: tuple[float, float] = (0.97, 1.03)
    """Least and greatest factor on the rail's level."""
    start_m: float = Field(default=2.0, ge=0.0)
    """How far from the stopping mark the train stands, either way."""
    delay_s: float = Field(default=0.1, ge=0.0, le=10.0)
    """Greatest time by which the commands come later. Source: a telegram period: the driver does not wait for telegrams."""

    @model_validator(mode="after")
    def _fits(self) -> "VariationKeys":
        if not 0.0 < self.level[0] <= self.level[1]:
            raise ValueError("level must be the least and the greatest factor, both greater than 0")
        return self

    def day(self, seed: int) -> Day:
        """The day of a seed."""
        if seed == 0:
            return Day()
        generator = np.random.default_rng([seed, 5])  # a stream of its own
        level, start, delay = generator.random(3)
        return Day(
            float(self.level[0] + (self.level[1] - self.level[0]) * level),
            float(self.start_m * (2.0 * start - 1.0)),
            float(self.delay_s * delay),
        )


NOT_HASHED = {"name", "title", "description", "case", "in_default_comparison"}
"""Keys that describe the purpose of a scenario; they do not change the event."""

SPEED_BOUND = 100.0
"""Speed that no train here exceeds [m/s]; it bounds the length of line in the tables."""


class CommandKeys(Strict):
    """Acceleration that the driver asks for on level track, from a time on: `[[command]]`. Source: the event's."""

    time_s: float
    """Instant from which the acceleration is asked for; commands are in increasing order of time. Before the first: none."""
    acceleration_kmhs: float
    """Acceleration on level track; negative: braking."""


def _named_by_file(schema: dict[str, Any]) -> None:
    """A file need not say its name."""
    schema["required"].remove("name")


@displayed
class Scenario(Strict):
    """A slip event as its file describes it; `event` gives the input of the simulation. Source: this project."""

    model_config = ConfigDict(json_schema_extra=_named_by_file)

    name: str = Field(pattern=r"^[\w.+-]+$")  # part of file names
    """Name in tables and of files: letters, digits, and . + - _. Left out: the file's name."""
    title: str
    """One line that says what happens."""
    description: str = ""
    """Longer description."""
    case: Literal["none", "A", "B"] | None = None
    """Case of the allocation that the event is meant to cause: none, plan out of reach (A), or plan within reach (B). Left
    out: no particular case. Source: JP5484215."""
    in_default_comparison: bool = True
    """Whether it is in the default comparison of `readhesion compare`; events with faults that concern single functions are
    not."""
    train: Annotated[str, Names(lambda: SETS, FILES)]
    """Name of a train set, or path of a file relative to the scenario's folder: a train file in TOML, or of railtoolkit."""
    load_t: tuple[float, ...] | None = None
    """Pay load of each car in the order in which the train is described, also where it runs `reversed`. Left out: that
    of the train."""
    load_transfer: bool | None = None
    """Axle loads change with the car's rail force. Left out: as the train says."""
    reversed: bool = False
    """Whether the train runs in the other direction: its last car leads."""
    inverter_group: InverterGroup | None = None
    """Motors per inverter in place of the train's own: a unit is a car (1C4M), a bogie (1C2M) or an axle (1C1M). Left out:
    the train's own."""
    motors: MotorChangeKeys | None = None
    """Lag and kind of all motors. Left out: the train's own."""
    coupler: CouplerKeys | None = None
    """Linear draft gear between all cars. Left out: the train's own, or none: a rigid train."""
    draft_gear: DraftGearKeys | None = None
    """Friction draft gear between all cars; an empty table is a published set. Left out: the train's own, or none: a rigid
    train."""
    failures: tuple[FailureKeys, ...] = Field(default=(), max_length=1000)
    """Traction units that fail. Left out: none."""
    rail: RailKeys
    """The rail as it truly is."""
    line: LineKeys = LineKeys()
    """Gradients, tunnels and curves. Left out: a level, straight line."""
    receptivity: ReceptivityKeys = ReceptivityKeys()
    """How much regenerated power the line takes up. Left out: all of it."""
    variation: VariationKeys | None = None
    """Differences between days; an empty table has bounds that fit most events. Left out: a seed draws only what the other
    tables leave to chance."""
    command: tuple[CommandKeys, ...] = Field(min_length=1, max_length=10_000)
    """Accelerations that the driver asks for."""
    belief: BeliefKeys = BeliefKeys()
    """What the train believes where that differs from the truth. Left out: the truth."""
    onboard: OnboardKeys = OnboardKeys()
    """Equipment of the train."""
    duration_s: float = Field(gt=0.0, le=36_000.0)
    """Length of the run."""
    start_m: float = 0.0
    """Position of the train's head at the start."""
    initial_speed_kmh: float = Field(default=0.0, ge=0.0, le=3.6 * SPEED_BOUND)
    """Speed at the start."""
    target_speed_kmh: float | None = Field(default=None, ge=0.0)
    """Speed up to which time and distance are measured. Left out: neither is measured."""
    step_s: float | None = Field(default=None, gt=0.0)
    """Longest integration step. Left out: 0.002 s, with noise on the speed sensors 0.001 s."""
    record_period_s: float = Field(default=0.01, gt=0.0)
    """Time between two recorded instants."""

    @model_validator(mode="after")
    def _fits(self) -> "Scenario":
        if self.coupler is not None and self.draft_gear is not None:
            raise ValueError("give either coupler or draft_gear, not both")
        return self

    def event(self, seed: int = 0) -> Event:
        """Input of the simulation; `seed` >= 0 determines all random draws. Raises `StudyError` for an impossible event."""
        if seed < 0:
            raise StudyError(f"seed = {seed}: must be 0 or greater")
        try:
            return self._event(seed)
        except (PlantError, OnboardError, SimulationError) as error:
            raise StudyError(f"scenario {self.name!r}: {in_file_words(str(error), self)}") from None

    def _event(self, seed: int) -> Event:
        rail_seed, sensor_seed, phase = np.random.SeedSequence(seed).generate_state(3)
        train = build_train(
            self.train,
            self.load_t,
            self.coupler or self.draft_gear,
            self.load_transfer,
            self.reversed,
            self.inverter_group,
            self.motors,
        )
        axles = train.axle_count
        day = Day() if self.variation is None else self.variation.day(seed)
        rail = self.rail.rail(axles, int(rail_seed))
        rail = replace(rail, level=day.level * rail.level)
        start = self.start_m + day.start
        initial_speed = self.initial_speed_kmh / 3.6
        reach = self.duration_s * min(
            SPEED_BOUND,
            initial_speed
            + self.duration_s * max(abs(c.acceleration_kmhs) / 3.6 + 0.3 for c in self.command),
        )
        model = build(
            train,
            rail,
            self.line.line(),
            self.receptivity.receptivity(2.0 * math.pi * phase / 2.0**32),
            {failure.unit - 1: failure.time_s for failure in self.failures},
            span=(start - 20.0, start + reach),
        )
        onboard = self.onboard.onboard(
            self.belief, self.rail.increments, rail.curve, axles, int(sensor_seed)
        )
        event = Event(
            name=self.name,
            model=model,
            command=DriverCommand(
                tuple(c.time_s + day.delay for c in self.command),
                tuple(c.acceleration_kmhs / 3.6 for c in self.command),
            ),
            onboard=onboard,
            duration=self.duration_s,
            initial_speed=initial_speed,
            initial_position=start,
            step=self.step_s,
            record_period=self.record_period_s,
            target_speed=None if self.target_speed_kmh is None else self.target_speed_kmh / 3.6,
            seed=seed,
        )
        _ = event.equipment  # refuses a train without traction, and a belief that does not fit
        return event

    @property
    def sources(self) -> tuple[str, ...]:
        """Modules of its train and its adhesion curves, wherever they come from."""
        curves = [self.rail.curve.kind, *([self.belief.curve.kind] if self.belief.curve else [])]
        train = () if is_file(self.train) else (SETS.origin(self.train),)
        return (*train, *(CURVES.origin(kind) for kind in dict.fromkeys(curves)))

    def hash(self) -> str:
        """Hash of everything that determines the event: equal content gives equal hashes, wherever the file is."""
        if not is_file(self.train) and self.line.file is None:
            return self.hash_of_keys
        content = json.loads(self.keys_as_text)
        if is_file(self.train):
            content["train"] = _digest(self.train)
        if self.line.file is not None:
            content["line"]["file"] = _digest(self.line.file)
        return _short_hash(json.dumps(content, sort_keys=True))

    @cached_property
    def keys_as_text(self) -> str:
        """The keys that determine the event, as JSON."""
        return json.dumps(self.model_dump(mode="json", exclude=NOT_HASHED), sort_keys=True)

    @cached_property
    def hash_of_keys(self) -> str:
        """Hash of the keys alone, without the files that they name."""
        return _short_hash(self.keys_as_text)

    def draws(self) -> bool:
        """Whether anything in the event depends on the seed."""
        return inputs_hash(self.event(1)) != inputs_hash(self.event(2))

    def changed(self, **values: Any) -> "Scenario":
        """A copy with other top-level values, checked again."""
        try:
            return Scenario.model_validate(self.model_dump() | values)
        except ValidationError as error:
            raise StudyError(f"scenario {self.name!r}: {explain(Scenario, error)}") from None


def safe_name(text: str) -> str:
    """`text` as part of a scenario's name, which is part of file names: without blanks and similar characters."""
    return re.sub(r"[^\w.+-]", "-", text)


def _short_hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _digest(path: str) -> str:
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    except OSError as error:
        raise StudyError(f"file {path!r} cannot be read: {error.strerror}") from None


# Scenarios by name or path: shipped ones, those of plug-ins, and your own files.

SHIPPED = Path(__file__).parent / "shipped"
SCENARIOS: Registry[Path | Mapping[str, Any]] = Registry(
    "scenario", "readhesion.scenarios", StudyError
)
"""Name -> TOML file of the scenario, or its keys."""
for _file in sorted(SHIPPED.glob("*.toml")):
    SCENARIOS.register(_file.stem, _file)


def shipped_scenarios() -> list[str]:
    """Names of the scenarios that come with the project, in alphabetical order."""
    return [name for name in SCENARIOS if SCENARIOS.origin(name) == __name__]


def default_scenarios() -> list[Scenario]:
    """Shipped scenarios of the default comparison, in alphabetical order."""
    shipped = [load_scenario(name) for name in shipped_scenarios()]
    return [scenario for scenario in shipped if scenario.in_default_comparison]


@cache
def shipped_scenario(name: str) -> Scenario:
    """A shipped scenario; read once, because random events are made from it by the million."""
    return load_scenario(SHIPPED / f"{name}.toml")


def load_scenario(name_or_path: str | Path) -> Scenario:
    """A scenario by name, or any TOML file by path; paths inside it are relative to the file's folder.

    Raises `StudyError` naming the file, the key and the reason.
    """
    scenario = parse(Scenario, read_scenario(name_or_path), str(name_or_path))
    scenario.event()  # impossible values show now, not in the middle of a study
    return scenario


def read_scenario(name_or_path: str | Path) -> dict[str, Any]:
    """Unchecked keys of a scenario as its file has them, with its name. Raises as `load_scenario`."""
    text = str(name_or_path)
    is_path = text.endswith(".toml") or "/" in text
    if not is_path and text not in SCENARIOS and Path(f"{text}.toml").is_file():
        raise StudyError(f"unknown scenario {text!r}; did you mean the file {text}.toml?")
    found = text if is_path else SCENARIOS.find(text)
    if isinstance(found, Mapping):
        return {"name": text} | dict(found)
    path = Path(found)
    data = read_toml(str(path), "scenario", "`readhesion list` names the shipped ones")
    return {"name": safe_name(path.stem)} | _resolved(data, path.parent)


def _resolved(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The same content with paths of files counted from `folder`."""
    data = dict(data)
    if isinstance(data.get("train"), str) and is_file(data["train"]):
        data["train"] = str(folder / data["train"])
    line = data.get("line")
    if isinstance(line, dict) and isinstance(line.get("file"), str):
        data["line"] = line | {"file": str(folder / line["file"])}
    return data
