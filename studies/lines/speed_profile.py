"""How fast a train may be along a line: limits of line and vehicle, and braking curves to all that comes."""

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from heapq import heappop, heappush
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.display import displayed
from alloc.driving import Controls, TrainSense
from alloc.plant.laws import (
    GRAVITY,
    curving_resistance,
    gradient_force,
    hyperbolic_speed_law,
    limit_place,
    running_resistance,
)
from alloc.plant.model import Model
from alloc.plant.operations import look_up
from alloc.plant.train import EFFORT_SPEED_STEP
from studies.files.study_error import StudyError, unknown
from studies.files.units import is_number
from studies.railtoolkit.vehicles import PointOfInterest, RollingStock, RunningPath, Section

Floats = NDArray[np.float64]


class SpeedProfile:
    """Permitted speed by position of the train's front up to a stop; computed once, then looked up.

    A limit holds for the whole train: a higher one from where the rear of a train of this `length` [m] has left the
    lower one, a lower one from where the front reaches it. Every fall of the limit, and the stop at the end, is
    preceded by the curve v^2 = v_k^2 + 2 b (s_k - s) of the constant `deceleration` b [m/s2]. In (s, v^2) all curves
    are parallel, so the lowest of those still ahead is one minimum, taken from the end of the line backwards.
    `vehicle_limit` [m/s]: of the train itself. `end` [m]: where it stops; the end of the line by default.
    """

    def __init__(
        self,
        sections: Sequence[Section],
        length: float,
        deceleration: float,
        vehicle_limit: float = math.inf,
        end: float | None = None,
    ) -> None:
        if not (math.isfinite(deceleration) and deceleration > 0.0):
            raise StudyError(f"deceleration = {deceleration!r} m/s2 must be finite and exceed 0")
        if not (math.isfinite(length) and length >= 0.0):
            raise StudyError(f"train length = {length!r} m must be finite and 0 or greater")
        self.deceleration = deceleration
        self.end = sections[-1].end if end is None else end
        self.starts: list[float] = []
        """Positions [m] from which `limits` hold, growing."""
        self.limits: list[float] = []
        """[m/s]"""
        for edge, lowest in _lowest_under(sections, length):
            if edge >= self.end:
                break
            limit = min(vehicle_limit, lowest)
            if not math.isfinite(limit):
                raise StudyError(f"no speed limit at {edge:g} m, neither of line nor of vehicle")
            if not self.limits or limit != self.limits[-1]:
                self.starts.append(edge)
                self.limits.append(limit)
        falls = [
            (start, after)
            for start, (before, after) in zip(self.starts[1:], pairwise(self.limits), strict=True)
            if after < before
        ]
        falls.append((self.end, 0.0))
        self._falls = falls
        self._fall_stations = [station for station, _ in falls]
        intercepts = [speed**2 + 2.0 * deceleration * station for station, speed in falls]
        self._intercepts = np.minimum.accumulate(intercepts[::-1])[::-1].tolist()

    def limit(self, position: float) -> float:
        """Limit [m/s] for a train whose front is at `position` [m], without braking curves."""
        return self.limits[max(bisect_right(self.starts, position) - 1, 0)]

    def braking_speed(self, position: float) -> float:
        """Speed [m/s] of the lowest braking curve at `position` [m]; 0 at the stop and beyond."""
        ahead = bisect_right(self._fall_stations, position)
        if ahead == len(self._intercepts):
            return 0.0
        return math.sqrt(self._intercepts[ahead] - 2.0 * self.deceleration * position)

    def braking_point(self, position: float, speed: float) -> tuple[float, float]:
        """Where [m] a train that goes on at `speed` [m/s] meets the first braking curve, and where [m] that ends."""
        double, met, leads = 2.0 * self.deceleration, math.inf, self.end
        for ahead in range(bisect_right(self._fall_stations, position), len(self._falls)):
            station, after = self._falls[ahead]
            begins = station - (speed**2 - after**2) / double
            if after < speed and begins < met:
                met, leads = begins, station
            if station - speed**2 / double > met:
                break  # curves of what comes later are met later
        return met, leads

    def next_fall(self, position: float) -> tuple[float, float]:
        """Where the lowest braking curve at `position` [m] leads: station [m] and speed [m/s]."""
        ahead = min(bisect_right(self._fall_stations, position), len(self._falls) - 1)
        lowest = self._intercepts[ahead]
        while ahead + 1 < len(self._falls) and self._intercepts[ahead + 1] == lowest:
            ahead += 1
        return self._falls[ahead]

    def next_change(self, position: float) -> float:
        """Position [m] beyond `position` where the limit changes next, or the train stops."""
        following = bisect_right(self.starts, position)
        return self.starts[following] if following < len(self.starts) else self.end

    def permitted(self, positions: ArrayLike) -> Floats:
        """The lower of limit and braking curve [m/s] at `positions` [m], same shape."""
        x = np.asarray(positions, dtype=float)
        values = [min(self.limit(p), self.braking_speed(p)) for p in x.ravel().tolist()]
        return np.asarray(values).reshape(x.shape)

    def shortest_time(self, start: float = -math.inf) -> float:
        """Bound from below [s] of any running time from `start` [m]: always at the limit, the whole way."""
        edges = [max(edge, start) for edge in (*self.starts, self.end)]
        return sum(
            (b - a) / limit for (a, b), limit in zip(pairwise(edges), self.limits, strict=True)
        )


def _lowest_under(sections: Sequence[Section], length: float) -> list[tuple[float, float]]:
    """Positions [m] of the front at which the lowest limit [m/s] under the train may change, and that limit."""
    edges = {section.start for section in sections}
    edges |= {section.start + length for section in sections[1:]}
    found, under, entered = [], list[tuple[float, float]](), 0
    for edge in sorted(edges):
        while entered < len(sections) and sections[entered].start <= edge:
            heappush(under, (sections[entered].speed_limit, sections[entered].end))
            entered += 1
        while under[0][1] <= edge - length and len(under) > 1:
            heappop(under)  # its end, and with it its limit, lies behind the rear
        found.append((edge, under[0][0]))
    return found


# How a line is driven: where the train stops and for how long, its share of the effort, and how long it coasts.

LEAST_LEG = 50.0
"""Least distance [m] between two stops."""
LONGEST_DWELL = 3600.0
USUAL_DWELL = 30.0
"""Time [s] at a stop of which nothing else is said: of local trains."""
SLOWEST_COASTING = 0.7
"""Share of the speed at which coasting began down to which it goes on; a train that a climb slows more pulls again."""


@displayed
@dataclass(frozen=True)
class DrivingStyle:
    """`effort`: share of the tractive effort that is used at most.

    `coasting`: time [s] before a braking curve from which the train rolls without effort; 0 gives the minimum running time.
    """

    effort: float = 1.0
    coasting: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.effort <= 1.0:
            raise StudyError(
                f"effort = {self.effort!r}: give a share of the tractive effort, above 0, 1 at most"
            )
        if not 0.0 <= self.coasting <= 3600.0:
            raise StudyError(f"coasting = {self.coasting!r} s: give a time from 0 to 3600 s")


FASTEST = DrivingStyle()


class Coasting:
    """Whether the train coasts, asked from place to place along a leg; once before each braking curve."""

    def __init__(self, style: DrivingStyle) -> None:
        self.time = style.coasting
        self._slowest: float | None = None
        """Speed [m/s] at which it ends; None before it has begun."""
        self._over = False
        self._curve = -math.inf
        """End of the braking curve before which it coasts [m]."""

    def __call__(self, profile: SpeedProfile, position: float, speed: float) -> bool:
        """Whether the train is to coast at `position` [m] with `speed` [m/s]."""
        if self.time == 0.0:
            return False
        met, curve = profile.braking_point(position, speed)
        if curve != self._curve:
            self._slowest, self._over, self._curve = None, False, curve
        if self._slowest is None and met - position < self.time * speed:
            self._slowest = SLOWEST_COASTING * speed
        self._over = self._over or (self._slowest is not None and speed < self._slowest)
        return self._slowest is not None and not self._over


@displayed
@dataclass(frozen=True)
class Leg:
    """A run from stop to stop: its profile, and where it ends; the train stands there for the point's dwell."""

    profile: SpeedProfile
    stop: PointOfInterest


def legs(path: RunningPath, stock: RollingStock) -> tuple[Leg, ...]:
    """The run over a line, stop by stop; the last leg ends at the end of the line, where the run is over.

    Raises `StudyError` where two stops are too close, or one lies off the line.
    """
    first, last = path.span
    found, before = [], first
    for stop in path.stops():
        place = stop.front_position(stock.length)
        if not 0.0 <= (stop.dwell or 0.0) <= LONGEST_DWELL:
            raise StudyError(
                f"stop {stop.name!r}: dwell {stop.dwell:g} s must lie from 0 to {LONGEST_DWELL:g} s"
            )
        if not before + LEAST_LEG <= place <= last - LEAST_LEG:
            raise StudyError(
                f"stop {stop.name!r}: the front stands at {place:g} m; that must be {LEAST_LEG:g} m or more from "
                f"other stops and from the ends of the line, {first:g} m and {last:g} m"
            )
        found.append((place, stop))
        before = place
    found.append((last, PointOfInterest(last, "end of the line", dwell=0.0)))
    return tuple(
        Leg(
            SpeedProfile(path.sections, stock.length, stock.deceleration, stock.speed_limit, place),
            stop,
        )
        for place, stop in found
    )


def with_stops(path: RunningPath, wanted: Sequence[str], dwell: float | None) -> RunningPath:
    """The line with stops at the `wanted` points alone, each a name or a station [m]; or at "all" points, or at "none".

    `dwell` [s]: how long it stands, in place of what the points say. Raises `StudyError` with the nearest name.
    """
    by_name = {point.name: point for point in path.points}
    chosen: list[PointOfInterest] = []
    for item in wanted:
        if item == "all":
            chosen += path.points
        elif item in by_name:
            chosen.append(by_name[item])
        elif is_number(item):
            chosen.append(PointOfInterest(float(item), f"{float(item):g} m"))
        elif item != "none":
            raise StudyError(
                f"{unknown('stop', item, [*by_name, 'all', 'none'])}; or give a station in m"
            )
    stops = {
        (point.station, point.name): replace(point, dwell=_dwell(point, dwell)) for point in chosen
    }
    rest = [replace(p, dwell=None) for p in path.points if (p.station, p.name) not in stops]
    points = sorted([*rest, *stops.values()], key=lambda point: point.station)
    return replace(path, points=tuple(points))


def _dwell(point: PointOfInterest, dwell: float | None) -> float:
    usual = USUAL_DWELL if point.dwell is None else point.dwell
    return usual if dwell is None else dwell


# Forces of a whole train that rolls without slip, by position and speed: what a driver knows who knows train and line.


class TrainForces:
    """Effort, brake and resistance of `model`'s train, from the plant's own equations and tables, summed over the train."""

    def __init__(self, model: Model) -> None:
        s, e = model.structure, model.environment
        self.inertia = model.train.mass + model.train.rotating_mass
        """Mass with the rotating masses [kg]."""
        radius = np.array([s.radius[s.axle_unit == j].mean() for j in range(model.layout.units)])
        rims = s.unit_axles * s.unit_gear / radius
        self._speeds = EFFORT_SPEED_STEP * np.arange(s.drive_table.shape[1])
        self._drive, self._brake = s.drive_table, s.brake_table
        self._effort, self._electric = rims @ s.drive_table, rims @ s.brake_table
        self.peak_torque: Floats = s.drive_table.max(axis=1)
        """Greatest torque of each unit's motors [N m], (units,)."""
        self._mass, self._level = model.train.mass, s.car_resistance.sum(axis=0)
        self._shoe_gain, self._friction = s.shoe_gain, s.shoe_friction.T
        self._linear = s.car_resistance[:, 1].sum()
        # gradient, tunnels and curves by position of the front, each car where it stands
        self._places = np.arange(model.span[0], model.span[1] + e.line_spacing, e.line_spacing)
        under = (self._places[:, None] + s.car_offset - e.line_origin) / e.line_spacing
        knots = np.arange(e.line.shape[1])
        grade, air, curving = (np.interp(under, knots, row) for row in e.line)
        self._climbing = gradient_force(s.car_mass, grade).sum(axis=1)
        self._quadratic = air @ s.car_resistance[:, 2]
        curves = curving_resistance(s.car_mass, curving).sum(axis=1)
        self._constant = s.car_resistance[:, 0].sum() + curves

    def effort(self, speed: float) -> float:
        """Greatest tractive effort at the rims [N] at `speed` [m/s]."""
        return float(np.interp(speed, self._speeds, self._effort))

    def electric_brake(self, speed: float) -> float:
        """Greatest force of the electric brake at the rims [N] at `speed` [m/s]."""
        return float(np.interp(speed, self._speeds, self._electric))

    def torque(self, share: float, speed: float) -> Floats:
        """Torque of each unit's motors [N m] for a `share` of effort, or below 0 of electric brake, at `speed` [m/s].

        (units,)
        """
        table = self._drive if share >= 0.0 else self._brake
        place = limit_place(max(speed, 0.0), 1.0 / EFFORT_SPEED_STEP, self._speeds.size)
        return np.asarray(share * look_up(table.T, place))

    def resistance(self, position: float, speed: float) -> float:
        """Running resistance and gradient force [N] at `position` [m] of the front and `speed` [m/s]."""
        quadratic = np.interp(position, self._places, self._quadratic)
        constant = np.interp(position, self._places, self._constant)
        running = running_resistance(speed, constant, self._linear, quadratic, 1.0)
        return float(running) + self.climbing_at(position)

    def level_resistance(self, speed: float) -> float:
        """Running resistance [N] forward on level, straight and open line; at standstill that of setting off."""
        constant, linear, quadratic = self._level
        return float(constant + (linear + quadratic * speed) * speed)

    def climbing(self, grade: float) -> float:
        """Gradient force [N] on the whole train where all of it stands on this `grade`."""
        return float(gradient_force(self._mass, grade))

    def climbing_at(self, position: float) -> float:
        """Gradient force [N] with the front at `position` [m], each car where it stands."""
        return float(np.interp(position, self._places, self._climbing))

    def brake_pressure(self, force: float, speed: float) -> float:
        """Cylinder pressure [Pa] at which all shoes together brake with `force` [N] at the rims."""
        return force / float(self._shoe_gain @ hyperbolic_speed_law(speed, *self._friction))


# Running time by steps of distance, as timetable programs calculate it: the train as one mass, without wheels or
# control.
#
# The scheme of TrainRuns.jl: a mass point at the train's front, explicit Euler in the distance. The same effort,
# resistance and limits as in the simulated run, for comparison with it and with such programs.


USUAL_STEP = 20.0
"""Step [m] of TrainRuns.jl where nothing else is set."""
FALL = 0.19
"""Share of the kinetic energy that a train loses at most in a step without effort; a tenth of its speed."""


@dataclass(frozen=True)
class DistanceRun:
    """Position of the front [m], speed [m/s] and time [s] at the ends of the steps, (points,)."""

    position: Floats
    speed: Floats
    time: Floats

    @property
    def running_time(self) -> float:
        """[s]"""
        return float(self.time[-1])


def run_by_distance(
    forces: TrainForces,
    sections: Sequence[Section],
    legs: Sequence[Leg],
    step: float = USUAL_STEP,
    style: DrivingStyle = FASTEST,
    spread: bool = False,
) -> DistanceRun:
    """Run the `legs` over the line's `sections`, in steps of `step` [m] or less.

    Over a step the acceleration is that of its beginning, so the error falls with the first power of the step. Steps end
    where gradient or limit change, and where a limit or a braking curve is met. `spread`: each car is where it stands, in
    place of a mass point at the front. Raises `StudyError` where the train cannot climb.
    """
    x, t = sections[0].start, 0.0
    points = [(x, 0.0, t)]
    for leg in legs:
        points += _run_leg(forces, sections, leg, step, style, spread, x, t)
        x, t = leg.profile.end, points[-1][2] + (leg.stop.dwell or 0.0)
        points.append((x, 0.0, t))
    columns = np.array(points).T
    return DistanceRun(*columns)


def _run_leg(
    forces: TrainForces, sections: Sequence[Section], leg: Leg, step: float, style: DrivingStyle,
    spread: bool, x: float, t: float,
) -> list[tuple[float, float, float]]:  # fmt: skip
    """Position, speed and time after each step from standstill at `x` [m] and `t` [s] to the stop."""
    profile, b, v = leg.profile, leg.profile.deceleration, 0.0
    starts = [section.start for section in sections]
    coasting = Coasting(style)
    points = []
    while x < profile.end - 1e-9:
        limit = profile.limit(x)
        section = sections[max(bisect_right(starts, x) - 1, 0)]
        change = min(profile.next_change(x), section.end, profile.end)
        reach = min(step, change - x)
        climbing = forces.climbing_at(x) if spread else forces.climbing(section.grade)
        resistance = forces.level_resistance(v) + climbing
        rolls = coasting(profile, x, v)
        pull = 0.0 if rolls else style.effort * forces.effort(v)
        a = (pull - resistance) / forces.inertia
        if v >= limit:
            a = min(a, 0.0)  # held: with less than all effort, or the brake
        if rolls and a < 0.0:
            reach = min(reach, FALL * v**2 / (-2.0 * a))  # it pulls again before it stands
        if v**2 + 2.0 * a * reach <= 0.0:
            raise StudyError(
                f"the train cannot climb at {x:.0f} m: effort {1e-3 * pull:.1f} kN, "
                f"resistance and gradient {1e-3 * resistance:.1f} kN"
            )
        if a > 0.0:
            reach = min(reach, (limit**2 - v**2) / (2.0 * a))
        room = profile.braking_speed(x) ** 2 - v**2
        braking = room <= 2.0 * (a + b) * reach
        if braking and a + b > 0.0:
            reach = max(room, 0.0) / (2.0 * (a + b))
        after = min(math.sqrt(v**2 + 2.0 * a * reach), limit)
        x, t, v = x + reach, t + (2.0 * reach / (v + after) if reach > 0.0 else 0.0), after
        points.append((x, v, t))
        if braking:
            station, speed = profile.next_fall(x)
            t += (v - speed) / b
            x, v = station, speed
            points.append((x, v, t))
    return points


# A driver who loses no time: full effort, then the limit held, then the service brake on its curve.
#
# For `alloc.driving.drive`. That this order is the fastest is the classical result of running-time calculation
# (Bruenger and Dahlhaus, Running Time Estimation, in Hansen and Pachl, Railway Timetabling and Operations, 2014). With
# another driving style he pulls with a share of the effort, and coasts before he brakes.

FOLLOWING_TIME = 1.0
"""Time constant [s] with which the driver takes back what he is off his target speed. Five times the lag of the assumed
brake, so that he approaches without overshoot."""
STANDSTILL = 0.02
"""Speed [m/s] at which the train counts as stopped: half a millimetre before rest."""
ARRIVING = 0.2
"""Speed [m/s] of the braking curve below which standing still means having arrived."""
ROLLING_BACK = -0.05
"""Speed [m/s] at which a train that cannot climb is seen to be lost."""
HANDING_OVER = 0.2
"""Time [s] by which the air brake is commanded ahead of the electric brake's fading: the lag of the assumed brake."""
HOLDING = 0.01
"""Brake force that holds the train at a stop, beyond that against the gradient, as a share of the weight."""


class Halt(NamedTuple):
    """A stop: when the train stood [s] and where [m], and when it left [s]; it does not leave the last one."""

    arrival: float
    position: float
    departure: float


class MinimumTimeDriver:
    """Drives `model` along its `legs`, within the bounds of line and train and of the `style`.

    From the wanted acceleration he computes the force by `TrainForces` (feedforward of resistance and gradient);
    `FOLLOWING_TIME` corrects a deviation of speed. So he holds a speed with an effort equal to the resistance, without limit
    cycle, and follows the braking curve with the full deceleration of the profile. The electric brake gives what it can, the
    air brake the rest.

    He ends the run at the stop at the end of the line, or where the train rolls back; then `stalled` is true. Raises
    `StudyError` if the train has no air brake.
    """

    def __init__(self, model: Model, legs: Sequence[Leg], style: DrivingStyle = FASTEST) -> None:
        brakes = [car.air_brake for car in model.train.cars if car.air_brake is not None]
        if not brakes:
            raise StudyError(f"train {model.train.name!r} has no air brake to stop with")
        self.forces, self.style = TrainForces(model), style
        self._to_come = list(legs)
        self._greatest_pressure = min(brake.maximum_pressure for brake in brakes)
        self._weight = GRAVITY * model.train.mass
        self._standing_until = 0.0
        self.halts: list[Halt] = []
        self.stalled = False
        self.running_time = 0.0
        """Time [s] at which the train stops, from its last motion at the profile's deceleration."""
        self._next_leg()

    def _next_leg(self) -> None:
        self.leg = self._to_come.pop(0)
        self.profile = self.leg.profile
        self.coasting = Coasting(self.style)

    def wanted_acceleration(self, position: float, speed: float) -> float:
        """Acceleration [m/s2] that leads to the permitted speed; far above what the train can do if it is far below."""
        holding = (self.profile.limit(position) - speed) / FOLLOWING_TIME
        curve = self.profile.braking_speed(position)
        # along the curve, at a speed below it, less deceleration keeps the relative distance
        along = self.profile.deceleration * (speed / curve if curve > max(speed, 0.0) else 1.0)
        return min(holding, (curve - speed) / FOLLOWING_TIME - along)

    def __call__(self, sense: TrainSense, controls: Controls) -> bool:
        """Set torques and pressures for the coming control period; False at the end of the run."""
        speed, position = sense.speed, sense.position
        controls.torque[:] = controls.pressure[:] = 0.0
        if sense.time < self._standing_until:
            self._hold(position, controls)
            return True
        force = self.forces.inertia * self.wanted_acceleration(position, speed)
        force += self.forces.resistance(position, speed)
        if force < 0.0:
            self._brake(-force, speed, controls)
        elif not self.coasting(self.profile, position, speed):
            self._pull(force, speed, controls)
        if speed > STANDSTILL:
            self.running_time = sense.time + speed / self.profile.deceleration
        arrived = self.profile.braking_speed(position) < ARRIVING and speed < STANDSTILL
        self.stalled = speed < ROLLING_BACK and not arrived
        if arrived:
            leaving = self.running_time + (self.leg.stop.dwell or 0.0)
            self.halts.append(Halt(self.running_time, position, leaving))
            if self._to_come:
                self._standing_until = leaving
                self._next_leg()
                self._hold(position, controls)
                return True
        return not (arrived or self.stalled)

    def _pull(self, force: float, speed: float, controls: Controls) -> None:
        available = self.forces.effort(speed)
        share = force / available if force < available else 1.0
        if share < self.style.effort or self.style.effort < 1.0:
            controls.torque[:] = self.forces.torque(min(share, self.style.effort), speed)
        else:
            # all of it: the plant's own bound, at the speed of the rims, decides
            controls.torque[:] = self.forces.peak_torque

    def _brake(self, force: float, speed: float, controls: Controls) -> None:
        # what the electric brake will give when the air brake has answered: it fades towards standstill
        soon = speed - HANDING_OVER * self.profile.deceleration
        electric = min(force, self.forces.electric_brake(soon))
        if electric > 0.0:
            share = electric / self.forces.electric_brake(speed)
            controls.torque[:] = self.forces.torque(-share, speed)
        pressure = self.forces.brake_pressure(force - electric, speed)
        controls.pressure[:] = min(pressure, self._greatest_pressure)

    def _hold(self, position: float, controls: Controls) -> None:
        """Stand at a stop, with little more than is needed, so that the brake is soon released."""
        force = abs(self.forces.resistance(position, 0.0)) + HOLDING * self._weight
        pressure = self.forces.brake_pressure(force, 0.0)
        controls.pressure[:] = min(pressure, self._greatest_pressure)
        controls.torque[:] = 0.0
