"""A train from railtoolkit vehicles, and what has to be assumed because the format does not say it.

The format gives masses, length, effort and resistance, but no wheelsets. Bogies are counted from the length, the driven ones
from `mass_traction`; each driven bogie is one traction unit.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, ClassVar, Literal

from pydantic import Field, model_validator

from alloc.display import displayed
from alloc.errors import PlantError
from alloc.plant.laws import GRAVITY
from alloc.plant.rail import Line
from alloc.plant.train import AirBrake, Car, Motors, TorqueLimit, Train
from studies.files.strict import Foreign
from studies.files.study_error import StudyError
from studies.files.units import range_fault

# A line and a train as a line run needs them, from whatever file they come.

Measure = Literal["front", "middle", "rear"]
SHARE_BEHIND: dict[Measure, float] = {"front": 0.0, "middle": 0.5, "rear": 1.0}
"""How far behind the front each point of the train is, as a share of its length."""


@displayed
@dataclass(frozen=True)
class Section:
    """A stretch of line of one gradient and one speed limit: start, end [m], grade as rise per run, limit [m/s]."""

    start: float
    """[m]"""
    end: float
    """[m]"""
    grade: float
    """Rise per run, positive uphill."""
    speed_limit: float = math.inf
    """[m/s]"""


@displayed
@dataclass(frozen=True)
class PointOfInterest:
    """A point of the line [m] that the train's front, middle or rear is to pass; with a dwell [s] the front stops there."""

    station: float
    """Its place on the line [m]."""
    name: str
    measure: Measure = "front"
    dwell: float | None = None
    """Time for which the front stops there [s]; None: the train passes."""

    def front_position(self, length: float) -> float:
        """Where the front of a train of this `length` [m] is when it passes."""
        return self.station + SHARE_BEHIND[self.measure] * length


@displayed
@dataclass(frozen=True)
class RunningPath:
    """A line, run from its start to its end."""

    name: str
    sections: tuple[Section, ...]
    points: tuple[PointOfInterest, ...] = ()
    source: str = ""

    @property
    def span(self) -> tuple[float, float]:
        """Start and end of the line [m]."""
        return self.sections[0].start, self.sections[-1].end

    def line(
        self, tunnels: tuple[tuple[float, float], ...] = (), tunnel_factor: float = 1.0
    ) -> Line:
        """The plant's line; running paths have no tunnels, so these are arguments."""
        return Line(
            stations=tuple(section.start for section in self.sections),
            grades=tuple(section.grade for section in self.sections),
            tunnels=tunnels,
            tunnel_factor=tunnel_factor,
        )

    def steepest(self) -> Section:
        """The steepest climb; the first one where several are equal."""
        return max(self.sections, key=lambda section: section.grade)

    def stops(self) -> tuple[PointOfInterest, ...]:
        """Points at which the train stops, in order."""
        return tuple(
            sorted((p for p in self.points if p.dwell is not None), key=lambda p: p.station)
        )


def sections(rows: Sequence[tuple[float, float, float]]) -> tuple[Section, ...]:
    """Sections from rows of start [m], limit [km/h], gradient [per mille]; the last row only marks the end of the line."""
    return tuple(
        Section(start, following[0], 1e-3 * grade, limit / 3.6)
        for (start, limit, grade), following in pairwise(rows)
    )


@displayed
@dataclass(frozen=True)
class RollingStock:
    """A train that can run a line by itself: with its load, its brake and what it is allowed."""

    train: Train
    speed_limit: float
    """Of its slowest vehicle [m/s]; inf if none has one."""
    deceleration: float
    """Under the service brake, in total: with resistance and gradient [m/s2], > 0."""

    @property
    def length(self) -> float:
        """[m]"""
        return sum(car.length for car in self.train.cars)


# Keys of railtoolkit files, schemas 2022.05 and 2024.07, that this project reads, with their units and bounds.

MOST_SECTIONS = 20_000
LONGEST_LINE = 2e6
"""[m]; a train runs it in a day."""
VERSIONS = ("2022.05", "2024.07")
"""Versions of both schemas; that of rolling stock is the same in both."""


def check_line(rows: Sequence[tuple[float, float, float]], where: str) -> None:
    """Raise `ValueError` unless rows of start [m], limit [km/h] and gradient [per mille] make a line; `where`: their key."""
    for k, (start, limit, grade) in enumerate(rows):
        for key, value in (("start_m", start), ("limit_kmh", limit), ("grade_permille", grade)):
            if (fault := range_fault(key, value)) is not None:
                raise ValueError(f"{where}[{k + 1}]: {value:g} {fault}")
        if limit <= 0.0:
            raise ValueError(f"{where}[{k + 1}]: speed limit {limit:g} km/h must exceed 0")
        if k and start <= rows[k - 1][0]:
            raise ValueError(
                f"{where}[{k + 1}]: start {start:g} m must lie beyond the one before, {rows[k - 1][0]:g} m; "
                "give the sections in the order in which the train meets them, positions growing"
            )
    length = rows[-1][0] - rows[0][0]
    if length > LONGEST_LINE:
        raise ValueError(f"{where}: the line is {length:g} m long; give {LONGEST_LINE:g} m at most")


def check_points(
    points: Sequence[tuple[float, str]], ends: tuple[float, float], where: str
) -> None:
    """Raise `ValueError` unless points, each a station [m] and a name, lie on the line between its `ends` [m]."""
    first, last = ends
    for k, (station, name) in enumerate(points):
        if not first <= station <= last:
            raise ValueError(
                f"{where}[{k + 1}]: {name!r} at {station:g} m lies off the line, which is {first:g} m to {last:g} m"
            )


class PathKeys(Foreign):
    """A running path of 2022.05: sections of start [m], speed limit [km/h], gradient [per mille].

    Points of interest: station [m], name, and which end of the train is meant to pass it.
    """

    unused: ClassVar[frozenset[str]] = frozenset({"UUID"})

    name: str
    id: str
    characteristic_sections: tuple[tuple[float, float, float], ...] = Field(
        min_length=2, max_length=MOST_SECTIONS
    )
    points_of_interest: tuple[tuple[float, str, Literal["front", "rear"]], ...] = ()

    @model_validator(mode="after")
    def _fits(self) -> "PathKeys":
        rows = self.rows()
        check_line(rows, "characteristic_sections")
        places = [point[:2] for point in self.points_of_interest]
        check_points(places, (rows[0][0], rows[-1][0]), "points_of_interest")
        return self

    @property
    def title(self) -> str:
        """What the path calls itself."""
        return self.name

    def rows(self) -> Sequence[tuple[float, float, float]]:
        """Sections as start [m], limit [km/h] and gradient [per mille]; the last one marks the end."""
        return self.characteristic_sections

    def points(self) -> Sequence[tuple[float, str, Measure]]:
        """Points of interest as station [m], name and measure."""
        return self.points_of_interest


class CharacteristicSection(Foreign):
    """A section of 2024.07: start [m], and what changes there: speed limit [km/h], gradient [per mille]."""

    position: float
    speed: float | None = Field(default=None, gt=0.0)
    resistance: float | None = None

    @model_validator(mode="after")
    def _says_something(self) -> "CharacteristicSection":
        if self.speed is None and self.resistance is None:
            raise ValueError("speed and resistance are missing; give at least one")
        return self


class MeasuredPoint(Foreign):
    """A point of interest of 2024.07: station [m], name, and which part of the train is meant to pass it."""

    position: float
    label: str
    measure: Measure


class NamedPathKeys(Foreign):
    """A running path of 2024.07, whose sections and points have named keys.

    The schema leaves open which value applies where a section lacks one of its two values; here it is that of the section
    before. Before the first value the line is level, and has no limit of its own.
    """

    unused: ClassVar[frozenset[str]] = frozenset({"UUID", "name"})

    id: str
    description: str = ""
    characteristic_sections: tuple[CharacteristicSection, ...] = Field(
        min_length=2, max_length=MOST_SECTIONS
    )
    points_of_interest: tuple[MeasuredPoint, ...] = ()

    @model_validator(mode="after")
    def _fits(self) -> "NamedPathKeys":
        rows = self.rows()
        check_line(rows, "characteristic_sections")
        places = [(point.position, point.label) for point in self.points_of_interest]
        check_points(places, (rows[0][0], rows[-1][0]), "points_of_interest")
        return self

    @property
    def title(self) -> str:
        """What the path calls itself."""
        return self.description or self.id

    def rows(self) -> Sequence[tuple[float, float, float]]:
        """Sections as start [m], limit [km/h] and gradient [per mille]; the last one marks the end."""
        limit, grade = math.inf, 0.0
        found = []
        for section in self.characteristic_sections:
            limit = limit if section.speed is None else section.speed
            grade = grade if section.resistance is None else section.resistance
            found.append((section.position, limit, grade))
        return found

    def points(self) -> Sequence[tuple[float, str, Measure]]:
        """Points of interest as station [m], name and measure."""
        return [(point.position, point.label, point.measure) for point in self.points_of_interest]


class VehicleKeys(Foreign):
    """A vehicle: lengths in m, masses in t, resistance coefficients in per mille, effort as pairs of km/h and N.

    `speed_limit` in km/h; `a_braking` in m/s2, negative: the acceleration under the service brake.
    """

    unused: ClassVar[frozenset[str]] = frozenset({"UUID", "picture", "power_type"})

    name: str
    id: str
    vehicle_type: Literal["traction unit", "freight", "passenger", "multiple unit"]
    length: float = Field(gt=0.0, le=1000.0)
    mass: float = Field(gt=0.0, le=5000.0)
    load_limit: float = Field(default=0.0, ge=0.0, le=5000.0)
    mass_traction: float | None = Field(default=None, gt=0.0)
    rotation_mass: float | None = Field(default=None, ge=1.0, le=5.0)
    base_resistance: float = Field(default=0.0, ge=0.0, le=1000.0)
    rolling_resistance: float = Field(default=0.0, ge=0.0, le=1000.0)
    air_resistance: float = Field(default=0.0, ge=0.0, le=1000.0)
    speed_limit: float | None = Field(default=None, gt=0.0, le=600.0)
    a_braking: float | None = Field(default=None, lt=0.0, ge=-5.0)
    tractive_effort: tuple[tuple[float, float], ...] | None = Field(
        default=None, min_length=2, max_length=5000
    )

    @model_validator(mode="after")
    def _fits(self) -> "VehicleKeys":
        if self.mass_traction is not None and self.mass_traction > self.mass * (1.0 + 1e-9):
            raise ValueError(f"mass_traction = {self.mass_traction} exceeds mass = {self.mass}")
        pairs = self.tractive_effort or ()
        if not all(0.0 <= speed <= 600.0 and 0.0 <= effort <= 1e7 for speed, effort in pairs):
            raise ValueError("tractive_effort must hold speeds from 0 to 600 km/h and 0 to 1e7 N")
        if any(b[0] <= a[0] for a, b in pairwise(pairs)):
            raise ValueError("tractive_effort: speeds must grow")
        if self.powered and (not pairs or self.mass_traction is None):
            missing = "tractive_effort" if not pairs else "mass_traction"
            raise ValueError(f"{missing} is missing for a {self.vehicle_type}")
        return self

    @property
    def powered(self) -> bool:
        """Whether the vehicle drives."""
        return self.vehicle_type in ("traction unit", "multiple unit")


class TrainKeys(Foreign):
    """A train: the vehicles' ids from front to rear."""

    unused: ClassVar[frozenset[str]] = frozenset({"UUID"})

    name: str
    id: str
    formation: tuple[str, ...] = Field(min_length=1, max_length=500)


class File(Foreign):
    """A file: it says which schema it follows."""

    unused: ClassVar[frozenset[str]] = frozenset({"schema", "schema_version"})

    @model_validator(mode="after")
    def _one_of_each(self) -> "File":
        for key in type(self).model_fields:
            ids: Counter[Any] = Counter(item.id for item in getattr(self, key))
            for name, count in ids.items():
                if count > 1:
                    often = "twice" if count == 2 else f"{count} times"
                    raise ValueError(f"{key}: id {name!r} is there {often}; give each its own")
        return self


class PathFile(File):
    """A file of running paths, 2022.05."""

    paths: tuple[PathKeys, ...] = Field(min_length=1)


class NamedPathFile(File):
    """A file of running paths, 2024.07."""

    paths: tuple[NamedPathKeys, ...] = Field(min_length=1)


class StockFile(File):
    """A file of rolling stock."""

    trains: tuple[TrainKeys, ...] = ()
    vehicles: tuple[VehicleKeys, ...] = Field(min_length=1)


BOGIE_SPACING = 20.0
"""Typical distance [m] between bogies of a section (two bogies on a coach of 26 m, three under an articulated pair)."""
LARGEST_AXLE_LOAD = 22.5e3
"""Axle load [kg] of line category D: a heavier vehicle is given more bogies."""
BOGIE_WHEELBASE = 1.9
WHEEL_RADIUS = 0.43
"""New wheels of most European multiple units have 0.77 m to 0.92 m diameter; 0.86 m is the readhesion paper's."""
GEAR_RATIO = 7.07
"""Of the readhesion paper; it cancels between effort, torque and wheel."""
DRIVEN_INERTIA_RATIO = 2.0
"""Inertia of a driven wheelset with its gear and motor over that of a carrying one."""
SERVICE_PRESSURE = 380e3
"""Cylinder pressure [Pa] of a full service application, as usual in Europe."""
BRAKE_LAG = 0.2
"""Time constant [s] of the brake cylinders, assumed: the format has a deceleration without build-up. So the brake is assumed
to be as quick as a good electropneumatic one, and the driver anticipates the rest."""
BRAKED_FALL = 0.05
"""Fall (per run) on which the full brake still reaches `a_braking`, assumed: the format gives the deceleration alone, on
whatever gradient. Running paths of standard railways stay below 0.04."""

ROTATION_MASS = {True: 1.09, False: 1.06}
"""Factor of the rotating masses of a driving vehicle, and of others, where the file has none: TrainRuns.jl, `Train`."""
PASSENGER_BRAKING, FREIGHT_BRAKING = 0.375, 0.225
"""Deceleration [m/s2] under the service brake where no vehicle has an `a_braking`, and with a freight wagon in the train:
Bruenger and Dahlhaus (2014), p. 74, the defaults of TrainRuns.jl."""

AIR_SPEED_MARGIN = 15.0 / 3.6
"""Headwind [m/s] that the resistance formula of traction units and coaches adds to the speed."""
REFERENCE_SPEED = 100.0 / 3.6


def resistance(vehicle: VehicleKeys, load_share: float = 0.0) -> tuple[float, float, float]:
    """A [N], B [N s/m], C [N s2/m2] of a vehicle with this share of its `load_limit`.

    Driving vehicles: Wende, Fahrdynamik des Schienenverkehrs (2003), p. 151; coaches and wagons: p. 153 (Sauthoff, Strahl).
    The coefficients of coaches and wagons act on mass and load. Those of driving vehicles are printed for the vehicle as
    it is, and stay so under load.
    """
    load = 0.0 if vehicle.powered else load_share * vehicle.load_limit
    weight = (vehicle.mass + load) * GRAVITY  # of tonnes: coefficients in per mille give N
    margin = 0.0 if vehicle.vehicle_type == "freight" else AIR_SPEED_MARGIN
    air = vehicle.air_resistance * weight / REFERENCE_SPEED**2
    linear = 0.0
    if vehicle.powered:
        assert vehicle.mass_traction is not None
        driven = vehicle.mass_traction / vehicle.mass
        mean = driven * vehicle.base_resistance + (1.0 - driven) * vehicle.rolling_resistance
        constant = mean * weight
    else:
        constant = vehicle.base_resistance * weight
        if vehicle.vehicle_type == "passenger":
            linear = vehicle.rolling_resistance * weight / REFERENCE_SPEED
    return constant + air * margin**2, linear + 2.0 * air * margin, air


def bogie_count(vehicle: VehicleKeys) -> int:
    """Bogies of two axles under a vehicle, from its length and mass."""
    by_length = round(vehicle.length / BOGIE_SPACING) + 1
    by_mass = math.ceil(1e3 * vehicle.mass / (2.0 * LARGEST_AXLE_LOAD))
    return max(by_length, by_mass, 2)


def driven_bogies(vehicle: VehicleKeys) -> list[int]:
    """Which bogies drive: as many as `mass_traction` loads at the mean axle load, from both ends inwards."""
    count = bogie_count(vehicle)
    if not vehicle.powered:
        return []
    assert vehicle.mass_traction is not None
    driven = max(1, round(count * vehicle.mass_traction / vehicle.mass))
    order = sorted(range(count), key=lambda b: (min(b, count - 1 - b), b))
    return sorted(order[:driven])


def rotation_mass(vehicle: VehicleKeys) -> float:
    """Factor of the vehicle's rotating masses."""
    given = vehicle.rotation_mass
    return ROTATION_MASS[vehicle.powered] if given is None else given


def default_deceleration(vehicles: Sequence[VehicleKeys]) -> float:
    """Deceleration [m/s2] under the service brake of a train none of whose vehicles has an `a_braking`."""
    freight = any(vehicle.vehicle_type == "freight" for vehicle in vehicles)
    return FREIGHT_BRAKING if freight else PASSENGER_BRAKING


def air_brake(mass: float, rotation_mass: float, axles: int, deceleration: float) -> AirBrake:
    """A brake on every axle of a car that gives `deceleration` [m/s2] on a fall of `BRAKED_FALL` at full pressure."""
    force = mass * (rotation_mass * deceleration + GRAVITY * BRAKED_FALL)
    return AirBrake(
        maximum_pressure=SERVICE_PRESSURE,
        force_per_pascal=force / (axles * SERVICE_PRESSURE),
        fill_time=BRAKE_LAG,
        release_time=BRAKE_LAG,
        dead_time=0.0,
    )


def build_car(
    vehicle: VehicleKeys,
    name: str,
    load_share: float = 0.0,
    deceleration: float | None = None,
    loading: float = 1.0,
) -> Car:
    """One car of the plant for a vehicle; an articulated one counts as one rigid car with all its bogies.

    `load_share` of its `load_limit` is on board. With a `deceleration` [m/s2] it has an air brake for it. `loading` is the
    mass of the loaded train over that of the empty one, in which proportion rotating masses grow, see `build_formation`.
    """
    bogies, driving = bogie_count(vehicle), driven_bogies(vehicle)
    overhang = min(3.5, 0.25 * vehicle.length)
    spacing = (vehicle.length - 2.0 * overhang) / (bogies - 1)
    centres = [overhang + spacing * b for b in range(bogies)]
    driven = tuple(b in driving for b in range(bogies) for _ in range(2))
    empty, load = 1e3 * vehicle.mass, 1e3 * load_share * vehicle.load_limit
    mass = empty + load
    share = None
    if driving and vehicle.mass_traction is not None:
        on_driven = vehicle.mass_traction / vehicle.mass
        count, others = sum(driven), len(driven) - sum(driven)
        if others == 0:
            on_driven = 1.0
        rest = (1.0 - on_driven) / others if others else 0.0
        if rest > 0.0 or not others:
            share = tuple(on_driven / count if d else rest for d in driven)
    weights = [DRIVEN_INERTIA_RATIO if d else 1.0 for d in driven]
    turning = max(rotation_mass(vehicle) - 1.0, 1e-3) * empty * loading
    rotating = turning * WHEEL_RADIUS**2
    motors = None
    if driving:
        speeds, efforts = zip(*(vehicle.tractive_effort or ()), strict=True)
        motors = Motors(
            group="1C2M",
            gear_ratio=GEAR_RATIO,
            drive=TorqueLimit.of_effort(speeds, efforts, WHEEL_RADIUS, GEAR_RATIO, sum(driven)),
            brake=TorqueLimit(peak=0.0, power=0.0),
        )
    half = 0.5 * BOGIE_WHEELBASE
    return Car(
        name=name,
        length=vehicle.length,
        empty_mass=empty,
        load=load,
        axle_positions=tuple(c + side for c in centres for side in (-half, half)),
        bogie_of_axle=tuple(b for b in range(bogies) for _ in range(2)),
        wheel_radius=WHEEL_RADIUS,
        wheel_inertia=tuple(rotating * w / sum(weights) for w in weights),
        driven=driven,
        motors=motors,
        air_brake=None
        if deceleration is None
        else air_brake(mass, 1.0 + turning / mass, len(driven), deceleration),
        axle_load_share=share,
    )


def build_formation(
    name: str,
    vehicles: Sequence[VehicleKeys],
    source: str,
    load_share: float = 0.0,
    deceleration: float | None = None,
) -> Train:
    """A rigid train of these vehicles, front to rear; its plan is its full effort at standstill.

    `load_share` and `deceleration` as in `build_car`. Rotating masses as in running-time programs: the train's factor is
    the mean of its vehicles' over their empty masses, and multiplies the mass of the loaded train.
    """
    empty = sum(vehicle.mass for vehicle in vehicles)
    loading = 1.0 + load_share * sum(vehicle.load_limit for vehicle in vehicles) / empty
    try:
        cars = tuple(
            build_car(v, f"{v.id} {k + 1}", load_share, deceleration, loading)
            for k, v in enumerate(vehicles)
        )
        terms = [resistance(vehicle, load_share) for vehicle in vehicles]
        a, b, c = (sum(term[k] for term in terms) for k in range(3))
        effort = sum(v.tractive_effort[0][1] for v in vehicles if v.powered and v.tractive_effort)
        bare = Train(name=name, cars=cars, resistance=(a, b, c), source=source)
        plan = (effort - a) / (bare.mass + bare.rotating_mass)
        return replace(bare, planned_acceleration=plan)
    except PlantError as error:
        raise StudyError(f"{source}: {error}") from None
