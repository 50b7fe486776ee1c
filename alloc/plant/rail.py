"""The rail as it truly is, and the line: adhesion by speed, place, time and axle, gradients, tunnels.

In: validated records. Out: rows of the tables that the plant reads. No computer on board reads them.

The adhesion coefficient that the rail offers is (speed law x patches + increment + scatter) x (1 + gain x cleaning).
JP5484215 has the speed law (12), increments (15) and scatter; JP4209318 par. 0051 what wheels clean for those behind.
"""

import math
from collections.abc import Iterator
from dataclasses import MISSING, dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from alloc.plant.curves import PiecewiseCurve
from alloc.schema.errors import PlantError
from alloc.schema.parameters import NOT_IN_FILES, PlantParameters, quantity
from alloc.schema.tables import Column, Rows, Table, columns_of, put_fields

SPEED_LAWS: dict[str, tuple[float, float, float]] = {
    "none": (0.0, 1.0, 1.0),
    "shinkansen": (13.6, 85.0, 0.0),  # planned coefficient, JP5484215 (12)
    "curtius-kniffler": (7.5, 44.0, 0.161),  # Curtius and Kniffler, 1950
}
"""Named laws a / (V + b) + c with V in km/h (`alloc.laws.speed_law`); `none` is 1 at every speed."""

KNOTS = 1024
"""Knots of the scatter; it repeats after this many correlation lengths."""
KNOT_SCATTER = (181.0 / 231.0) ** -0.5
"""Scatter at a knot over scatter along the rail: between two independent knots the smooth step w mixes them, and the
variance falls to w^2 + (1 - w)^2 of theirs, 181/231 on average."""
MOST_LEVEL = 2.0
"""A greater coefficient is a percentage by mistake."""
GROWTH_SLOPE, GROWTH_OFFSET = 0.0083, -0.0066
"""Of the growth of adhesion along a train, JP5484215 (15)."""


def logarithmic_increments(
    axle_count: int, slope: float = GROWTH_SLOPE, offset: float = GROWTH_OFFSET
) -> NDArray[np.float64]:
    """Growth of the adhesion coefficient along the train, JP5484215 (15): slope ln j + offset, (axles,).

    j = 1 is the foremost axle; the mean over the first four axles is zero.
    """
    return slope * np.log(np.arange(1, axle_count + 1)) + offset


@dataclass(frozen=True)
class Patch(PlantParameters):
    """A stretch of rail that multiplies the coefficient by a factor for a time; smooth edges.

    Source: assumed.
    """

    factor: float = quantity(MISSING, "1", above=0.0, most=1000.0)
    """Factor on the coefficient."""
    start: float = quantity(-1e6, "m", least=-math.inf)
    """Position where the stretch begins. Left out: before any train."""
    end: float = quantity(1e6, "m", least=-math.inf)
    """Position where it ends. Left out: beyond any train."""
    edge: float = quantity(5.0, "m", above=0.0)
    """Length of the smooth transition at either end."""
    begin: float = quantity(-1e6, "s", least=-math.inf)
    """Instant at which it begins. Left out: before the run."""
    until: float = quantity(1e6, "s", least=-math.inf)
    """Instant at which it ends. Left out: after the run."""
    fade: float = quantity(0.2, "s", above=0.0)
    """Time over which it comes and goes."""

    def _find_faults(self) -> Iterator[str]:
        for low, high in (("start", "end"), ("begin", "until")):
            if not getattr(self, low) < getattr(self, high):
                yield f"`{low}` must lie before `{high}`"


PATCH = Table("patch", **columns_of(Patch))


@dataclass(frozen=True)
class Rail(PlantParameters):
    """Adhesion field.

    Source: assumed.
    """

    level: float = quantity(MISSING, "1", above=0.0)
    """Scale of the speed law; the coefficient itself where the law is `none`."""
    speed_law: str | tuple[float, float, float] = "none"
    """Coefficient over the speed: a name of `SPEED_LAWS`, or a, b and c of a / (V + b) + c with V in km/h. Source:
    shinkansen: JP5484215 (12); curtius-kniffler: Curtius and Kniffler, 1950."""
    rear_speed_law: tuple[float, float, float] | None = None
    """Law (a, b, c) of an axle far back, with the offset b of `speed_law`, scaled in the same way: adhesion differs further
    back and may depend less on speed. Left out: one law for all axles. Source: JP4209318, Fig. 2, par. 0051, findings 1
    and 2."""
    rear_axles: float = quantity(4.0, "1", above=0.0)
    """Axle i (0 = foremost) follows the front's law blended towards that of the rear by 1 - exp(-i / `rear_axles`)."""
    patches: tuple[Patch, ...] = ()
    """Stretches of rail, or spans of time, with another adhesion."""
    increments: tuple[float, ...] | None = quantity(None, "1", least=-math.inf)
    """Growth of the coefficient along the train, one value per axle from the front; None: zero. Source: JP5484215 (15)."""
    scatter: float = quantity(0.0, "1", most=1.0)
    """Standard deviation of the coefficient along the rail. Source: JP5484215, par. on (12) to (15): 0.012."""
    scatter_length: float = quantity(20.0, "m", above=0.0)
    """Correlation length of the scatter. Source: assumed: a rail's length or a car's."""
    seed: int = quantity(0, "1")
    """Seed of the scatter."""
    conditioning: float = quantity(0.0, "1", most=10.0)
    """Relative gain of adhesion behind wheels that slip much. Source: JP4209318, par. 0051, without a number."""
    conditioning_slip: float = quantity(0.05, "1", above=0.0)
    """Slip ratio that cleans the rail to 63 %."""
    cleaning_spacing: float = quantity(0.1, "m", above=0.0)
    """Resolution of the cleaned rail."""
    recovered_coefficient: float = quantity(0.0, "1")
    """Coefficient to which the energy that slip dissipates raises a lower one, under the wheel itself; 0: it does not.
    Source: idea: Allotta, Meli, Ridolfi, Rindi, Tribology International 69 (2014), after tests at Velim."""
    recovery_energy: float = quantity(4200.0, "J/m", above=0.0)
    """Energy on a metre of rail that recovers 76 % of the difference. Source: assumed."""
    recovery_time: float = quantity(0.1, "s", above=0.0)
    """Time constant of the recovery. Source: assumed."""
    recovery_left: float = quantity(0.25, "1", most=1.0)
    """Share of an axle's recovery that stays on the rail for those behind. Source: assumed."""
    curve: Any = field(default_factory=PiecewiseCurve)
    """Adhesion curve: tangential coefficient over the slip, one of `alloc.plant.curves`."""

    def _find_faults(self) -> Iterator[str]:
        if self.speed_law == "none" and self.level > MOST_LEVEL:
            yield f"`level` must be a coefficient, at most {MOST_LEVEL:g}: 14 % is 0.14"
        if isinstance(self.speed_law, str) and self.speed_law not in SPEED_LAWS:
            yield f"`speed_law` is unknown; choose from {', '.join(SPEED_LAWS)}"
        for name in ("speed_law", "rear_speed_law"):
            law = getattr(self, name)
            numbers = law is not None and not isinstance(law, str)
            if numbers and not (len(law) == 3 and all(map(math.isfinite, law)) and law[1] > 0.0):
                yield f"`{name}` must be three finite numbers, the offset > 0"
        (_, offset, _), (_, rear_offset, _) = self._laws()
        if rear_offset != offset:
            yield f"`rear_speed_law` must have the offset {offset} of speed_law"
        if self.conditioning and self.recovered_coefficient:
            yield "conditioning and recovered_coefficient are two laws of what wheels clean; give one of them"

    def _laws(self) -> list[tuple[float, float, float]]:
        """Numerator, offset and constant of the speed law in front and of the one far back, scaled by `level`."""
        front = SPEED_LAWS[self.speed_law] if isinstance(self.speed_law, str) else self.speed_law
        both = front, self.rear_speed_law or front
        return [(self.level * a, b, self.level * c) for a, b, c in both]

    def greatest_peak(self) -> float:
        """Upper estimate of the coefficient anywhere: standstill, best axle and patches, four deviations of the scatter."""
        base = max(max(a / b, 0.0) + c for a, b, c in self._laws()) * self._greatest_factor()
        growth = max(self.increments or (0.0,))
        dirty = (base + max(growth, 0.0) + 4.0 * self.scatter) * (1.0 + self.conditioning)
        return max(dirty, self.recovered_coefficient)

    def _greatest_factor(self) -> float:
        """Largest product of the factors of patches that overlap, estimated from above: in space, and in time."""
        raised = PATCH.of([patch for patch in self.patches if patch.factor > 1.0])
        products = [1.0 if raised.size == 0 else math.inf]
        for start, end, edge in (("start", "end", "edge"), ("begin", "until", "fade")):
            first, last = raised[start] - 0.5 * raised[edge], raised[end] + 0.5 * raised[edge]
            meets = (first <= first[:, None]) & (first[:, None] <= last)
            overlap = np.where(meets, raised.factor, 1.0).prod(axis=1)
            products.append(float(overlap.max(initial=1.0)))  # most where one of them begins
        return min(products)

    def scatter_ring(self) -> NDArray[np.float64]:
        """Scatter at its knots, which form a ring, (KNOTS,); its standard deviation along the rail is `scatter`."""
        if self.scatter == 0.0:
            return np.zeros(KNOTS)
        draws = np.random.default_rng(self.seed).standard_normal(KNOTS)
        return np.asarray(self.scatter * KNOT_SCATTER * draws)

    def put_under(self, axles: Rows, plant: Rows) -> None:
        """Write what the rail is into rows of `AXLE` and the row of `PLANT`; raises `PlantError` where they do not fit."""
        if self.increments is not None and len(self.increments) != axles.size:
            reason = f"{len(self.increments)} values for {axles.size} axles; give one per axle"
            raise PlantError(f"rail increments: {reason}")
        front, rear = np.array(self._laws())
        share = -np.expm1(-np.arange(axles.size) / self.rear_axles)
        numerator, _, constant = front[:, None] + share * (rear - front)[:, None]
        axles.law_numerator, axles.law_constant = numerator, constant
        axles.increment = 0.0 if self.increments is None else self.increments
        axles.contact = self.curve.contact(0.5 * axles.static_load, axles.radius)
        put_fields(plant, self)
        plant.law_offset, plant.curve_number = front[1], self.curve.number
        plant.scatter_length *= self.scatter > 0.0

    def cells(self, length: float) -> NDArray[np.float64]:
        """Ring of cells under a train of `length` [m], none of them cleaned; a few where wheels clean nothing."""
        cleans = self.conditioning > 0.0 or self.recovered_coefficient > 0.0
        return np.zeros(int(length / self.cleaning_spacing) + 256 if cleans else 4)


LINE = Table(
    "line",  # a point every `PLANT.line_spacing` from `PLANT.line_origin` on
    grade=Column(0.0, "1", "rise per run", source="JP H07-322414"),
    air=Column(1.0, "1", "air resistance over that in the open", source="JP H07-322414"),
)


@dataclass(frozen=True)
class Line(PlantParameters):
    """Gradient and tunnels by position; gradient as rise per run (0.020 = 20 per mille).

    `stations` (k,) are the starts of sections with `grades` (k,); before the first and beyond the last the nearest applies.
    Changes are spread over one `spacing`.

    Source: this project.
    """

    stations: tuple[float, ...] = quantity((0.0,), "m", least=-math.inf)
    """Increasing starts of the sections."""
    grades: tuple[float, ...] = quantity((0.0,), "per mille", least=-math.inf)
    """Gradient of each section."""
    tunnels: tuple[tuple[float, float], ...] = ()
    """Start and end of each tunnel [m]."""
    tunnel_factor: float = quantity(1.0, "1", above=0.0)
    """Air resistance in a tunnel over that outside. Source: JP H07-322414 has such a factor; the value is the train's."""
    spacing: float = quantity(5.0, "m", above=0.0)
    """Resolution of the line."""

    def _find_faults(self) -> Iterator[str]:
        if len(self.stations) != len(self.grades) or not self.stations:
            yield f"{len(self.stations)} stations and {len(self.grades)} grades; give as many of each"
        if any(b < a for a, b in pairwise(self.stations)):
            yield "`stations` must not fall"
        for start, end in self.tunnels:
            if not start < end:
                yield f"tunnel from {start} to {end} m must end beyond its start"

    def rows(self, first: float, last: float) -> tuple[float, Rows]:
        """Place of the first point [m], and rows of `LINE` every `spacing` metres up to `last` at least."""
        origin = math.floor(first / self.spacing) * self.spacing
        x = origin + self.spacing * np.arange(max(2, math.ceil((last - origin) / self.spacing) + 2))
        section = np.clip(np.searchsorted(self.stations, x, side="right") - 1, 0, None)
        rows = LINE.rows(x.size, grade=np.asarray(self.grades, dtype=float)[section])
        for start, end in self.tunnels:
            rows.air[(x >= start) & (x < end)] = self.tunnel_factor
        if all((rows[name] == rows[name][0]).all() for name in LINE.columns):
            return origin, rows[:1].copy()  # the same everywhere
        return origin, rows


@dataclass(frozen=True)
class Receptivity(PlantParameters):
    """Share of the electric brake that the line takes up: mean + amplitude sin(2 pi t / period + phase), in [0, 1].

    Source: assumed.
    """

    mean: float = quantity(1.0, "1", most=1.0)
    """Mean share that the line takes up."""
    amplitude: float = quantity(0.0, "1", most=1.0)
    """Amplitude of its change; 0: it is constant."""
    period: float = quantity(3.0, "s", above=0.0)
    """Period of its change."""
    phase: float = field(default=0.0, metadata=NOT_IN_FILES)
    """Phase of its change [rad]."""
