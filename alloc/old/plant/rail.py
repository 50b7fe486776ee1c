"""The rail as it truly is: adhesion by speed, position, time and axle; its memory of wheels and sand; and the line.

In: validated patches, laws, scatter, gradients, tunnels. Out: arrays for the compiled plant, and the field's law itself.
Nobody on board may import this module.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import MISSING, dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.old.compilation import equation, inlined_jit
from alloc.old.display import displayed
from alloc.old.errors import PlantError
from alloc.old.plant.adhesion import AdhesionCurve, PiecewiseCurve
from alloc.old.plant.laws import cleaned_degree, conditioning_deposit, sand_laid, slip_ratio
from alloc.old.plant.operations import exp, floor, maximum, minimum, sine
from alloc.old.records import NOT_IN_FILES, quantity

SPEED_LAWS: dict[str, tuple[float, float, float]] = {
    "none": (0.0, 1.0, 1.0),
    "shinkansen": (13.6, 85.0, 0.0),  # planned coefficient, JP5484215 (12)
    "curtius-kniffler": (7.5, 44.0, 0.161),  # Curtius and Kniffler, 1950
}
"""Named laws a / (V + b) + c with V in km/h; `none` is 1 at every speed."""

CURVE_LAWS: dict[str, tuple[tuple[float, float, float], ...]] = {
    "600/R": ((0.0, 600.0, 0.0),),  # kgf/t, as in England and on Japanese lines
    "800/R": ((0.0, 800.0, 0.0),),  # kgf/t: JR's conventional lines
    "roeckl": (
        (0.0, 500.0, 30.0),
        (300.0, 650.0, 55.0),
    ),  # Roeckl, standard gauge; the step at 300 m is his
}
"""Named laws of curve resistance, a / (R - b) per mille of the weight, R in m: smallest radius of each piece, a, b."""

NOISE_KNOTS = 1024
"""Knots of the scatter's table; the scatter repeats after this many correlation lengths."""

KNOT_SCATTER = (181.0 / 231.0) ** -0.5
"""Scatter at a knot over scatter along the rail.

Between two independent knots the smooth step w mixes them. The variance falls to w^2 + (1 - w)^2 of that at the knots,
181/231 on average.
"""


@displayed
@dataclass(frozen=True)
class Patch:
    """A stretch of rail that multiplies the coefficient by a factor for a time; smooth edges.

    Source: assumed.
    """

    factor: float = quantity(MISSING, "1", most=1000.0)
    """Factor on the coefficient."""
    start: float = quantity(-1e6, "m")
    """Position where the stretch begins [m]. Left out: before any train."""
    end: float = quantity(1e6, "m")
    """Position where it ends [m]. Left out: beyond any train."""
    edge: float = quantity(5.0, "m")
    """Length of the smooth transition at either end [m]."""
    begin: float = quantity(-1e6, "s")
    """Instant at which it begins [s]. Left out: before the run."""
    until: float = quantity(1e6, "s")
    """Instant at which it ends [s]. Left out: after the run."""
    fade: float = quantity(0.2, "s")
    """Time over which it comes and goes [s]."""

    def __post_init__(self) -> None:
        PlantError.check("patch", self, positive=("factor", "edge", "fade"))
        for low, high in (("start", "end"), ("begin", "until")):
            a, b = getattr(self, low), getattr(self, high)
            if not (math.isfinite(a) and math.isfinite(b) and a < b):
                raise PlantError(
                    f"patch: {low} = {a!r} must lie before {high} = {b!r}, both finite"
                )


class Patches(NamedTuple):
    """Patches as arrays, fields as those of `Patch`, (patches,)."""

    factor: NDArray[np.float64]
    start: NDArray[np.float64]
    end: NDArray[np.float64]
    edge: NDArray[np.float64]
    begin: NDArray[np.float64]
    until: NDArray[np.float64]
    fade: NDArray[np.float64]


def patch_arrays(patches: Sequence[Patch]) -> Patches:
    """The patches as arrays."""
    each = ([getattr(one, name) for one in patches] for name in Patches._fields)
    return Patches(*(np.array(values, dtype=float) for values in each))


GROWTH_SLOPE, GROWTH_OFFSET = 0.0083, -0.0066
"""Of the growth of adhesion along a train, JP5484215 (15)."""


def logarithmic_increments(
    axle_count: int, slope: float = GROWTH_SLOPE, offset: float = GROWTH_OFFSET
) -> NDArray[np.float64]:
    """Growth of the adhesion coefficient along the train, JP5484215 (15): slope ln j + offset, (axles,).

    j = 1 is the foremost axle; the mean over the first four axles is zero.
    """
    return slope * np.log(np.arange(1, axle_count + 1)) + offset


MOST_LEVEL = 2.0
"""A greater coefficient is a percentage by mistake."""


@displayed
@dataclass(frozen=True, repr=False)
class Rail:
    """Adhesion field.

    Source: assumed.
    """

    level: float
    """Scale of the speed law; the coefficient itself where the law is `none`."""
    speed_law: str | tuple[float, float, float] = "none"
    """Coefficient over the speed: a name of `SPEED_LAWS`, or a, b and c of a / (V + b) + c with V in km/h. Source:
    shinkansen: JP5484215 (12); curtius-kniffler: Curtius and Kniffler, 1950."""
    rear_speed_law: tuple[float, float, float] | None = None
    """Law (a, b, c) of an axle far back, with the offset b of `speed_law`, scaled in the same way: adhesion differs further
    back and may depend less on speed. Left out: one law for all axles. Source: JP4209318, Fig. 2, par. 0051, findings 1
    and 2."""
    rear_axles: float = 4.0
    """Axle i (0 = foremost) follows the front's law blended towards that of the rear by 1 - exp(-i / `rear_axles`)."""
    patches: tuple[Patch, ...] = ()
    """Stretches of rail, or spans of time, with another adhesion."""
    increments: tuple[float, ...] | None = None
    """Growth of the coefficient along the train, one value per axle from the front; None: zero. Source: JP5484215 (15)."""
    scatter: float = 0.0
    """Standard deviation of the coefficient along the rail. Source: JP5484215, par. on (12) to (15): 0.012."""
    scatter_length: float = 20.0
    """Correlation length of the scatter [m]. Source: assumed: a rail's length or a car's."""
    seed: int = 0
    """Seed of the scatter."""
    conditioning: float = 0.0
    """Relative gain of adhesion behind wheels that slip much. Source: JP4209318, par. 0051, without a number."""
    conditioning_slip: float = 0.05
    """Slip ratio that cleans the rail to 63 %."""
    cleaning_spacing: float = 0.1
    """Resolution of the cleaned or sanded rail [m]."""
    recovered_coefficient: float = 0.0
    """Coefficient to which the energy that slip dissipates raises a lower one, under the wheel itself; 0: it does not.
    Source: idea: Allotta, Meli, Ridolfi, Rindi, Tribology International 69 (2014), after tests at Velim."""
    recovery_energy: float = 4200.0
    """Energy on a metre of rail that recovers 76 % of the difference [J/m]. Source: assumed."""
    recovery_time: float = 0.1
    """Time constant of the recovery [s]. Source: assumed."""
    recovery_left: float = 0.25
    """Share of an axle's recovery that stays on the rail for those behind, 0 to 1. Source: assumed."""
    sanded_coefficient: float = 0.40
    """Coefficient to which much sand raises a lower one. Source: calibrated in `studies.stops.sander_trial`."""
    sand_saturation: float = 35.3e-3
    """Amount of sand per rail that gives 63 % of this rise [kg/m]. Source: calibrated in `studies.stops.sander_trial`."""
    sand_decay: float = 0.0558
    """Share of the sand that an axle takes off the rail, 0 to 1. Source: calibrated in `studies.stops.sander_trial`."""
    presliding: float = 1.5e-4
    """Deflection at which a contact at rest yields, see `alloc.old.plant.laws` [m]. Source: assumed: a train that is
    held moves by less than a millimetre."""
    curve: AdhesionCurve = field(default_factory=PiecewiseCurve)
    """Adhesion curve: tangential coefficient over the slip."""

    def __post_init__(self) -> None:
        lengths = ("scatter_length", "cleaning_spacing", "rear_axles", "presliding")
        sand = ("sanded_coefficient", "sand_saturation")
        recovery = ("recovery_energy", "recovery_time")
        positive = ("level", *lengths, "conditioning_slip", *sand, *recovery)
        nonnegative = ("scatter", "conditioning", "recovered_coefficient")
        PlantError.check("rail", self, positive, nonnegative)
        if self.speed_law == "none" and self.level > MOST_LEVEL:
            raise PlantError(
                f"rail: level = {self.level!r} must be a coefficient, at most {MOST_LEVEL:g}: 14 % is 0.14"
            )
        if self.increments is not None:
            PlantError.check("rail", self, finite=("increments[]",))
        for fault in self._faults():
            raise PlantError(f"rail: {fault}")

    def _faults(self) -> Iterator[str]:
        if isinstance(self.speed_law, str) and self.speed_law not in SPEED_LAWS:
            yield f"speed_law = {self.speed_law!r} is unknown; choose from {', '.join(SPEED_LAWS)}"
        for name in ("speed_law", "rear_speed_law"):
            law = getattr(self, name)
            own = law is not None and not isinstance(law, str)
            if own and not (len(law) == 3 and all(map(math.isfinite, law)) and law[1] > 0.0):
                yield f"{name} = {law} must be three finite numbers, the offset > 0"
        (_, offset, _), (_, rear_offset, _) = self._laws()
        if rear_offset != offset:
            yield f"rear_speed_law = {self.rear_speed_law} must have the offset {offset} of speed_law"
        for name in ("sand_decay", "recovery_left"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                yield f"{name} = {getattr(self, name)!r} must lie in [0, 1]"
        if self.conditioning and self.recovered_coefficient:
            yield "conditioning and recovered_coefficient are two laws of what wheels clean; give one of them"
        if not isinstance(self.seed, int) or self.seed < 0:
            yield f"seed = {self.seed!r} must be a whole number, 0 or greater"

    def __repr__(self) -> str:
        law = self.speed_law if isinstance(self.speed_law, str) else "own"
        return (
            f"<Rail: level {self.level:g}, speed law {law}, {len(self.patches)} patches, "
            f"scatter {self.scatter:g}, {type(self.curve).__name__}>"
        )

    def _laws(self) -> list[tuple[float, float, float]]:
        """Numerator, offset and constant of the speed law in front and of the one far back, scaled by `level`."""
        front = SPEED_LAWS[self.speed_law] if isinstance(self.speed_law, str) else self.speed_law
        return [
            (self.level * a, b, self.level * c) for a, b, c in (front, self.rear_speed_law or front)
        ]

    def axle_laws(self, axle_count: int) -> NDArray[np.float64]:
        """Numerator, offset and constant of every axle's speed law from the front, scaled by `level`, (3, axles)."""
        front, rear = np.array(self._laws())[:, :, None]
        return front - (rear - front) * np.expm1(-np.arange(axle_count) / self.rear_axles)

    def greatest_peak(self) -> float:
        """Upper estimate of the peak coefficient anywhere: standstill, best axle and patches, four deviations."""
        # an axle's law lies between the two
        base = max(max(a / b, 0.0) + c for a, b, c in self._laws()) * self._greatest_factor()
        growth = max(self.increments or (0.0,))
        dirty = (base + max(growth, 0.0) + 4.0 * self.scatter) * (1.0 + self.conditioning)
        return max(dirty, self.recovered_coefficient)

    def _greatest_factor(self) -> float:
        """Largest product of the factors of patches that overlap, estimated from above: in space, and in time."""
        raised = [patch for patch in self.patches if patch.factor > 1.0]
        if not raised:
            return 1.0
        factor = np.array([patch.factor for patch in raised])
        products = []
        for start, end, edge in (("start", "end", "edge"), ("begin", "until", "fade")):
            half = 0.5 * np.array([getattr(patch, edge) for patch in raised])
            first = np.array([getattr(patch, start) for patch in raised]) - half
            last = np.array([getattr(patch, end) for patch in raised]) + half
            # most overlap where one of them begins
            meets = (first <= first[:, None]) & (first[:, None] <= last)
            products.append(float(np.where(meets, factor, 1.0).prod(axis=1).max()))
        return min(products)

    def noise_table(self) -> NDArray[np.float64]:
        """Scatter at its knots, (NOISE_KNOTS,); its standard deviation along the rail is `scatter`."""
        if self.scatter == 0.0:
            return np.zeros(NOISE_KNOTS)
        draws = np.random.default_rng(self.seed).standard_normal(NOISE_KNOTS)
        return np.asarray(self.scatter * KNOT_SCATTER * draws)


@displayed
@dataclass(frozen=True)
class Line:
    """Gradient, tunnels and curves by position; gradient as rise per run (0.020 = 20 per mille).

    `stations` (k,) are the starts of sections with `grades` (k,); before the first and beyond the last the nearest applies.
    Changes are spread over one `spacing`. Where curves overlap, the sharpest counts.

    Source: this project.
    """

    stations: tuple[float, ...] = (0.0,)
    """Increasing starts of the sections [m]."""
    grades: tuple[float, ...] = (0.0,)
    """Gradient of each section."""
    tunnels: tuple[tuple[float, float], ...] = ()
    """Start and end of each tunnel [m]."""
    tunnel_factor: float = 1.0
    """Air resistance in a tunnel over that outside. Source: JP H07-322414 has such a factor; the value is the train's."""
    spacing: float = 5.0
    """Resolution of the line [m]."""
    curves: tuple[tuple[float, float, float], ...] = ()
    """Start, end and radius of each curve [m]."""
    curve_law: str = "600/R"
    """Law of the curves' resistance, which acts on each car at its place: a name of `CURVE_LAWS`. Source: 600/R, 800/R:
    usual in England and Japan; roeckl: Roeckl, standard gauge."""

    def __post_init__(self) -> None:
        PlantError.check(
            "line", self, positive=("tunnel_factor", "spacing"), finite=("stations[]", "grades[]")
        )
        stations, grades = len(self.stations), len(self.grades)
        if stations != grades or not stations:
            raise PlantError(f"line: {stations} stations and {grades} grades; give as many of each")
        if any(b < a for a, b in pairwise(self.stations)):
            raise PlantError("line: stations must not fall")
        for start, end in self.tunnels:
            if not start < end:
                raise PlantError(f"line: tunnel from {start} to {end} m must end beyond its start")
        if self.curve_law not in CURVE_LAWS:
            raise PlantError(
                f"line: curve_law = {self.curve_law!r} is unknown; choose from {', '.join(CURVE_LAWS)}"
            )
        for start, end, radius in self.curves:
            if not start < end:
                raise PlantError(f"line: curve from {start} to {end} m must end beyond its start")
            least = CURVE_LAWS[self.curve_law][0][2]
            if not least < radius < math.inf:
                raise PlantError(
                    f"line: curve from {start} to {end} m: radius = {radius!r} must exceed {least:g} m, and be finite"
                )

    def curving(self, radius: float) -> float:
        """Resistance of a curve of `radius` [m], as a share of the weight."""
        _, numerator, offset = max(
            piece for piece in CURVE_LAWS[self.curve_law] if piece[0] <= radius
        )
        return 1e-3 * numerator / (radius - offset)

    def tabulate(self, first: float, last: float) -> tuple[float, NDArray[np.float64]]:
        """Origin [m] and table (3, points) of grade, air factor and curves' resistance every `spacing` metres."""
        origin = math.floor(first / self.spacing) * self.spacing
        points = max(2, math.ceil((last - origin) / self.spacing) + 2)
        x = origin + self.spacing * np.arange(points)
        section = np.clip(np.searchsorted(self.stations, x, side="right") - 1, 0, None)
        grade = np.asarray(self.grades, dtype=float)[section]
        inside = np.zeros(points, dtype=bool)
        for start, end in self.tunnels:
            inside |= (x >= start) & (x < end)
        curving = np.zeros(points)
        for start, end, radius in self.curves:
            here = (x >= start) & (x < end)
            curving[here] = np.maximum(curving[here], self.curving(radius))
        return origin, np.stack([grade, np.where(inside, self.tunnel_factor, 1.0), curving])


@displayed
@dataclass(frozen=True)
class Receptivity:
    """Share of the electric brake that the line takes up: mean + amplitude sin(2 pi t / period + phase), in [0, 1].

    Source: assumed.
    """

    mean: float = quantity(1.0, "1", most=1.0)
    """Mean share that the line takes up."""
    amplitude: float = quantity(0.0, "1", most=1.0)
    """Amplitude of its change; 0: it is constant."""
    period: float = quantity(3.0, "s")
    """Period of its change [s]."""
    phase: float = field(default=0.0, metadata=NOT_IN_FILES)
    """Phase of its change [rad]."""

    def __post_init__(self) -> None:
        PlantError.check("receptivity", self, ("period",), ("mean", "amplitude"), ("phase",))


def axle_values(values: ArrayLike | None, axle_count: int, what: str) -> NDArray[np.float64]:
    """One finite value per axle, zeros if None; raise `PlantError` naming `what` otherwise."""
    if values is None:
        return np.zeros(axle_count)
    array = np.asarray(values, dtype=float)
    if array.shape != (axle_count,):
        raise PlantError(f"{what}: {array.size} values for {axle_count} axles; give one per axle")
    return array


# The adhesion field: peak coefficient by position, time, speed and the effect of the wheels ahead.
#
# peak = (speed law x patches + increment + scatter) x (1 + gain x cleaning), never below a floor; sand raises it
# towards the coefficient of sanded rail, dissipated energy towards that of clean rail. JP5484215 gives the speed law
# (12), the increments by axle (15) and the scatter; JP4209318 par. 0051 gives the conditioning.


PEAK_FLOOR = 1e-3
"""Smallest peak coefficient of the field; scatter must not make adhesion zero or negative."""


@equation
def smooth_step(x):
    """0 below 0, 1 above 1, twice continuously differentiable between: 6 x^5 - 15 x^4 + 10 x^3."""
    bounded = minimum(1.0, maximum(0.0, x))  # in this order a nan passes through
    return bounded * bounded * bounded * (10.0 + bounded * (6.0 * bounded - 15.0))


@equation
def window(x, start, end, edge):
    """1 between `start` and `end`, 0 outside, with smooth edges of width `edge` centred on the bounds."""
    per_edge = 1.0 / edge
    return smooth_step((x - start) * per_edge + 0.5) * smooth_step((end - x) * per_edge + 0.5)


@equation
def patch_factor(weight_in_space, weight_in_time, factor):
    """Multiplier of the coefficient under a patch: 1 outside, `factor` inside."""
    return 1.0 + (factor - 1.0) * weight_in_space * weight_in_time


@equation
def power_taken(time, receptivity):
    """Share of the electric brake that the line takes up at `time` [s], see `Receptivity`; (4,) as its fields."""
    mean, amplitude = receptivity[0], receptivity[1]
    if amplitude == 0.0:
        return minimum(maximum(mean, 0.0), 1.0)
    wave = sine(2.0 * math.pi * time / receptivity[2] + receptivity[3])
    return minimum(maximum(mean + amplitude * wave, 0.0), 1.0)


@equation
def scatter_knot(x, length):
    """Place in the scatter's ring of `NOISE_KNOTS` knots, `length` [m] apart, between which it is interpolated linearly.

    The smooth step makes the result a curve with zero slope at the knots.
    """
    knot = x * (1.0 / length)
    base = floor(knot)
    ring = base - NOISE_KNOTS * floor(base * (1.0 / NOISE_KNOTS))
    return ring + smooth_step(knot - base)


@equation
def peak_coefficient(decline, numerator, constant, patches, increment, scatter, conditioning):
    """Peak coefficient of one axle; `decline` is that of its speed law, `patches` the product of the patch factors."""
    base = (numerator * decline + constant) * patches
    return maximum((base + increment + scatter) * (1.0 + conditioning), PEAK_FLOOR)


@equation
def sanded_peak(peak, amount, sanded, saturation):
    """Peak coefficient on a rail with `amount` [kg/m] of sand: from `peak` towards `sanded`, by 63 % at `saturation` [kg/m].

    The form is assumed: the gain is proportional to the remaining difference, so each grain adds less than the one before.
    Where the rail carries more than `sanded`, sand changes nothing.
    """
    return peak + maximum(sanded - peak, 0.0) * (1.0 - exp(-amount / saturation))


# State of the rail between steps: how far wheels have cleaned it, and the sand that lies on it.
#
# Cells of the rail under the train form a ring. Each axle reads the state under it, and changes the cells that it has
# just left behind; the foremost axle initialises those ahead of it. The right-hand side uses the values read at the
# start of a step.


@inlined_jit
def _place_in_cells(w, i):
    """Where axle `i` stands, in lengths of the rail's cells."""
    axle, state = w.axle, w.scratch.state
    return (state[axle.position_row[i]] + axle.offset[i]) / w.rail.cleaning_spacing


@inlined_jit
def _read(w, remembered):
    """A quantity under each axle, between the axle's own cell and the next: both hold what the wheels ahead left."""
    left = remembered.left
    cells = left.size
    for i in range(w.size.axles):
        x = _place_in_cells(w, i)
        base = int(np.floor(x))
        k = base % cells
        here, ahead = left[k], left[k + 1 if k + 1 < cells else 0]
        remembered.under[i] = here + (ahead - here) * (x - base)


@inlined_jit
def _begin(left, first, now):
    """Clear the cells that the foremost axle comes near while it goes from cell `first` to `now`."""
    for k in range(first, now + 1):
        left[(k + 2) % left.size] = 0.0


@inlined_jit
def _clean(w, i, first, now):
    """Axle `i` cleans the cells from `first` to `now`, as far as those ahead have not done so."""
    axle, c = w.axle, w.scratch
    left = c.cleaning.left
    v = c.state[axle.speed_row[i]]
    rim = axle.radius[i] * c.state[w.row.omega + i]
    if w.rail.recovers:
        own = c.state[w.row.recovery + i]
        deposit = w.rail.recovery_left * cleaned_degree(own, c.cleaning.under[i])
    else:
        ratio = slip_ratio(rim - v, v, rim, 1e-3)
        deposit = conditioning_deposit(ratio, w.rail.conditioning_slip)
    for k in range(first, now):
        left[k % left.size] = max(left[k % left.size], deposit)


@inlined_jit
def _sand(w, i, first, now, rate):
    """Axle `i` leaves a part of the sand in the cells from `first` to `now`; its sander lays some just ahead of it."""
    left, s = w.scratch.sand.left, w.axle.sander[i]
    laid = 0.0
    if s >= 0:
        laid = sand_laid(rate[s], w.scratch.state[w.axle.speed_row[i]])
    for k in range(first, now):
        left[k % left.size] *= w.rail.sand_kept
        left[(k + 2) % left.size] += laid


@inlined_jit
def read_rail(w):
    """Fill in the state of the rail under each axle."""
    if w.rail.conditioned:
        _read(w, w.scratch.cleaning)
    if w.rail.sandy:
        _read(w, w.scratch.sand)


@inlined_jit
def leave_rail(w, sand_rate):
    """Each axle changes the cells that it has left behind since the last step; `sand_rate` (sanders,) [kg/s]."""
    c = w.scratch
    cells = max(c.cleaning.left.size, c.sand.left.size)
    for i in range(w.size.axles):
        now = int(np.floor(_place_in_cells(w, i)))
        if c.cell[i] < now - cells or c.cell[i] > now:
            c.cell[i] = now
        first = c.cell[i]
        if w.rail.conditioned:
            if i == 0:
                _begin(c.cleaning.left, first, now)
            _clean(w, i, first, now)
        if w.rail.sandy:
            if i == 0:
                _begin(c.sand.left, first, now)
            _sand(w, i, first, now, sand_rate)
        c.cell[i] = now
