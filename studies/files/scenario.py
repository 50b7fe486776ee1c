"""Slip events as TOML files: keys in, `alloc.run.event.Event` out.

A scenario fixes what rules and controllers of a comparison share. The seed of `Scenario.event` draws all that is random:
scatter of the rail, errors of sensors, lost telegrams, the phase of the receptivity, and what `[variation]` names.
"""

import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import fields, replace
from functools import cache, lru_cache
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from alloc.laws import GRAVITY
from alloc.onboard.settings import Assumed, Onboard
from alloc.plant import rail as plant
from alloc.plant.curves import CURVES, AdhesionCurve
from alloc.plant.rows import planned_coefficients, rows_of
from alloc.plant.train import InverterGroup, Train
from alloc.plant.trains import TRAINS, find_train
from alloc.run.event import STEP, DriverCommand, Event
from alloc.schema.errors import blamed_on
from alloc.schema.parameters import Meaning, meanings
from studies import StudyError
from studies.files import toml_keys as keys
from studies.files.toml_keys import Keys, Schema, built, in_words_of, keys_of, near, told_of
from studies.files.train_keys import MotorChange, TrainKeys, train_keys

# the rail and the line

MOST_COEFFICIENT = 1.0
"""No dry or sanded rail carries a force as large as the wheel's load; measured coefficients stay below 0.7."""
Increment = Annotated[float, Field(ge=-MOST_COEFFICIENT, le=MOST_COEFFICIENT)]
_Receptivity: Any = keys_of(plant.Receptivity)


class Increments(Keys):
    """Growth of adhesion along the train: none, slope ln j + offset for axle j from 1, JP5484215 (15), or given values."""

    law: Literal["none", "logarithmic", "given"]
    """Law of the growth."""
    slope: Increment = plant.GROWTH_SLOPE
    """Slope of the logarithmic law."""
    offset: Increment = plant.GROWTH_OFFSET
    """Offset of the logarithmic law; with the default the mean over the first four axles is zero."""
    values: tuple[Increment, ...] | None = None
    """Increment of the coefficient per axle from the front, of the law given. Left out: another law is meant."""

    @model_validator(mode="after")
    def _fits_its_law(self) -> "Increments":
        if (self.values is not None) != (self.law == "given"):
            raise ValueError('values go with law = "given", and only with it')
        usual = (self.slope, self.offset) == (plant.GROWTH_SLOPE, plant.GROWTH_OFFSET)
        if self.law != "logarithmic" and not usual:
            raise ValueError('slope and offset go with law = "logarithmic", and only with it')
        return self

    def of(self, axles: int, path: str) -> tuple[float, ...] | None:
        """One increment per axle from the front, None for none; `path` is the table's in the file."""
        if self.values is not None and (given := len(self.values)) != axles:
            raise StudyError(f"{path}.values: give one per axle, {axles} in place of {given}")
        if self.law != "logarithmic":
            return self.values
        return tuple(plant.logarithmic_increments(axles, self.slope, self.offset).tolist())


class Curve(Keys):
    """Adhesion curve by its kind, with the parameters of that kind which differ from its defaults."""

    model_config = ConfigDict(extra="allow")

    kind: str = Field(default="piecewise", json_schema_extra=lambda it: it.update(enum=[*CURVES]))
    """Name of the curve; the other keys are its parameters. Source: piecewise: readhesion paper (1)-(6)."""

    @model_validator(mode="after")
    def _has_its_parameters(self) -> "Curve":
        curve = CURVES.find(self.kind)
        known = [one.name for one in fields(curve)] if isinstance(curve, type) else []
        for key in self._given():
            if key not in known:
                hint = near(key, known)
                raise ValueError(f"{key} is no parameter of the {self.kind} curve{hint}")
        return self

    def _given(self) -> dict[str, Any]:
        return {key: one for key, one in (self.model_extra or {}).items() if one is not None}

    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any, handler: Any) -> Schema:
        made: Schema = handler(core)
        schema = handler.resolve_ref_schema(made)
        schema["additionalProperties"] = False
        curve: Any
        for name, curve in CURVES.items():
            for one in fields(curve) if isinstance(curve, type) else ():
                said = {"type": "number", "description": ""}
                said = schema["properties"].setdefault(one.name, said)
                said["description"] += f"{name}: {meanings(curve).get(one.name, Meaning()).text} "
        return made

    def curve(self, path: str) -> AdhesionCurve:
        """The plant's curve; `path` is the table's in the file."""
        curve = CURVES[self.kind]
        with in_words_of(self, path), blamed_on(f"adhesion curve {self.kind!r}"):
            made: AdhesionCurve = curve(**self._given()) if isinstance(curve, type) else curve
            assert made.number >= 0, "no law of `alloc.plant.curves`"
        return made


# fmt: off
_Rail: Any = keys_of(
    plant.Rail, "rear_speed_law", "rear_axles", "patches", "scatter", "scatter_length", "conditioning", "conditioning_slip",
)
# fmt: on


class RailKeys(_Rail):
    """The rail as it truly is: `level`, or `speed_law` with its `law_factor`."""

    renamed: ClassVar = {"law_factor": "level"}

    level: float | None = Field(default=None, gt=0.0, le=MOST_COEFFICIENT)
    """Coefficient, where it is the same at every speed. Left out: `speed_law` and `law_factor` are given."""
    speed_law: str | tuple[float, float, float] = "none"
    law_factor: float | None = Field(default=None, gt=0.0, le=10.0)
    """Factor on the coefficient that `speed_law` gives; 1 is the law itself. Left out: `level` is given."""
    increments: Increments
    """Growth of the coefficient along the train. It is always said: law = "none", or "logarithmic" for JP5484215 (15)."""
    curve: Curve = Curve()

    @model_validator(mode="after")
    def _has_one_level(self) -> "RailKeys":
        own, other = ("level", "law_factor")[:: 1 if self.speed_law == "none" else -1]
        if getattr(self, own) is None or getattr(self, other) is not None:
            raise ValueError(f"speed_law = {self.speed_law!r} needs {own}, and no {other}")
        return self

    def rail(self, axles: int, factor: float, seed: int) -> plant.Rail:
        """The plant's rail under a train of so many axles, with `factor` on its level; `seed` draws the scatter."""
        increments = self.increments.of(axles, "rail.increments")
        curve = self.curve.curve("rail.curve")
        rail: plant.Rail = built(self, "rail", increments=increments, curve=curve, seed=seed)
        bare = replace(rail, increments=None, scatter=0.0, conditioning=0.0)
        if (most := bare.greatest_peak()) > MOST_COEFFICIENT:
            told = f"give a coefficient of {most:.3g}; at most 1 is possible"
            raise StudyError(f"rail: level, speed_law and patches {told}")
        return replace(rail, level=factor * rail.level)


class Section(Keys):
    """Gradient from a position on."""

    start_m: float
    """Position where the section begins; sections stand in growing order."""
    grade_permille: float
    """Gradient, positive uphill."""


class LineKeys(Keys):
    """The line."""

    sections: tuple[Section, ...] = Field(default=(), max_length=10_000)
    """Sections of constant gradient; before the first and beyond the last the nearest applies. Left out: a level line."""

    def line(self) -> plant.Line:
        """The plant's line."""
        start = tuple(one.start_m for one in self.sections)
        grade = tuple(1e-3 * one.grade_permille for one in self.sections)
        with in_words_of(self, "line.sections"):
            return plant.Line(start, grade) if start else plant.Line()


# the driver, and what differs from day to day


class Failure(Keys):
    """A traction unit whose motors fail."""

    unit: int = Field(ge=1)
    """Number of the traction unit, 1 = foremost."""
    time_s: float = 0.0
    """Instant of the failure."""


class Command(Keys):
    """Acceleration that the driver asks for, from a time on."""

    time_s: float
    """Instant from which the acceleration is asked for; before the first: none."""
    acceleration_kmhs: float
    """Acceleration on level track; negative: braking."""


class Variation(Keys):
    """What a seed of 1 or more draws, uniform within bounds; seed 0 is the event as its file states it. Source: assumed."""

    level: tuple[Annotated[float, Field(gt=0.0)], Annotated[float, Field(gt=0.0)]] = (0.97, 1.03)
    """Least and greatest factor on the rail's level."""
    start_m: float = Field(default=2.0, ge=0.0)
    """How far from the stopping mark the train stands, either way."""
    delay_s: float = Field(default=0.1, ge=0.0, le=10.0)
    """Greatest time by which the commands come later. Source: a telegram period: the driver does not wait for telegrams."""

    def day(self, seed: int) -> tuple[float, float, float]:
        """Factor on the level, shift of the start [m], delay of the commands [s]."""
        if seed == 0:
            return 1.0, 0.0, 0.0
        generator = np.random.default_rng([seed, 5])  # a stream of its own
        level, start, delay = generator.random(3).tolist()
        low, high = self.level
        return low + (high - low) * level, self.start_m * (2.0 * start - 1.0), self.delay_s * delay


# the train's computers


_Belief: Any = keys_of(
    Assumed, "mass_factor", "resistance_factor", "lag_factor", "inertia_factor", "brake_factor"
)


class BeliefKeys(_Belief):
    """What the train believes where that differs from the truth."""

    increments: Increments | None = None
    """Growth of the coefficient along the train. Left out: that of the rail."""
    curve: Curve | None = None
    """Adhesion curve. Left out: that of the rail."""

    def belief(self, rail: RailKeys, axles: int) -> Assumed:
        """The belief of a train of so many axles on this rail."""
        increments = (self.increments or rail.increments).of(axles, "belief.increments")
        curve = (self.curve or rail.curve).curve("belief.curve")
        made: Assumed = built(self, "belief", increments=increments, curve=curve)
        return made


_Equipment: Any = keys_of(
    Onboard,
    "detector",
    "telegrams",
    "sensors",
    "braking",
    "reference.source",
    "reference.radii_compared",
    "hold_time",
    "rise_time",
    "period",
    "limit_rate",
    "inertia_in_limit",
)


class OnboardKeys(_Equipment):
    """Equipment of the train."""

    def onboard(self, belief: Assumed, seed: int) -> Onboard:
        """The equipment of a train with this belief; `seed` draws the errors of its sensors."""
        made: Onboard = built(self, "onboard", belief=belief)
        return replace(made, sensors=replace(made.sensors, seed=seed))


# the event

MOST_OF_EFFORT = 1.5
"""Effort that is asked for over the most that the motors give; beyond, it is hardly meant."""


def remarks(event: Event) -> Iterator[str]:
    """What is possible in an event, but hardly meant: a sentence for each, which names the key."""
    train, rows, step = event.train, rows_of(event.train), 0.05
    wheelsets, drives, brakes = rows.wheelsets, rows.drives, rows.cylinders.size > 0
    needs = planned_coefficients(
        wheelsets, wheelsets.inertia, wheelsets.static_load, train.mass, True, brakes
    )["brake_planned"]
    asked = event.command.sampled(np.arange(0.0, event.duration, step))
    if not asked.any():
        yield f"command: none asks for an acceleration before the end, duration_s = {event.duration:g}"
    most = rows.effort.max(axis=1, initial=0.0)
    motors = float((most * drives.axles * drives.gear / drives.radius).sum())
    motors /= train.mass + train.rotating_mass
    for k, one in enumerate(event.command.accelerations, 1):
        key, needed = f"command[{k}].acceleration_kmhs = {3.6 * one:.6g}", -one * needs
        if needed > MOST_COEFFICIENT:
            yield f"{key} needs a coefficient of {needed:.3g}; no rail has more than 1"
        if one > MOST_OF_EFFORT * motors:
            yield f"{key} is beyond the motors, which reach {3.6 * motors:.3g} on a level line"
    downhill = GRAVITY * max(0.0, -min(event.line.grades))
    speed = event.initial_speed + step * np.cumsum(np.maximum(asked, 0.0) + downhill)
    head = event.initial_position + step * float(speed.sum())
    tail = event.initial_position - train.length
    for k, patch in enumerate(event.rail.patches, 1):
        if patch.start - patch.edge > head or patch.end + patch.edge < tail:
            yield f"rail.patches[{k}]: no axle is ever between start_m = {patch.start:g} and end_m = {patch.end:g}"
        if patch.begin - patch.fade > event.duration or patch.until + patch.fade < 0.0:
            yield f"rail.patches[{k}]: the run is not between begin_s = {patch.begin:g} and until_s = {patch.until:g}"


def _train_names(said: Schema) -> None:
    said["anyOf"] = [{"enum": [*TRAINS]}, {"type": "string", "pattern": r"\.toml$"}]


class Scenario(Keys):
    """A slip event as its file describes it."""

    name: str = Field(default="", pattern=r"^[\w.+-]+$", max_length=100)
    """Name in tables and of files: letters, digits, and . + - _. Left out: the file's."""
    title: str = Field(pattern=r"^[^\x00-\x1f\x7f-\x9f]+$", max_length=200)
    """One line that says what happens."""
    description: str = Field(default="", pattern=r"^[^\x00-\x08\x0b-\x1f\x7f-\x9f]*$")
    """Longer description."""
    case: Literal["none", "A", "B"] | None = None
    """Case of JP5484215 that the event is meant to cause: none, plan out of reach (A), plan within reach (B). Left out: no
    particular case."""
    in_default_comparison: bool = True
    """Whether it is in the default comparison; events with faults that concern single functions are not."""
    train: str | TrainKeys = Field(json_schema_extra=_train_names)
    """Name of a train set, or path of a train file counted from the scenario's folder."""
    load_t: tuple[Annotated[float, Field(ge=0.0)], ...] | None = None
    """Pay load of each car in the order in which the train is described. Left out: that of the train."""
    load_transfer: bool = False
    """Whether the rail force of a car moves load from its front axles to its rear ones."""
    reversed: bool = False
    """Whether the train runs in the other direction: its last car leads."""
    inverter_group: InverterGroup | None = None
    """Motors per inverter: a traction unit is a car (1C4M), a bogie (1C2M) or an axle (1C1M). Left out: the train's own."""
    motors: MotorChange | None = None
    """Kind and lag of all motors. Left out: the train's own."""
    failures: tuple[Failure, ...] = Field(default=(), max_length=1000)
    """Traction units that fail. Left out: none."""
    rail: RailKeys
    """The rail as it truly is."""
    line: LineKeys = LineKeys()
    """Gradients. Left out: a level line."""
    receptivity: _Receptivity = _Receptivity()
    """How much regenerated power the line takes up; the phase is drawn. Left out: all of it."""
    variation: Variation | None = None
    """Differences between days; an empty table has bounds that fit most events. Left out: a seed draws only what other
    tables leave to chance."""
    command: tuple[Command, ...] = Field(min_length=1, max_length=10_000)
    """Accelerations that the driver asks for, in the order of time."""
    belief: BeliefKeys = BeliefKeys()
    """What the train believes where that differs from the truth. Left out: the truth."""
    onboard: OnboardKeys = OnboardKeys()
    """Equipment of the train."""
    duration_s: float = Field(gt=0.0, le=36_000.0)
    """Length of the run."""
    start_m: float = 0.0
    """Position of the train's head at the start."""
    initial_speed_kmh: float = Field(default=0.0, ge=0.0, le=360.0)
    """Speed at the start."""
    target_speed_kmh: float | None = Field(default=None, ge=0.0)
    """Speed up to which time and distance are measured. Left out: neither is measured."""
    step_s: float = Field(default=STEP, gt=0.0)
    """Longest integration step."""
    record_period_s: float = Field(default=0.01, gt=0.0)
    """Time between two recorded instants."""

    def event(self, seed: int = 0) -> Event:
        """The input of the simulation; `seed` >= 0 makes all random draws. Raises `StudyError` for an impossible event."""
        with told_of(f"scenario {self.name!r}"):
            return self._event(seed)

    def _event(self, seed: int) -> Event:
        if seed < 0:
            raise StudyError(f"seed = {seed}: must be 0 or greater")
        rail_seed, sensor_seed, phase = np.random.SeedSequence(seed).generate_state(3).tolist()
        factor, shift, delay = self.variation.day(seed) if self.variation else (1.0, 0.0, 0.0)
        train = self._train()
        axles = train.axle_count
        rail = self.rail.rail(axles, factor, rail_seed)
        phase = 2.0 * math.pi * phase / 2.0**32 if self.receptivity.amplitude else 0.0
        receptivity = built(self.receptivity, "receptivity", phase=phase)
        onboard = self.onboard.onboard(self.belief.belief(self.rail, axles), sensor_seed)
        times = tuple(one.time_s + delay for one in self.command)
        asked = tuple(one.acceleration_kmhs / 3.6 for one in self.command)
        start, speed = self.start_m + shift, self.initial_speed_kmh / 3.6
        failures = {one.unit - 1: one.time_s for one in self.failures}
        with in_words_of(self, "command"):
            command = DriverCommand(times, asked)
        with in_words_of(self):
            event = Event(
                name=self.name,
                train=train,
                rail=rail,
                command=command,
                onboard=onboard,
                line=self.line.line(),
                receptivity=receptivity,
                failures=failures,
                duration=self.duration_s,
                initial_speed=speed,
                initial_position=start,
                step=self.step_s,
                record_period=self.record_period_s,
                target_speed=None if self.target_speed_kmh is None else self.target_speed_kmh / 3.6,
                seed=seed,
            )
            event.world()  # refuses what does not fit the train
        return event

    def _train(self) -> Train:
        """The train as it runs."""
        with in_words_of(self, "train"):
            train = find_train(self.train) if isinstance(self.train, str) else self.train.train
        if self.load_t is not None:
            with in_words_of(self, "load_t"):
                train = train.loaded(tuple(1e3 * load for load in self.load_t))
        changes = self.motors.si() if self.motors else {}
        changes |= {"inverter_group": self.inverter_group} if self.inverter_group else {}
        if changes or self.load_transfer:
            cars = [(one, one.motors and replace(one.motors, **changes)) for one in train.cars]
            changed = tuple(replace(one, motors=motors) for one, motors in cars)
            train = replace(train, cars=changed, load_transfer=self.load_transfer)
        return train.reversed() if self.reversed else train

    def changed(self, **values: Any) -> "Scenario":
        """With other values of keys, checked again; a table replaces the table. Raises `StudyError`."""
        given = self.model_dump(mode="json", exclude_unset=True)
        return parse(given | values, f"scenario {self.name!r}")

    @property
    def text(self) -> str:
        """All that identifies the scenario, as JSON: the keys that were given."""
        return self.model_dump_json(exclude_unset=True)

    @property
    def first_seed(self) -> int:
        """Seed where nobody says it: of a drawn event its number, by which its rows are made, else 0."""
        is_drawn = DRAWN.fullmatch(self.name)
        return int(is_drawn[3]) if is_drawn else 0

    @property
    def sources(self) -> tuple[str, ...]:
        """Modules of its adhesion curves and its train, wherever they come from."""
        curves = (self.rail.curve, self.belief.curve or self.rail.curve)
        train = [TRAINS.origin(name) for name in TRAINS if name == self.train]
        return tuple(dict.fromkeys([*(CURVES.origin(one.kind) for one in curves), *train]))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Scenario) and self.text == other.text

    def __hash__(self) -> int:
        return hash(self.text)

    def __reduce__(self) -> Any:  # tables of records have no name in a module
        return _again, (self.text,)


@lru_cache(maxsize=256)
def _again(text: str) -> Scenario:
    return Scenario.model_validate_json(text)


# files

DRAWN = re.compile(r"(population|random)-(0|[1-9]\d{0,8})-(\d{4}|[1-9]\d{4,8})")
"""Name of a drawn event: its population (of the benchmark, of the claims), the seed of that, its number."""
SHIPPED = Path(__file__).with_name("scenarios")


def shipped() -> list[str]:
    """Names of the scenarios that come with the project."""
    return sorted(path.stem for path in SHIPPED.glob("*.toml"))


def default_scenarios() -> list[Scenario]:
    """Those of the default comparison."""
    return [one for one in map(load, shipped()) if one.in_default_comparison]


def load(name: str | Path) -> Scenario:
    """A shipped scenario or a drawn event by its name, or that of a TOML file by its path, which is read each time.

    Raises `StudyError` of one line that names the file, the key and the reason.
    """
    text = str(name)
    if isinstance(name, Path) or "/" in text or text.endswith(".toml"):
        return _read(Path(name))
    if text in shipped():
        return _shipped(text)
    if is_drawn := DRAWN.fullmatch(text):
        drawn_in = import_module(
            "studies.population.population" if text[0] == "p" else "studies.claims"
        )
        event: Scenario = drawn_in.event(int(is_drawn[2]), int(is_drawn[3]))
        return event
    is_file, known = Path(f"{text}.toml").is_file(), [*shipped(), "population-65-0000"]
    hint = f"; did you mean the file {text}.toml?" if is_file else near(text, known)
    raise StudyError(f"unknown scenario {text!r}{hint}")


@cache
def _shipped(name: str) -> Scenario:
    return _read(SHIPPED / f"{name}.toml")


def _read(path: Path) -> Scenario:
    name = re.sub(r"[^\w.+-]", "-", path.stem)[:100]
    with told_of(f"file {str(path)!r}"):
        found = _parsed({"name": name} | keys.read_toml(path), path.parent)
        found._event(0)  # what is impossible shows now, not in the middle of a study
    return found


def parse(data: Mapping[str, Any], source: str) -> Scenario:
    """A scenario of these keys; raises `StudyError` of one line that names the `source` and the key."""
    with told_of(source):
        return _parsed(data, Path())


def _parsed(data: Mapping[str, Any], folder: Path) -> Scenario:
    """The content of a train file, whose path counts from `folder`, becomes a part of the scenario."""
    train = data.get("train")
    if isinstance(train, str | Path) and str(train).endswith(".toml"):
        data = {**data, "train": train_keys(folder / train)}
    return keys.checked(Scenario, data)


# for those who write files

SCHEMA = "scenario.schema.json"


def schema(kind: Literal["scenario", "train"] = "scenario") -> Schema:
    """JSON schema (2020-12) of a file, with the parts of plug-ins."""
    table = Scenario if kind == "scenario" else TrainKeys
    dialect = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
    return dialect | table.model_json_schema() | {"title": f"readhesion {kind}"}


def new_scenario(name: str, like: str = "wet-start", folder: str | Path = ".") -> Path:
    """Write a copy of the scenario `like` as a file to begin with, and the schema beside it; the file's path.

    Raises `StudyError` where a file of this name exists, or cannot be written.
    """
    if not re.fullmatch(r"[\w.+-]{1,100}", name):
        raise StudyError(f"name {name!r}: give letters, digits, and . + - _")
    load(like)
    source = SHIPPED / f"{like}.toml" if like in shipped() else Path(like)
    text = re.sub(r"(?m)\A#:schema.*\n|^name *=.*\n", "", source.read_text("utf-8-sig"))
    train = keys.read_toml(source).get("train", "")
    if train.endswith(".toml"):  # its path counts from the other folder
        text = text.replace(train, str((source.parent / train).resolve()))
    path = Path(folder) / f"{name.removesuffix('.toml')}.toml"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(path, "x", encoding="utf-8") as file:
            file.write(f"#:schema ./{SCHEMA}\n# It began as a copy of {source.stem}.\n{text}")
        path.with_name(SCHEMA).write_text(json.dumps(schema(), indent=1), "utf-8")
    except FileExistsError:
        raise StudyError(f"file {str(path)!r} exists; choose another name") from None
    except OSError as error:
        raise StudyError(f"file {str(path)!r} cannot be written: {error.strerror}") from None
    return path
