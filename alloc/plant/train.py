"""A train: its cars and the couplers between them. SI units, validated."""

from dataclasses import dataclass, field, replace

from alloc.display import displayed
from alloc.errors import PlantError
from alloc.plant.car import (
    EFFORT_SPEED_STEP,
    EFFORT_TABLE_LENGTH,
    AirBrake,
    Car,
    InverterGroup,
    Motors,
    TorqueLimit,
    triple,
)
from alloc.plant.sander import Sander

MOST_AXLES = 2000
"""Largest number of axles; the longest trains have some 1500."""


@displayed
@dataclass(frozen=True)
class Coupler:
    """Linear draft gear between two cars, with slack.

    Source: assumed.
    """

    stiffness: float = 2.0e7
    """Stiffness [N/m]."""
    stiffening: float = 0.0
    """Force over the cube of the stretch [N/m3]."""
    damping: float = 2.0e5
    """Damping [N s/m]."""
    slack: float = 0.0
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

    loading: float = 2.57e7
    """Slope c1 when loaded [N/m]."""
    unloading: float = 2.85e6
    """Slope c2 when unloaded, less than `loading` [N/m]."""
    structure: float = 2.5e8
    """Slope ck from one line to the other; beyond the stroke only the structure yields [N/m]."""
    preload: float = 240e3
    """Force T0 at which a gear begins to move [N]."""
    restoring: float = 50e3
    """Force t0 of an unloaded gear [N]."""
    stroke: float = 0.09
    """Stroke of a gear [m]."""
    slack: float = 0.05
    """Slack between the two gears [m]."""
    viscosity: float = 2.0e5
    """Viscosity of a gear's sliding wedges, which makes friction a function of the rate [N s/m]. Source: assumed."""
    damping: float = 1.0e7
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
        """Parameters of `alloc.plant.equations.friction_draft_gear` for the gears in series; 1 / viscosity and damping last.

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
