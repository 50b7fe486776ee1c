"""Running times calculated in other ways than the project's, for comparison: train and line as plain numbers.

`published_scheme`: the scheme of TrainRuns.jl, explicit Euler by 20 m, written down anew. `exact_time`: the same train with
each vehicle where it stands, by a solver of SciPy in time with events.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

G = 9.80665


@dataclass
class PlainVehicle:
    """Masses in t, lengths in m, resistance in per mille, effort as pairs of km/h and N."""

    kind: str
    length: float
    mass: float
    load: float = 0.0
    rotation: float = 1.06
    driven_mass: float = 0.0
    base: float = 0.0
    rolling: float = 0.0
    air: float = 0.0
    effort: tuple[tuple[float, float], ...] = ()

    def resistance(self, v: float) -> float:
        """[N] forward on level track, loaded, at v [m/s]: Wende (2003), p. 151 and 153."""
        head = ((v + 15 / 3.6) / (100 / 3.6)) ** 2
        if self.effort:
            rest = self.mass - self.driven_mass
            return G * (
                self.base * self.driven_mass + self.rolling * rest + self.air * self.mass * head
            )
        if self.kind == "passenger":
            mille = self.base + self.rolling * v / (100 / 3.6) + self.air * head
        else:
            mille = self.base + self.air * (v / (100 / 3.6)) ** 2
        return G * mille * (self.mass + self.load)

    def keys(self, name: str) -> dict:
        """As a railtoolkit vehicle."""
        kind = "traction unit" if self.kind == "locomotive" else self.kind
        content = {
            "name": name, "id": name, "vehicle_type": kind, "length": self.length, "mass": self.mass,
            "load_limit": self.load, "rotation_mass": self.rotation, "base_resistance": self.base,
            "rolling_resistance": self.rolling, "air_resistance": self.air,
        }  # fmt: skip
        if self.effort:
            content["mass_traction"] = self.driven_mass
            content["tractive_effort"] = [list(pair) for pair in self.effort]
        return content


@dataclass
class PlainRun:
    """A train of vehicles from the front, its brake [m/s2] and limit [km/h], on rows of start, km/h and per mille."""

    vehicles: list[PlainVehicle]
    brake: float
    limit: float
    rows: list[tuple[float, float, float]]

    def __post_init__(self) -> None:
        self.length = sum(v.length for v in self.vehicles)
        self.mass = 1e3 * sum(v.mass + v.load for v in self.vehicles)
        empty = sum(v.mass for v in self.vehicles)
        factor = sum(v.rotation * v.mass for v in self.vehicles) / empty
        self.inertia = factor * self.mass
        self.end = self.rows[-1][0]
        # falls of the limit, and the end
        self.targets = [
            (start, min(kmh, self.limit) / 3.6) for start, kmh, _ in self.rows[1:-1]
        ] + [(self.end, 0.0)]

    def pull(self, v: float) -> float:
        return sum(
            float(np.interp(3.6 * v, *zip(*vehicle.effort, strict=True)))
            for vehicle in self.vehicles
            if vehicle.effort
        )

    def row_at(self, x: float) -> tuple[float, float, float]:
        return [row for row in self.rows[:-1] if row[0] <= max(x, self.rows[0][0])][-1]

    def allowed(self, x: float) -> float:
        """Limit [m/s] for all of the train."""
        under = [
            kmh
            for (start, kmh, _), (end, _, _) in zip(self.rows, self.rows[1:], strict=False)
            if start <= x and end > x - self.length
        ]
        return min(self.limit, *under) / 3.6

    def curve(self, x: float) -> tuple[float, float, float]:
        """Square of the lowest braking curve's speed at x, where it leads, and at what speed."""
        return min(
            (v * v + 2 * self.brake * (s - x), s, v) for s, v in self.targets if s > x - 1e-9
        )

    def drag(self, v: float) -> float:
        return sum(vehicle.resistance(v) for vehicle in self.vehicles)

    def climb_of_front(self, x: float) -> float:
        return self.mass * G * self.row_at(x)[2] / 1e3

    def climb_of_cars(self, x: float) -> float:
        force, front = 0.0, x
        for vehicle in self.vehicles:
            middle = front - 0.5 * vehicle.length
            force += 1e3 * (vehicle.mass + vehicle.load) * G * self.row_at(middle)[2] / 1e3
            front -= vehicle.length
        return force

    def changes(self) -> list[float]:
        """Where something changes for the front or the rear [m]."""
        starts = [row[0] for row in self.rows]
        return sorted({*starts, *(s + self.length for s in starts if s + self.length < self.end)})


def published_scheme(run: PlainRun, step: float = 20.0) -> float:
    """Running time [s]; from change to change of the line, by steps of `step` [m], the last ones shortened by bisection."""
    x, v, t = run.rows[0][0], 0.0, 0.0
    changes = run.changes()
    while x < run.end - 1e-6:
        top = run.allowed(x)
        a = (run.pull(v) - run.drag(v) - run.climb_of_front(x)) / run.inertia
        if v >= top - 1e-9:
            a = min(a, 0.0)
        ahead = min(step, next(c for c in changes if c > x + 1e-9) - x)

        def after(way: float, v=v, a=a) -> float:
            return math.sqrt(v * v + 2 * a * way)

        def fits(way: float, x=x, top=top, after=after) -> bool:
            return after(way) <= top + 1e-12 and after(way) ** 2 <= run.curve(x + way)[0] + 1e-9

        if not fits(ahead):
            low, high = 0.0, ahead
            for _ in range(60):
                middle = 0.5 * (low + high)
                low, high = (middle, high) if fits(middle) else (low, middle)
            ahead = low
        new = after(ahead)
        if ahead > 1e-9:
            t += 2 * ahead / (v + new)
        x, v = x + ahead, new
        square, station, speed = run.curve(x)
        if v * v >= square - 1e-6 and v > speed:
            t, x, v = t + (v - speed) / run.brake, station, speed
        elif ahead <= 1e-9:
            v = min(v, top) if v < top else top  # at the limit: held in the next step
    return t


def exact_time(run: PlainRun) -> float:
    """Running time [s] of the train with its vehicles where they stand."""
    x, v, t = run.rows[0][0], 0.0, 0.0

    def rate(_, state):
        x, v = state
        v = max(v, 0.0)
        return [v, (run.pull(v) - run.drag(v) - run.climb_of_cars(x)) / run.inertia]

    def at_curve(_, state):
        return state[1] ** 2 - run.curve(state[0])[0]

    at_curve.terminal, at_curve.direction = True, 1.0
    while x < run.end - 1e-3:
        square, station, speed = run.curve(x)
        if v * v >= square - 1e-6 and v > speed:
            t, x, v = t + (v - speed) / run.brake, station, speed
            continue
        top = run.allowed(x + 1e-9)
        change = next(c for c in [*run.changes(), run.end] if c > x + 1e-6)
        if v >= top - 1e-9 and rate(0.0, (x, v))[1] >= 0.0:  # held, metre by metre
            to_curve = max((run.curve(x)[0] - v * v) / (2 * run.brake), 0.0)
            way = min(1.0, change - x, max(to_curve, 1e-6))
            t, x = t + way / v, x + way
            continue

        def at_limit(_, state, top=top):
            return state[1] - top

        def at_change(_, state, change=change):
            return state[0] - change

        at_limit.terminal, at_limit.direction = True, 1.0
        at_change.terminal = True
        found = solve_ivp(
            rate,
            (0.0, 3600.0),
            (x, v),
            events=(at_limit, at_change, at_curve),
            max_step=2.0,
            rtol=1e-8,
        )
        t, x, v = t + found.t[-1], *found.y[:, -1]
        if found.t_events[0].size:
            v = top
        if found.t_events[1].size:
            x = change
    return t
