"""A train as records: cars with wheelsets, motors and brakes, and the couplers between them. SI units, validated.

`alloc.plant.rows` makes rows of them.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import MISSING, dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from alloc.laws import GRAVITY, PI, speed_law
from alloc.plant.rail import SPEED_LAWS
from alloc.schema.errors import PlantError
from alloc.schema.parameters import NOT_IN_FILES, PlantParameters, quantity

Floats = NDArray[np.float64]
InverterGroup = Literal["1C4M", "1C2M", "1C1M"]
"""Motors per inverter: a whole car, a bogie, an axle."""
MotorKind = Literal["torque", "induction"]
"""How the motors of a unit divide its torque. "torque": equally, whatever their speeds. "induction": in parallel on one
frequency, by the slip of each."""
EFFORT_SPEED_STEP = 1.0 / 3.6
"""Spacing [m/s] of tabulated torque limits: 1 km/h, the spacing of published effort curves."""
EFFORT_TABLE_LENGTH = 402
"""Tables reach 401 km/h; beyond, the last value is used."""
BREAKDOWN = 2.5
"""Breakdown torque of an induction motor over the greatest torque that is asked of it. Source: assumed."""
BREAKDOWN_SLIP = 10.0 * PI
"""Speed between field and rotor at that torque [rad/s]: 300/min gives a slip of 63/min at the greatest torque, like the
1.4 % of 4200/min on the nameplate of CRH2's motors (300 kW, 140 Hz, 4140/min)."""
MOST_AXLES = 2000
"""Largest number of axles; the longest trains have some 1500."""


@dataclass(frozen=True)
class Motors(PlantParameters):
    """Traction motors of a driven car: torque and power of one motor, or the car's tractive effort over the speed.

    The electric brake is as strong as the drive where nothing is said, and missing with a table of effort.
    """

    gear_ratio: float = quantity(MISSING, "1", above=0.0, most=100.0)
    """Turns of the motor per turn of the wheel."""
    inverter_group: InverterGroup = "1C4M"
    """Motors per inverter: a traction unit is a car (1C4M), a bogie (1C2M) or an axle (1C1M)."""
    torque: float | None = quantity(None, "N m")
    """Greatest torque of a motor. Left out: a table of effort is given."""
    power: float | None = quantity(None, "kW")
    """Greatest power of a motor. Left out: a table of effort is given."""
    effort_speed: tuple[float, ...] = quantity((), "km/h")
    """Speeds of the table of tractive effort, growing from 0 or more. Left out: torque and power are given."""
    effort: tuple[float, ...] = quantity((), "kN")
    """Tractive effort of the car at the rims at each of these speeds. Left out: torque and power are given."""
    brake_torque: float | None = quantity(None, "N m")
    """Greatest braking torque of a motor. Left out: `torque`; with a table of effort there is no electric brake."""
    brake_power: float | None = quantity(None, "kW")
    """Greatest braking power of a motor. Left out: `power`; with a table of effort there is no electric brake."""
    pull_out_speed: float | None = quantity(None, "km/h", above=0.0)
    """Speed from which the torque falls with the square of the speed. Left out: it never does."""
    fade_speed: float = quantity(5.0 / 3.6, "km/h")
    """Speed below which the electric brake fades. Source: assumed."""
    planned_adhesion: Literal["shinkansen", "curtius-kniffler"] | None = None
    """Speed law of the coefficient for which drive and brake are planned: they ask no more of a wheel under the empty car.
    Left out: torque and power alone decide."""
    torque_lag: float = quantity(5e-3, "s", above=0.0)
    """Time constant of the torque behind its command. Source: readhesion paper, section 2.2."""
    kind: MotorKind = "torque"
    """How the motors of an inverter divide its torque: torque, equally; induction, at one frequency, by their speeds. A
    single motor has all of it."""

    def _find_faults(self) -> Iterator[str]:
        speeds, efforts = self.effort_speed, self.effort
        if not speeds and not efforts:
            if None in (self.torque, self.power):
                yield "give torque and power, or effort_speed and effort"
        elif any((self.torque, self.power, self.pull_out_speed, self.planned_adhesion)):
            yield "effort takes the place of torque, power, pull_out_speed and planned_adhesion"
        elif len(speeds) != len(efforts) or len(speeds) < 2:
            yield f"{len(speeds)} effort_speed and {len(efforts)} effort; give as many, 2 or more"
        elif any(b <= a for a, b in itertools.pairwise(speeds)):
            yield "effort_speed must grow"

    def limits(self, radius: float, count: int, axle_mass: float) -> Floats:
        """Largest torque of a motor [N m], pulling and braking, by `EFFORT_SPEED_STEP`, (2, EFFORT_TABLE_LENGTH).

        On wheels of `radius` [m]; `count`: motors of the car; `axle_mass` [kg]: of the empty car on an axle.
        """
        speed = EFFORT_SPEED_STEP * np.arange(EFFORT_TABLE_LENGTH)
        moving, per_force = np.maximum(speed, 1e-3), radius / self.gear_ratio

        def limit_torque(torque: float, power: float) -> Floats:
            return np.minimum(torque, power * per_force / moving)

        torque, power = self.torque or 0.0, self.power or 0.0
        drive = limit_torque(torque, power) * np.minimum(
            1.0, (self.pull_out_speed or np.inf) / moving
        )
        if self.effort:
            drive = per_force / max(count, 1) * np.interp(speed, self.effort_speed, self.effort)
        brake = limit_torque(
            torque if self.brake_torque is None else self.brake_torque,
            power if self.brake_power is None else self.brake_power,
        )
        if self.planned_adhesion:
            coefficient = speed_law(speed, *SPEED_LAWS[self.planned_adhesion])
            most = per_force * coefficient * axle_mass * GRAVITY
            drive, brake = np.minimum(drive, most), np.minimum(brake, most)
        if self.fade_speed > 0.0:
            brake = brake * np.minimum(1.0, speed / self.fade_speed)
        return np.stack([drive, brake])

    def slip_torque(self, greatest: float) -> float:
        """Torque over the speed between motor and field [N m s/rad]: 2 M / s of the breakdown, by Kloss near synchronism.

        `greatest`: torque that is asked of it [N m]. 0 where every motor has a torque control, or an inverter, of its own.
        """
        if self.inverter_group == "1C1M" or self.kind == "torque":
            return 0.0
        return 2.0 * BREAKDOWN * greatest / BREAKDOWN_SLIP


@dataclass(frozen=True)
class AirBrake(PlantParameters):
    """Friction brake of a car; one pair of valves per bogie.

    Shoe force at the rim per axle = `force` x cylinder pressure / `pressure` x friction(V) x `friction_factor`, friction(V)
    = numerator / (V + offset) + constant with V in km/h, relative to the force at constant friction.
    """

    pressure: float = quantity(MISSING, "kPa", above=0.0)
    """Largest pressure of the cylinders."""
    force: float = quantity(MISSING, "kN")
    """Shoe force of one axle at the rim, at that pressure."""
    lag: float = quantity(1.2, "s", above=0.0)
    """Time constant of filling and of releasing the cylinders. Source: assumed."""
    release_lag: float | None = quantity(None, "s", above=0.0)
    """Time constant of releasing the cylinders. Left out: `lag`."""
    dead_time: float = quantity(0.05, "s")
    """Time between a command and the valve's response."""
    pipe_wave: float | None = quantity(None, "m/s", above=0.0)
    """Speed at which the command runs along the brake pipe from the train's head. Left out: it is everywhere at once."""
    friction: tuple[float, float, float] = quantity((0.0, 1.0, 1.0), "1")
    """Friction over the speed, a, b and c of a / (V + b) + c with V in km/h, relative to that with which `force` holds."""
    cut_out: tuple[int, ...] = field(default=(), metadata=NOT_IN_FILES)
    """Bogies of the car, 0 = foremost, whose brake is isolated: their cylinders fill, but no shoe acts. The train's
    computers have no information on it."""
    friction_factor: float = field(default=1.0, metadata=NOT_IN_FILES)
    """Shoe friction over that of the design. The train's computers have no information on it."""

    def _find_faults(self) -> Iterator[str]:
        if len(self.friction) != 3 or self.friction[1] == 0.0:
            yield "`friction` must be three numbers, the offset > 0"
        if not all(isinstance(bogie, int) and bogie >= 0 for bogie in self.cut_out):
            yield "`cut_out` must be numbers of bogies, 0 = foremost"
        if not self.friction_factor > 0.0:
            yield "`friction_factor` must exceed 0"


@dataclass(frozen=True)
class Car(PlantParameters):
    """One car: masses, wheelsets, motors and brakes."""

    length: float = quantity(MISSING, "m", above=0.0)
    """Length over couplers."""
    mass: float = quantity(MISSING, "t", above=0.0)
    """Empty mass."""
    axle_positions: tuple[float, ...] = quantity(MISSING, "m")
    """Positions of the axles from the car's front end."""
    bogie_of_axle: tuple[int, ...] = quantity(MISSING, "1")
    """Number of each axle's bogie, 0, 1, ... from the front."""
    wheel_radius: float = quantity(MISSING, "m", least=0.1, most=2.0)
    """Radius of the wheels."""
    wheel_inertia: float = quantity(MISSING, "kg m2", above=0.0)
    """Inertia of a wheelset at the wheel, with everything geared to it."""
    load: float = quantity(0.0, "t")
    """Pay load. JP5484215 calls empty mass and load per axle W0, dW."""
    driven: tuple[bool, ...] | None = None
    """Whether each axle has a motor. Left out: every axle, if there are motors."""
    motors: Motors | None = None
    """Traction motors. Left out: none."""
    air_brake: AirBrake | None = None
    """Friction brake. Left out: none."""
    centre_of_mass_height: float = quantity(1.6, "m")
    """Height above the rail."""
    pivot_height: float = quantity(0.5, "m")
    """Height above the rail at which bogies pull the body."""
    speed_sensors: bool = True
    """Whether its axles have speed sensors for the train's computers; those of a freight wagon have none."""
    axle_load_share: tuple[float, ...] | None = quantity(None, "1", above=0.0)
    """Share of the car's weight on each axle. If the sum is below 1, axles that are not modelled carry the rest (a single
    axle with its part of a train). Left out: equal shares."""
    name: str = field(default="", metadata=NOT_IN_FILES)
    """How messages call it."""

    @property
    def owner(self) -> str:
        """As in `Record`."""
        return f"car {self.name!r}"

    def _find_faults(self) -> Iterator[str]:
        n, positions, bogies = len(self.axle_positions), self.axle_positions, self.bogie_of_axle
        if n == 0:
            yield "has no axles; give axle_positions"
        for name, values in (("bogie_of_axle", bogies), ("driven", self.powered)):
            if len(values) != n:
                yield f"{name} has {len(values)} entries for {n} axles"
        if any(b <= a for a, b in itertools.pairwise(positions)):
            yield "`axle_positions` must grow from the front"
        if positions[-1] > self.length:
            yield f"`axle_positions` leave the car's {self.length} m"
        if bogies[0] != 0 or any(b - a not in (0, 1) for a, b in itertools.pairwise(bogies)):
            yield "`bogie_of_axle` must count 0, 1, ... from the front"
        if any(self.powered) and self.motors is None:
            yield "has driven axles but no motors"
        if any(self.powered) and not self.speed_sensors:
            yield "has driven axles but no speed_sensors; motors need them"
        cut_out = () if self.air_brake is None else self.air_brake.cut_out
        if any(bogie > bogies[-1] for bogie in cut_out):
            yield f"`air_brake.cut_out`, but its bogies are 0 to {bogies[-1]}"
        share = self.axle_load_share
        if share is not None and (len(share) != n or sum(share) > 1.0 + 1e-9):
            yield f"`axle_load_share` must be {n} values > 0 with a sum of 1 at most"

    @property
    def loaded_mass(self) -> float:
        """Mass with load [kg]."""
        return self.mass + self.load

    @property
    def inertia(self) -> float:
        """Of all its wheelsets at the wheel [kg m2]."""
        return len(self.axle_positions) * self.wheel_inertia

    @property
    def powered(self) -> tuple[bool, ...]:
        """Whether each axle has a motor."""
        return self.driven or (self.motors is not None,) * len(self.axle_positions)

    @property
    def shares(self) -> Floats:
        """Share of the weight on each axle, (axles,)."""
        n = len(self.axle_positions)
        return np.array(self.axle_load_share or (1.0 / n,) * n)

    @property
    def brake_groups(self) -> int:
        """Number of pairs of brake valves: one per bogie."""
        return 0 if self.air_brake is None else max(self.bogie_of_axle) + 1

    def units(self) -> list[list[int]]:
        """Axles of each traction unit of this car (indices from the car's front)."""
        if self.motors is None:
            return []
        count = len(self.powered)
        part = {"1C4M": [0] * count, "1C2M": self.bogie_of_axle, "1C1M": range(count)}
        axles = [i for i, has_motor in enumerate(self.powered) if has_motor]
        groups = itertools.groupby(axles, key=part[self.motors.inverter_group].__getitem__)
        return [list(members) for _, members in groups]

    def unloading(self) -> Floats:
        """Load [N] lost by each axle per newton of the car's rail force, (axles,), summing to zero.

        Quasi-static pitch: the force acts at the rail and the inertia at the centre of mass, so the car's weight moves from
        the front bogie to the rear one. Within a bogie its share of the force acts at pivot height, and does the same
        between its axles. A bogie of one axle cannot carry such a moment and transmits its force at the rail. A car with one
        bogie carries the whole moment there. The moment of coupler forces is neglected.
        """
        positions, bogies = np.array(self.axle_positions), np.array(self.bogie_of_axle)
        acting = np.array(self.powered if any(self.powered) else [True] * positions.size)
        members = [np.flatnonzero(bogies == b) for b in np.unique(bogies)]
        centres = np.array([positions[inside].mean() for inside in members])
        factors, body_moment = np.zeros(positions.size), self.centre_of_mass_height
        for inside, centre in zip(members, centres, strict=True):
            if inside.size > 1:
                height = self.pivot_height if len(members) > 1 else self.centre_of_mass_height
                moment = height * acting[inside].sum() / acting.sum()
                arm = centre - positions[inside]  # > 0 in front
                factors[inside] += moment * arm / np.sum(arm**2)
                body_moment -= moment
        if len(members) > 1:
            arm = centres.mean() - centres
            for inside, part in zip(members, body_moment * arm / np.sum(arm**2), strict=True):
                factors[inside] += part / inside.size
        return factors

    def reversed(self) -> "Car":
        """The same car running in the other direction."""
        last, share, brake = max(self.bogie_of_axle), self.axle_load_share, self.air_brake
        if brake is not None:
            brake = replace(brake, cut_out=tuple(sorted(last - b for b in brake.cut_out)))
        return replace(
            self,
            air_brake=brake,
            axle_positions=tuple(self.length - p for p in reversed(self.axle_positions)),
            bogie_of_axle=tuple(last - b for b in reversed(self.bogie_of_axle)),
            driven=self.powered[::-1],
            axle_load_share=None if share is None else share[::-1],
        )


@dataclass(frozen=True)
class Coupler(PlantParameters):
    """Draft gear between two cars: a spring that may stiffen, a damper, and slack.

    Source: assumed.
    """

    stiffness: float = quantity(2.0e7, "N/m", above=0.0)
    """Stiffness."""
    stiffening: float = quantity(0.0, "N/m3")
    """Force over the cube of the stretch."""
    damping: float = quantity(2.0e5, "N s/m")
    """Damping."""
    slack: float = quantity(0.0, "mm")
    """Slack."""


@dataclass(frozen=True)
class Train(PlantParameters):
    """A train in its running order, foremost car first."""

    name: str
    cars: tuple[Car, ...]
    resistance: tuple[float, float, float] = quantity((0.0, 0.0, 0.0), "1")
    """A [N], B [N s/m], C [N s2/m2] of the running resistance of the whole train, A + B v + C v^2. Cars share A and B by
    mass, C by length."""
    couplers: tuple[Coupler, ...] | None = None
    """Draft gear behind each car but the last. Left out: a rigid train."""
    load_transfer: bool = False
    """Whether the rail force of a car moves load from its front axles to its rear ones."""
    planned_acceleration: float = quantity(0.0, "km/h/s", least=-math.inf)
    """Acceleration that the plan asks for on level track."""
    source: str = ""
    """Where its figures come from."""
    sources: dict[str, str] = field(default_factory=dict, hash=False, compare=False)
    """Where each value comes from."""

    @property
    def owner(self) -> str:
        """As in `Record`."""
        return f"train {self.name!r}"

    def _find_faults(self) -> Iterator[str]:
        if not self.cars:
            yield "has no cars"
        if self.axle_count > MOST_AXLES:
            yield f"has {self.axle_count} axles; give {MOST_AXLES} at most"
        if len(self.resistance) != 3:
            yield "`resistance` must be three numbers"
        if self.couplers is not None and len(self.couplers) != len(self.cars) - 1:
            reason = f"{len(self.couplers)} couplers for {len(self.cars)} cars"
            yield f"{reason}; give {len(self.cars) - 1}, or none for a rigid train"

    def __repr__(self) -> str:
        kind = "rigid" if self.couplers is None else "coupled"
        return f"<Train {self.name!r}: {len(self.cars)} cars, {self.mass / 1e3:.1f} t, {kind}>"

    @property
    def mass(self) -> float:
        """Mass with load [kg]."""
        return sum(car.loaded_mass for car in self.cars)

    @property
    def length(self) -> float:
        """Length over couplers [m]."""
        return sum(car.length for car in self.cars)

    @property
    def axle_count(self) -> int:
        """Number of axles."""
        return sum(len(car.axle_positions) for car in self.cars)

    @property
    def rotating_mass(self) -> float:
        """Mass [kg] that the inertia of the wheelsets adds to a train that rolls without slip."""
        return sum(car.inertia / car.wheel_radius**2 for car in self.cars)

    def reversed(self) -> "Train":
        """The same train running in the other direction: rearmost car first, each car reversed."""
        couplers = None if self.couplers is None else self.couplers[::-1]
        cars = tuple(car.reversed() for car in reversed(self.cars))
        return replace(self, cars=cars, couplers=couplers)

    def loaded(self, loads: Sequence[float]) -> "Train":
        """The same train with a pay load [kg] per car."""
        if len(loads) != len(self.cars):
            reason = f"{len(loads)} loads for {len(self.cars)} cars; give one per car"
            raise PlantError(f"{self.owner}: {reason}")
        cars = zip(self.cars, loads, strict=True)
        return replace(self, cars=tuple(replace(car, load=load) for car, load in cars))
