"""Slip events as TOML files: keys in, `alloc.run.event.Event` out.

A scenario fixes what rules and controllers of a comparison share. The seed of `Scenario.event` draws all that is random:
scatter of the rail, errors of sensors, lost telegrams, the phase of the receptivity, and what `[variation]` names.
"""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from alloc.laws import GRAVITY
from alloc.onboard.settings import Assumed, Onboard
from alloc.plant import rail as plant
from alloc.plant.curves import CURVES, AdhesionCurve
from alloc.plant.rows import planned_coefficients, rows_of_train
from alloc.plant.train import InverterGroup, Train
from alloc.plant.trains import TRAINS, find_train
from alloc.run.event import STEP, DriverCommand, Event
from alloc.schema.errors import InputError, blamed_on
from alloc.schema.parameters import Meaning, meanings
from studies import StudyError
from studies.files.toml_keys import (
    Keys,
    Schema,
    build_record,
    check_keys,
    make_table,
    name_keys,
    name_source,
    suggest_name,
)
from studies.files.train_keys import MotorChange, TrainKeys, read_train

# the rail and the line

MOST_COEFFICIENT = 1.0
"""No dry or sanded rail carries a force as large as the wheel's load; measured coefficients stay below 0.7."""
Increment = Annotated[float, Field(ge=-MOST_COEFFICIENT, le=MOST_COEFFICIENT)]
_Receptivity: Any = make_table(plant.Receptivity)


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
    def _check_law(self) -> "Increments":
        if (self.values is not None) != (self.law == "given"):
            raise ValueError('values go with law = "given", and only with it')
        usual = (self.slope, self.offset) == (plant.GROWTH_SLOPE, plant.GROWTH_OFFSET)
        if self.law != "logarithmic" and not usual:
            raise ValueError('slope and offset go with law = "logarithmic", and only with it')
        return self

    def increments_per_axle(self, axles: int, path: str) -> tuple[float, ...] | None:
        """One increment per axle from the front, None for none; `path` is the table's in the file."""
        if self.values is not None and len(self.values) != axles:
            count = f"{axles} in place of {len(self.values)}"
            raise StudyError(f"{path}.values: give one per axle, {count}")
        if self.law != "logarithmic":
            return self.values
        return tuple(plant.logarithmic_increments(axles, self.slope, self.offset).tolist())


class Curve(Keys):
    """Adhesion curve by its kind, with the parameters of that kind which differ from its defaults."""

    model_config = ConfigDict(extra="allow")

    kind: str = Field(default="piecewise", json_schema_extra=lambda key: key.update(enum=[*CURVES]))
    """Name of the curve; the other keys are its parameters. Source: piecewise: readhesion paper (1)-(6)."""

    @model_validator(mode="after")
    def _check_parameters(self) -> "Curve":
        curve = CURVES.find(self.kind)
        names = [field.name for field in fields(curve)] if isinstance(curve, type) else []
        for key in self._parameters():
            if key not in names:
                hint = suggest_name(key, names)
                raise ValueError(f"{key} is no parameter of the {self.kind} curve{hint}")
        return self

    def _parameters(self) -> dict[str, Any]:
        return {key: x for key, x in (self.model_extra or {}).items() if x is not None}

    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any, handler: Any) -> Schema:
        table: Schema = handler(core)
        schema = handler.resolve_ref_schema(table)
        schema["additionalProperties"] = False
        curve: Any
        for name, curve in CURVES.items():
            for field in fields(curve) if isinstance(curve, type) else ():
                entry = {"type": "number", "description": ""}
                entry = schema["properties"].setdefault(field.name, entry)
                meaning = meanings(curve).get(field.name, Meaning())
                entry["description"] += f"{name}: {meaning.text} "
        return table

    def build_curve(self, path: str) -> AdhesionCurve:
        """The plant's curve; `path` is the table's in the file."""
        part: Any = CURVES[self.kind]
        with name_keys(self, path), blamed_on(f"adhesion curve {self.kind!r}"):
            curve = part(**self._parameters()) if isinstance(part, type) else part
            if not isinstance(curve, AdhesionCurve):
                raise InputError(f"it is a {type(curve).__name__}; register an AdhesionCurve")
            assert curve.number >= 0, "no law of `alloc.plant.curves`"
        return curve


_Rail: Any = make_table(
    plant.Rail,
    "rear_speed_law",
    "rear_axles",
    "patches",
    "scatter",
    "scatter_length",
    "conditioning",
    "conditioning_slip",
)


class RailKeys(_Rail):
    """The rail as it truly is: `level`, or `speed_law` with its `law_factor`."""

    renamed: ClassVar = {"law_factor": "level"}

    level: float | None = Field(default=None, gt=0.0, le=MOST_COEFFICIENT)
    """Coefficient, where it is the same at every speed. Left out: `speed_law` and `law_factor` are given."""
    speed_law: str | tuple[float, float, float] = "none"
    law_factor: float | None = Field(default=None, gt=0.0, le=10.0)
    """Factor on the coefficient that `speed_law` gives; 1 is the law itself. Left out: `level` is given."""
    increments: Increments
    """Growth of the coefficient along the train. Always stated: law = "none", or "logarithmic" for JP5484215 (15)."""
    curve: Curve = Curve()

    @model_validator(mode="after")
    def _check_level(self) -> "RailKeys":
        needed, excluded = "level", "law_factor"
        if self.speed_law != "none":
            needed, excluded = excluded, needed
        if getattr(self, needed) is None or getattr(self, excluded) is not None:
            raise ValueError(f"speed_law = {self.speed_law!r} needs {needed}, and no {excluded}")
        return self

    def build_rail(self, axles: int, factor: float, seed: int) -> plant.Rail:
        """The plant's rail under a train of so many axles, with `factor` on its level; `seed` draws the scatter."""
        increments = self.increments.increments_per_axle(axles, "rail.increments")
        curve = self.curve.build_curve("rail.curve")
        rail: plant.Rail = build_record(self, "rail", increments=increments, curve=curve, seed=seed)
        bare = replace(rail, increments=None, scatter=0.0, conditioning=0.0)
        if (most := bare.greatest_peak()) > MOST_COEFFICIENT:
            fault = f"give a coefficient of {most:.3g}; at most 1 is possible"
            raise StudyError(f"rail: level, speed_law and patches {fault}")
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

    def build_line(self) -> plant.Line:
        """The plant's line."""
        start = tuple(section.start_m for section in self.sections)
        grade = tuple(1e-3 * section.grade_permille for section in self.sections)
        with name_keys(self, "line.sections"):
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

    def draw_day(self, seed: int) -> tuple[float, float, float]:
        """Factor on the level, shift of the start [m], delay of the commands [s]."""
        if seed == 0:
            return 1.0, 0.0, 0.0
        generator = np.random.default_rng([seed, 5])  # a stream of its own
        level, start, delay = generator.random(3).tolist()
        low, high = self.level
        return low + (high - low) * level, self.start_m * (2.0 * start - 1.0), self.delay_s * delay


# the train's computers


_Belief: Any = make_table(
    Assumed, "mass_factor", "resistance_factor", "lag_factor", "inertia_factor", "brake_factor"
)


class BeliefKeys(_Belief):
    """What the train believes where that differs from the truth."""

    increments: Increments | None = None
    """Growth of the coefficient along the train. Left out: the rail's."""
    curve: Curve | None = None
    """Adhesion curve. Left out: the rail's."""

    def build_belief(self, rail: RailKeys, axles: int) -> Assumed:
        """The belief of a train of so many axles on this rail."""
        growth, curve = self.increments or rail.increments, self.curve or rail.curve
        increments = growth.increments_per_axle(axles, "belief.increments")
        plain = curve.build_curve("belief.curve")
        belief: Assumed = build_record(self, "belief", increments=increments, curve=plain)
        return belief


_Equipment: Any = make_table(
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

    def build_onboard(self, belief: Assumed, seed: int) -> Onboard:
        """The equipment of a train with this belief; `seed` draws the errors of its sensors."""
        onboard: Onboard = build_record(self, "onboard", belief=belief)
        return replace(onboard, sensors=replace(onboard.sensors, seed=seed))


# the event

DRAWN = re.compile(r"(population|random)-(0|[1-9]\d{0,8})-(\d{4}|[1-9]\d{4,8})")
"""Name of a drawn event: its population (of the benchmark, of the claims), the seed of that, its number."""
MOST_OF_EFFORT = 1.5
"""Effort that is asked for over the most that the motors give; beyond, it is hardly meant."""


def find_remarks(event: Event) -> Iterator[str]:
    """What is possible in an event, but hardly meant: a sentence for each, which names the key."""
    train, rows, step = event.train, rows_of_train(event.train), 0.05
    wheelsets, drives, brakes = rows.wheelsets, rows.drives, rows.cylinders.size > 0
    needs = planned_coefficients(
        wheelsets, wheelsets.inertia, wheelsets.static_load, train.mass, True, brakes
    )["brake_planned"]
    command = event.command.sampled(np.arange(0.0, event.duration, step))
    if not command.any():
        yield f"command: none asks for an acceleration before the end, duration_s = {event.duration:g}"
    most = rows.effort.max(axis=1, initial=0.0)
    motors = float((most * drives.axles * drives.gear / drives.radius).sum())
    motors /= train.mass + train.rotating_mass
    for k, acceleration in enumerate(event.command.accelerations, 1):
        key = f"command[{k}].acceleration_kmhs = {3.6 * acceleration:.6g}"
        needed = -acceleration * needs
        if needed > MOST_COEFFICIENT:
            yield f"{key} needs a coefficient of {needed:.3g}; no rail has more than 1"
        if acceleration > MOST_OF_EFFORT * motors:
            yield f"{key} is beyond the motors, which reach {3.6 * motors:.3g} on a level line"
    downhill = GRAVITY * max(0.0, -min(event.line.grades))
    speed = event.initial_speed + step * np.cumsum(np.maximum(command, 0.0) + downhill)
    head = event.initial_position + step * float(speed.sum())
    tail = event.initial_position - train.length
    for k, patch in enumerate(event.rail.patches, 1):
        if patch.start - patch.edge > head or patch.end + patch.edge < tail:
            yield f"rail.patches[{k}]: no axle is ever between start_m = {patch.start:g} and end_m = {patch.end:g}"
        if patch.begin - patch.fade > event.duration or patch.until + patch.fade < 0.0:
            yield f"rail.patches[{k}]: the run is not between begin_s = {patch.begin:g} and until_s = {patch.until:g}"


def _fill_train(entry: Schema) -> None:
    entry["anyOf"] = [{"enum": [*TRAINS]}, {"type": "string", "pattern": r"\.toml$"}]


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
    train: str | TrainKeys = Field(json_schema_extra=_fill_train)
    """Name of a train set, or path of a train file counted from the scenario's folder."""
    load_t: tuple[Annotated[float, Field(ge=0.0)], ...] | None = None
    """Pay load of each car in the order in which the train is described. Left out: the train's."""
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
        with name_source(f"scenario {self.name!r}"):
            return self.build_event(seed)

    def build_event(self, seed: int) -> Event:
        """As `event`; the message of a fault does not name the scenario."""
        if seed < 0:
            raise StudyError(f"seed = {seed}: must be 0 or greater")
        rail_seed, sensor_seed, phase = np.random.SeedSequence(seed).generate_state(3).tolist()
        factor, shift, delay = self.variation.draw_day(seed) if self.variation else (1.0, 0.0, 0.0)
        train = self._build_train()
        axles = train.axle_count
        rail = self.rail.build_rail(axles, factor, rail_seed)
        phase = 2.0 * math.pi * phase / 2.0**32 if self.receptivity.amplitude else 0.0
        receptivity = build_record(self.receptivity, "receptivity", phase=phase)
        belief = self.belief.build_belief(self.rail, axles)
        onboard = self.onboard.build_onboard(belief, sensor_seed)
        times = tuple(step.time_s + delay for step in self.command)
        accelerations = tuple(step.acceleration_kmhs / 3.6 for step in self.command)
        start, speed = self.start_m + shift, self.initial_speed_kmh / 3.6
        failures = {failure.unit - 1: failure.time_s for failure in self.failures}
        with name_keys(self, "command"):
            command = DriverCommand(times, accelerations)
        with name_keys(self):
            event = Event(
                name=self.name,
                train=train,
                rail=rail,
                command=command,
                onboard=onboard,
                line=self.line.build_line(),
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

    def _build_train(self) -> Train:
        """The train as it runs."""
        with name_keys(self, "train"):
            train = find_train(self.train) if isinstance(self.train, str) else self.train.train
        if self.load_t is not None:
            with name_keys(self, "load_t"):
                train = train.loaded(tuple(1e3 * load for load in self.load_t))
        changes = self.motors.si_values() if self.motors else {}
        changes |= {"inverter_group": self.inverter_group} if self.inverter_group else {}
        if changes or self.load_transfer:
            cars = tuple(
                replace(car, motors=car.motors and replace(car.motors, **changes))
                for car in train.cars
            )
            train = replace(train, cars=cars, load_transfer=self.load_transfer)
        return train.reversed() if self.reversed else train

    def changed(self, **values: Any) -> "Scenario":
        """With other values of keys, checked again; a table replaces the table. Raises `StudyError`."""
        keys = self.model_dump(mode="json", exclude_unset=True)
        return make_scenario(keys | values, f"scenario {self.name!r}")

    @property
    def text(self) -> str:
        """All that identifies the scenario, as JSON: the keys that its file states."""
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
        return tuple(dict.fromkeys([*(CURVES.origin(curve.kind) for curve in curves), *train]))

    def __eq__(self, scenario: object) -> bool:
        return isinstance(scenario, Scenario) and self.text == scenario.text

    def __hash__(self) -> int:
        return hash(self.text)

    def __reduce__(self) -> Any:  # tables of records have no name in a module
        return _restore_scenario, (self.text,)


@lru_cache(maxsize=256)
def _restore_scenario(text: str) -> Scenario:
    return Scenario.model_validate_json(text)


def make_scenario(data: Mapping[str, Any], source: str, folder: Path = Path()) -> Scenario:
    """A scenario of these keys; raises `StudyError` of one line that names the `source` and the key.

    The content of a train file, whose path counts from `folder`, becomes a part of the scenario.
    """
    with name_source(source):
        train = data.get("train")
        if isinstance(train, str | Path) and str(train).endswith(".toml"):
            data = {**data, "train": read_train(folder / train)}
        return check_keys(Scenario, data)
