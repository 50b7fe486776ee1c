"""A train: wheelsets, traction units, brakes, sanders, cars and couplers. SI units, validated.

In: parameters with a source each. Out: a `Train`, and errors that name the field and the value.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from alloc.old.display import displayed
from alloc.old.errors import PlantError
from alloc.old.plant.laws import GRAVITY
from alloc.old.records import quantity

# Sanders: devices that lay sand ahead of an axle.


@dataclass(frozen=True)
class Sander:
    """Lays sand on both rails just ahead of an axle of its car, in either running direction.

    Source: the vehicle's.
    """

    axle: int
    """Number of the axle in its car, 0 = foremost."""
    rate: float
    """Sand per rail: the rate of a sander of fixed rate, else the largest rate [kg/s]."""
    amount: float | None = None
    """Sand per rail and metre that a sander of variable rate keeps to as long as `rate` allows [kg/m]. Left out: the rate is
    fixed."""

    def __post_init__(self) -> None:
        if isinstance(self.axle, bool) or not isinstance(self.axle, int) or self.axle < 0:
            raise PlantError(f"sander: axle = {self.axle!r} must be a whole number, 0 = foremost")
        amount = () if self.amount is None else ("amount",)
        PlantError.check("sander", self, positive=("rate", *amount))


# Components of a car: wheelsets, traction units, brakes. SI units, validated.


def triple(owner: str, name: str, values: tuple[float, float, float]) -> tuple[float, float, float]:
    """`values` as three floats; raises `PlantError` where they are not three finite numbers."""
    if len(values) != 3 or not all(math.isfinite(value) for value in values):
        raise PlantError(f"{owner}: {name} = {values} must be three finite numbers")
    return values


InverterGroup = Literal["1C4M", "1C2M", "1C1M"]
"""Motors per inverter: a whole car, a bogie, an axle."""
MotorKind = Literal["torque", "induction", "series"]
"""How the motors of a unit divide its torque. "torque": equally, whatever their speeds. "induction": in parallel on
one inverter. "series": direct-current series motors on one voltage."""

EFFORT_SPEED_STEP = 1.0 / 3.6
"""Spacing [m/s] of tabulated torque limits: 1 km/h, the spacing of published effort curves."""
EFFORT_TABLE_LENGTH = 402
"""Tables reach 401 km/h; beyond, the last value is used."""


@displayed
@dataclass(frozen=True)
class TorqueLimit:
    """Largest motor torque by rim speed: `peak` [N m] at the shaft, then constant `power` [W] per motor.

    Beyond `pull_out_speed` [m/s] the limit falls with the square of the speed (motor pull-out). If `table` is
    given (torque per motor every 1 km/h from standstill) it replaces the formula.
    """

    peak: float
    """Largest torque at the shaft [N m]."""
    power: float
    """Power of each motor [W]."""
    pull_out_speed: float = math.inf
    """[m/s]"""
    fade_speed: float = 0.0
    """Speed [m/s] below which the limit fades to zero linearly (electric brakes); 0: no fading."""
    table: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        speed, table = ("pull_out_speed",), () if self.table is None else ("table[]",)
        nonnegative = ("peak", "power", "fade_speed", *table)
        PlantError.check("torque limit", self, speed, nonnegative, infinite=speed)
        if self.table is not None and len(self.table) == 0:
            raise PlantError("torque limit: table is empty")

    @classmethod
    def of_effort(
        cls,
        speeds_kmh: Sequence[float],
        efforts: Sequence[float],
        radius: float,
        gear_ratio: float,
        motors: int,
    ) -> "TorqueLimit":
        """Limit of each of `motors` motors that together have these efforts [N] at the rims of wheels of `radius` [m].

        Linear between the given speeds [km/h]; before the first and beyond the last the nearest effort applies.
        """
        speed = np.arange(min(EFFORT_TABLE_LENGTH, math.ceil(speeds_kmh[-1]) + 1))
        torque = radius / (gear_ratio * motors) * np.interp(speed, speeds_kmh, efforts)
        return cls(peak=float(torque[0]), power=0.0, table=tuple(torque.tolist()))

    @property
    def greatest(self) -> float:
        """The largest torque at any speed [N m]."""
        return self.peak if self.table is None else max(self.table)

    def tabulate(self, radius: float, gear_ratio: float) -> NDArray[np.float64]:
        """Limit [N m] at multiples of `EFFORT_SPEED_STEP`, (EFFORT_TABLE_LENGTH,)."""
        if self.table is not None:
            values = np.array(self.table[:EFFORT_TABLE_LENGTH], dtype=float)
            return np.pad(values, (0, EFFORT_TABLE_LENGTH - values.size), "edge")
        speed = EFFORT_SPEED_STEP * np.arange(EFFORT_TABLE_LENGTH)
        shaft_speed = gear_ratio * np.maximum(speed, 1e-3) / radius
        limit = np.minimum(self.peak, self.power / shaft_speed)
        limit = limit * np.minimum(1.0, self.pull_out_speed / np.maximum(speed, 1e-3))
        if self.fade_speed > 0.0:
            limit = limit * np.minimum(1.0, speed / self.fade_speed)
        return np.asarray(limit)


NO_CHARACTERISTIC = (0.0, 1.0, 1.0)
"""`Motors.characteristic` of a motor with a torque control of its own, or of none."""
BREAKDOWN = 2.5
"""Breakdown torque of an induction motor over the greatest torque that is asked of it. Source: assumed."""
SLIP_SPEEDS = {"induction": 300.0 * math.pi / 30.0, "series": 120.0 * math.pi / 30.0}
"""`Motors.slip_speed` by kind of motor [rad/s]. 300/min: with `BREAKDOWN` a slip of 63/min at the greatest torque, like the
1.4 % of 4200/min on the nameplate of CRH2's motors (300 kW, 140 Hz, 4140/min). 120/min: assumed, a resistance that takes
6 % of the voltage at 2000/min."""


@displayed
@dataclass(frozen=True)
class Motors:
    """Traction motors of a driven car and the inverters that feed them."""

    group: InverterGroup
    gear_ratio: float
    drive: TorqueLimit
    brake: TorqueLimit
    torque_lag: float = 5e-3
    """Time constant of the torque [s]; 5 ms: readhesion paper, section 2.2."""
    kind: MotorKind = "torque"
    breakdown_torque: float | None = None
    """Largest torque of an induction motor [N m]. Left out: `BREAKDOWN` times the greatest torque that is asked of it."""
    slip_speed: float | None = None
    """Speed at the shaft [rad/s]: of an induction motor the slip between field and rotor at the breakdown torque, of a
    series motor the speed at which its resistance takes half of the voltage. Left out: `SLIP_SPEEDS`."""
    rotor_inertia: float = 0.0
    """Inertia of a rotor [kg m2] at its shaft, a part of the car's `wheel_inertia`, that turns on a twisting drive; 0: the
    drive is rigid."""
    shaft_stiffness: float = 5e6
    """Stiffness of that drive between rotor and wheelset [N m/rad], at the wheel. Source: a steel axle of 160 mm has
    G I / l = 5.1e6 over 1 m."""
    shaft_damping: float = 0.01
    """Damping of its oscillation over the critical one, below 1. Source: assumed."""

    def __post_init__(self) -> None:
        given = [
            name for name in ("breakdown_torque", "slip_speed") if getattr(self, name) is not None
        ]
        shaft = ("rotor_inertia", "shaft_damping")
        positive = ("gear_ratio", "torque_lag", "shaft_stiffness", *given)
        PlantError.check("motors", self, positive, nonnegative=shaft)
        if self.shaft_damping >= 1.0:
            raise PlantError(f"motors: shaft_damping = {self.shaft_damping!r} must be below 1")
        PlantError.check_choice("motors", "group", self.group, get_args(InverterGroup))
        PlantError.check_choice("motors", "kind", self.kind, get_args(MotorKind))
        if self.kind == "induction" and not self.breakdown > self.greatest:
            raise PlantError(
                f"motors: breakdown_torque = {self.breakdown_torque!r} must exceed the largest torque, {self.greatest:g} N m"
            )

    @property
    def greatest(self) -> float:
        """The largest torque of drive and brake [N m]."""
        return max(self.drive.greatest, self.brake.greatest)

    @property
    def breakdown(self) -> float:
        """The breakdown torque [N m]."""
        return BREAKDOWN * self.greatest if self.breakdown_torque is None else self.breakdown_torque

    @property
    def characteristic(self) -> tuple[float, float, float]:
        """Number of the kind, breakdown torque and slip, as `alloc.old.plant.laws.parallel_motor_torque` takes them.

        A single motor on an inverter has all of its torque.
        """
        if self.group == "1C1M" or self.kind == "torque":
            return NO_CHARACTERISTIC
        slip = SLIP_SPEEDS[self.kind] if self.slip_speed is None else self.slip_speed
        return float(get_args(MotorKind).index(self.kind)), self.breakdown, slip

    def shaft(self, inertia: float) -> tuple[float, float, float]:
        """Inertia of the rotor [kg m2], stiffness [N m/rad] and damping [N m s/rad] of the drive, all at the wheel.

        `inertia` [kg m2]: of wheelset and rotor. Zeros where the drive is rigid.
        """
        if not self.rotor_inertia:
            return 0.0, 0.0, 0.0
        rotor = self.rotor_inertia * self.gear_ratio**2
        reduced = rotor * (inertia - rotor) / inertia
        damping = 2.0 * self.shaft_damping * math.sqrt(self.shaft_stiffness * reduced)
        return rotor, self.shaft_stiffness, damping


@displayed
@dataclass(frozen=True)
class AirBrake:
    """Friction brake of a car; one pair of valves per bogie.

    Shoe force at the rim per axle = `force_per_pascal` x cylinder pressure x friction(V) x `friction_factor`, friction(V) =
    numerator / (V + offset) + constant with V in km/h, relative to the force at constant friction.
    """

    maximum_pressure: float
    """Largest pressure of the cylinders [Pa]."""
    force_per_pascal: float
    """Shoe force at the rim of an axle over the pressure [N/Pa]."""
    fill_time: float
    """Time constant of filling [s]."""
    release_time: float
    """Time constant of releasing [s]."""
    dead_time: float = 0.05
    """Time between a command and the valve's response [s]."""
    friction: tuple[float, float, float] = (0.0, 1.0, 1.0)
    cylinder_volume: float = 4e-3
    """Volume [m3] of a bogie's cylinders and pipes behind its valves, for the air consumption. Assumed: four tread brake
    units of about 0.7 l at their stroke (7 in piston, 30 mm), and the volume of one more unit in the pipes."""
    cut_out: tuple[int, ...] = ()
    """Bogies of the car, 0 = foremost, whose brake is isolated: their cylinders fill, but no shoe acts. The train's
    computers have no information on it."""
    friction_factor: float = 1.0
    """Shoe friction over that of the design. The train's computers have no information on it."""

    def __post_init__(self) -> None:
        times = ("fill_time", "release_time")
        PlantError.check(
            "air brake",
            self,
            positive=("maximum_pressure", *times, "cylinder_volume", "friction_factor"),
            nonnegative=("force_per_pascal", "dead_time"),
        )
        numerator, offset, constant = triple("air brake", "friction", self.friction)
        if not offset > 0.0 or numerator < 0.0 or constant < 0.0:
            raise PlantError(
                f"air brake: friction = {self.friction} needs offset > 0, numerator and constant >= 0"
            )
        if not all(isinstance(bogie, int) and bogie >= 0 for bogie in self.cut_out):
            raise PlantError(
                f"air brake: cut_out = {self.cut_out} must be numbers of bogies, 0 = foremost"
            )


@displayed
@dataclass(frozen=True)
class Car:
    """One car: masses [kg], wheelsets, motors and brakes.

    `axle_positions` [m] are measured from the car's front end; `bogie_of_axle` numbers its bogies from 0. `driven` marks
    axles with a motor. `load` is the pay load; JP5484215 calls empty mass and load per axle W0, dW.
    """

    name: str
    length: float
    """[m]"""
    empty_mass: float
    """[kg]"""
    load: float
    """Pay load [kg]."""
    axle_positions: tuple[float, ...]
    """Positions from the car's front end [m]."""
    bogie_of_axle: tuple[int, ...]
    wheel_radius: float
    """[m]"""
    wheel_inertia: tuple[float, ...]
    """Inertia of each wheelset with everything geared to it [kg m2], at the wheel."""
    driven: tuple[bool, ...]
    motors: Motors | None = None
    air_brake: AirBrake | None = None
    centre_of_mass_height: float = 1.6
    """Height above the rail [m]."""
    pivot_height: float = 0.5
    """Height above the rail at which bogies pull the body [m]."""
    speed_sensors: bool = True
    """Whether its axles have speed sensors for the train's computers; those of a freight wagon have none."""
    axle_load_share: tuple[float, ...] | None = None
    """Share of the car's weight on each axle; equal if None. If the sum is below 1, axles that are not modelled carry the
    rest of the weight (a single axle with its part of a train)."""
    sanders: tuple[Sander, ...] = ()
    """Sanders from the front, at most one per axle."""

    def __post_init__(self) -> None:
        owner = f"car {self.name!r}"
        PlantError.check(
            owner,
            self,
            positive=("length", "empty_mass", "wheel_radius", "wheel_inertia[]"),
            nonnegative=("load", "centre_of_mass_height", "pivot_height"),
            finite=("axle_positions[]",),
        )
        for fault in self._faults():
            raise PlantError(f"{owner}: {fault}")

    def _faults(self) -> Iterator[str]:
        """What does not fit together; each may only be looked for where there is none before it."""
        n, positions, bogies = len(self.axle_positions), self.axle_positions, self.bogie_of_axle
        if n == 0:
            yield "has no axles; give axle_positions"
        for name in ("bogie_of_axle", "wheel_inertia", "driven"):
            if len(getattr(self, name)) != n:
                yield f"{name} has {len(getattr(self, name))} entries for {n} axles"
        if any(b <= a for a, b in itertools.pairwise(positions)):
            yield f"axle_positions = {positions} must grow from the front"
        if positions[0] < 0.0 or positions[-1] > self.length:
            yield f"axle_positions = {positions} leave the car's {self.length} m"
        if bogies[0] != 0 or any(b - a not in (0, 1) for a, b in itertools.pairwise(bogies)):
            yield f"bogie_of_axle = {bogies} must count 0, 1, ... from the front"
        if any(self.driven) and self.motors is None:
            yield "has driven axles but no motors"
        if any(self.driven) and not self.speed_sensors:
            yield "has driven axles but no speed_sensors; motors need them"
        turning = self.motors.rotor_inertia * self.motors.gear_ratio**2 if self.motors else 0.0
        own = [j for j, drives in zip(self.wheel_inertia, self.driven, strict=True) if drives]
        if turning >= min(own, default=math.inf):
            yield (
                f"rotor_inertia = {self.motors and self.motors.rotor_inertia!r} of its motors is {turning:g} kg m2 at the "
                f"wheel; it must be less than wheel_inertia = {min(own)!r}, of which it is a part"
            )
        cut_out = () if self.air_brake is None else self.air_brake.cut_out
        if any(bogie > bogies[-1] for bogie in cut_out):
            yield f"cut_out = {cut_out}, but its bogies are 0 to {bogies[-1]}"
        sanded = [one.axle for one in self.sanders]
        if sanded != sorted(set(sanded)) or any(axle >= n for axle in sanded):
            yield f"sanders at axles {sanded}, but they must grow from the front within 0 to {n - 1}"
        share = self.axle_load_share
        if share is not None and not (
            len(share) == n and all(x > 0.0 for x in share) and sum(share) <= 1.0 + 1e-9
        ):
            yield f"axle_load_share = {share} must be {n} values > 0 with a sum of 1 at most"

    @property
    def mass(self) -> float:
        """Mass with load [kg]."""
        return self.empty_mass + self.load

    @property
    def static_axle_loads(self) -> NDArray[np.float64]:
        """Load of each axle [N], (axles,)."""
        n = len(self.axle_positions)
        return np.asarray(self.mass * GRAVITY * np.array(self.axle_load_share or (1.0 / n,) * n))

    def unloading_factors(self) -> NDArray[np.float64]:
        """Load [N] lost by each axle per newton of the car's rail force, (axles,), summing to zero.

        Quasi-static pitch: the force acts at the rail and the inertia at the centre of mass, so the car's weight moves from
        the front bogie to the rear one. Within a bogie its share of the force acts at pivot height, and does the same
        between its axles. A bogie of one axle cannot carry such a moment and transmits its force at the rail. A car with one
        bogie carries the whole moment there. The moment of coupler forces is neglected.
        """
        positions, bogies = np.array(self.axle_positions), np.array(self.bogie_of_axle)
        factors = np.zeros(positions.size)
        acting = np.array(self.driven) if any(self.driven) else np.ones(positions.size, dtype=bool)
        members = [np.flatnonzero(bogies == b) for b in np.unique(bogies)]
        centres = np.array([positions[inside].mean() for inside in members])
        body_moment = self.centre_of_mass_height
        for inside in members:
            arm = centres[bogies[inside[0]]] - positions[inside]  # > 0 in front
            if inside.size == 1:
                continue
            height = self.pivot_height if len(members) > 1 else self.centre_of_mass_height
            moment = height * acting[inside].sum() / acting.sum()
            factors[inside] += moment * arm / np.sum(arm**2)
            body_moment -= moment
        if len(members) > 1:
            arm = centres.mean() - centres
            for inside, unloading in zip(members, body_moment * arm / np.sum(arm**2), strict=True):
                factors[inside] += unloading / inside.size
        return factors

    def reversed(self) -> "Car":
        """The same car running in the other direction."""
        last = max(self.bogie_of_axle)
        share = self.axle_load_share
        brake = self.air_brake
        if brake is not None:
            brake = replace(brake, cut_out=tuple(sorted(last - b for b in brake.cut_out)))
        return replace(
            self,
            air_brake=brake,
            axle_positions=tuple(self.length - p for p in reversed(self.axle_positions)),
            bogie_of_axle=tuple(last - b for b in reversed(self.bogie_of_axle)),
            wheel_inertia=self.wheel_inertia[::-1],
            driven=self.driven[::-1],
            axle_load_share=None if share is None else share[::-1],
            sanders=tuple(
                replace(one, axle=len(self.driven) - 1 - one.axle) for one in reversed(self.sanders)
            ),
        )

    @property
    def brake_groups(self) -> int:
        """Number of pairs of brake valves: one per bogie."""
        return 0 if self.air_brake is None else max(self.bogie_of_axle) + 1

    def units(self) -> list[list[int]]:
        """Axles of each traction unit of this car (indices from the car's front)."""
        if self.motors is None:
            return []
        axles = [i for i, has_motor in enumerate(self.driven) if has_motor]
        count = len(self.driven)
        part = {"1C4M": [0] * count, "1C2M": self.bogie_of_axle, "1C1M": range(count)}
        groups = itertools.groupby(axles, key=part[self.motors.group].__getitem__)
        return [list(members) for _, members in groups]


# A train: its cars and the couplers between them. SI units, validated.


MOST_AXLES = 2000
"""Largest number of axles; the longest trains have some 1500."""


@displayed
@dataclass(frozen=True)
class Coupler:
    """Linear draft gear between two cars, with slack.

    Source: assumed.
    """

    stiffness: float = quantity(2.0e7, "N/m")
    """Stiffness [N/m]."""
    stiffening: float = quantity(0.0, "N/m3")
    """Force over the cube of the stretch [N/m3]."""
    damping: float = quantity(2.0e5, "N s/m")
    """Damping [N s/m]."""
    slack: float = quantity(0.0, "mm")
    """Slack [m]."""

    def __post_init__(self) -> None:
        PlantError.check(
            "coupler", self, positive=("stiffness",), nonnegative=("stiffening", "damping", "slack")
        )


@displayed
@dataclass(frozen=True)
class DraftGear:
    """Friction draft gears between two cars, one at either car's end, with a slack between them.

    Each follows T0 + c1 (s - T0 / ck) when loaded, t0 + c2 s when unloaded, and the slope ck from one line to the other.
    Defaults: a published set (c1 2.57e7, c2 2.85e6, ck 2.5e8, T0 240 kN, t0 50 kN, lambda 0.09 m, delta 0.05 m), in which
    lambda is read as a gear's stroke, delta as the slack between two cars.

    Source: a published set of draft gears.
    """

    loading: float = quantity(2.57e7, "N/m")
    """Slope c1 when loaded [N/m]."""
    unloading: float = quantity(2.85e6, "N/m")
    """Slope c2 when unloaded, less than `loading` [N/m]."""
    structure: float = quantity(2.5e8, "N/m")
    """Slope ck from one line to the other; beyond the stroke only the structure yields [N/m]."""
    preload: float = quantity(240e3, "kN")
    """Force T0 at which a gear begins to move [N]."""
    restoring: float = quantity(50e3, "kN")
    """Force t0 of an unloaded gear [N]."""
    stroke: float = quantity(0.09, "mm")
    """Stroke of a gear [m]."""
    slack: float = quantity(0.05, "mm")
    """Slack between the two gears [m]."""
    viscosity: float = quantity(2.0e5, "N s/m")
    """Viscosity of a gear's sliding wedges, which makes friction a function of the rate [N s/m]. Source: assumed."""
    damping: float = quantity(1.0e7, "N s/m")
    """Damping of a gear's structure [N s/m]. Source: assumed: about critical for two wagons of 85 t; without it a train
    oscillates for minutes on gears that stick."""
    in_series: int = 2
    """Number of gears in a connection. Source: assumed."""

    def __post_init__(self) -> None:
        positive = (
            "loading",
            "unloading",
            "structure",
            "preload",
            "stroke",
            "viscosity",
            "in_series",
        )
        PlantError.check("draft gear", self, positive, ("restoring", "slack", "damping"))
        for low, high in (
            ("unloading", "loading"), ("loading", "structure"), ("restoring", "preload"),
        ):  # fmt: skip
            if not getattr(self, low) < getattr(self, high):
                raise PlantError(
                    f"draft gear: {low} = {getattr(self, low)!r} must be below {high} = {getattr(self, high)!r}"
                )
        if not self.stroke > self.preload / self.structure:
            raise PlantError(
                f"draft gear: stroke = {self.stroke!r} must exceed the structure's stretch under the preload, "
                f"{self.preload / self.structure:g} m"
            )

    def wedges(self) -> tuple[float, ...]:
        """Parameters of `alloc.old.plant.laws.friction_draft_gear` for the gears in series; 1 / viscosity and damping last.

        The lines are over the wedges' travel p = s - T / ck instead of the stretch s.
        """
        share = 1.0 - self.unloading / self.structure
        loading = self.loading / (1.0 - self.loading / self.structure)
        longest = self.stroke - self.preload / self.structure
        longest *= 1.0 - self.loading / self.structure
        each = (self.structure, loading, self.unloading / share)
        return (
            *(value / self.in_series for value in each), self.preload, self.restoring / share,
            longest * self.in_series, self.in_series / self.viscosity,
            self.damping / self.in_series,
        )  # fmt: skip


@displayed
@dataclass(frozen=True, repr=False)
class Train:
    """A train in its running order, foremost car first.

    Running resistance [N] of the whole train: A + B v + C v^2 (A in N, B in N s/m, C in N s2/m2), shared among
    the cars by mass (A, B) and length (C). `couplers` None: rigid train.
    """

    name: str
    cars: tuple[Car, ...]
    resistance: tuple[float, float, float] = (0.0, 0.0, 0.0)
    couplers: tuple[Coupler | DraftGear, ...] | None = None
    load_transfer: bool = False
    planned_acceleration: float = 0.0
    """Acceleration [m/s2] that the plan asks for on level track."""
    source: str = ""
    sources: dict[str, str] = field(default_factory=dict, hash=False, compare=False)
    """Where each value comes from."""

    def __post_init__(self) -> None:
        if not self.cars:
            raise PlantError(f"train {self.name!r}: has no cars")
        if self.axle_count > MOST_AXLES:
            raise PlantError(
                f"train {self.name!r}: has {self.axle_count} axles; give {MOST_AXLES} at most"
            )
        if min(triple(f"train {self.name!r}", "resistance", self.resistance)) < 0.0:
            raise PlantError(f"train {self.name!r}: resistance = {self.resistance} must be >= 0")
        PlantError.check(f"train {self.name!r}", self, finite=("planned_acceleration",))
        if self.couplers is not None and len(self.couplers) != len(self.cars) - 1:
            raise PlantError(
                f"train {self.name!r}: {len(self.couplers)} couplers for {len(self.cars)} cars; "
                f"give {len(self.cars) - 1}, or none for a rigid train"
            )

    def __repr__(self) -> str:
        units = sum(len(car.units()) for car in self.cars)
        return (
            f"<Train {self.name!r}: {len(self.cars)} cars, {self.axle_count} axles, {units} units, "
            f"{self.mass / 1e3:.1f} t, {'rigid' if self.couplers is None else 'coupled'}>"
        )

    @property
    def mass(self) -> float:
        """Mass with load [kg]."""
        return sum(car.mass for car in self.cars)

    @property
    def brake_groups(self) -> list[AirBrake]:
        """Brake of each pair of valves, foremost first."""
        return [
            car.air_brake
            for car in self.cars
            if car.air_brake is not None
            for _ in range(car.brake_groups)
        ]

    @property
    def sanders(self) -> list[Sander]:
        """Every sander, foremost first."""
        return [one for car in self.cars for one in car.sanders]

    @property
    def axle_count(self) -> int:
        """Number of axles."""
        return sum(len(car.axle_positions) for car in self.cars)

    @property
    def rotating_mass(self) -> float:
        """Mass [kg] that the inertia of the wheelsets adds to a train that rolls without slip."""
        return sum(sum(car.wheel_inertia) / car.wheel_radius**2 for car in self.cars)

    def reversed(self) -> "Train":
        """The same train running in the other direction: rearmost car first, each car reversed."""
        couplers = None if self.couplers is None else self.couplers[::-1]
        return replace(
            self, cars=tuple(car.reversed() for car in reversed(self.cars)), couplers=couplers
        )

    def loaded(self, loads: tuple[float, ...]) -> "Train":
        """The same train with a pay load [kg] per car."""
        if len(loads) != len(self.cars):
            raise PlantError(
                f"train {self.name!r}: {len(loads)} loads for {len(self.cars)} cars; give one per car"
            )
        return replace(
            self,
            cars=tuple(replace(car, load=load) for car, load in zip(self.cars, loads, strict=True)),
        )

    def coupled(self, coupler: Coupler | DraftGear) -> "Train":
        """The same train with this draft gear between all cars."""
        return replace(self, couplers=(coupler,) * (len(self.cars) - 1))


__all__ = [
    "EFFORT_SPEED_STEP",
    "EFFORT_TABLE_LENGTH",
    "AirBrake",
    "Car",
    "Coupler",
    "DraftGear",
    "InverterGroup",
    "Motors",
    "Sander",
    "TorqueLimit",
    "Train",
]
