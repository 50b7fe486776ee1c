"""The optimum of a whole event by CasADi: least wheel damage at an end speed, or most end speed at a wheel damage.

Who knows the rail ahead could ask each unit at each instant for the torque that serves the whole event best. No rule and no
controller can do better. The problem over the torques u_j(t) that are commanded to the motors of unit j is

    minimise Q, or maximise v, at the end
    dy/dt = f(y, u, t)                the plant, `mpc.plant`
    0 <= u_j(t) <= what motors give, and what the computers' jerk limit has let rise until then
    sum_j of what is asked at the rims <= the driver's plan as the jerk limit builds it up

with y = (position x, speed v, slip s_i of each driven axle, torque T_j of each unit, wheel damage Q). An interval has two
points of Radau IIA, which damps stiff wheels, and one u. All intervals enter in the same way: CasADi differentiates one, in
SX, and maps the derivatives over all, as blocks on the diagonal. Beside them stands only what joins neighbours. To have the
whole differentiated takes as long as to solve it.

    problem = EventProblem(event)
    best = problem.least_damage(12.0)        # m/s
    run = problem.replay(best)               # its torques in the compiled plant, recorded
"""

import math
from typing import Any, NamedTuple

import casadi as cs
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.compilation import signals_afterwards
from alloc.evaluation.recorded_run import series
from alloc.laws import gradient_force
from alloc.onboard.targets import torque_per_coefficient
from alloc.run.event import Event
from alloc.run.simulation import ADVANCE, BRAKE, Simulation, simulate
from alloc.schema.errors import InputError, UnsoundRun
from mpc.plant import KNOTS, build_plant, refuse, through_knots

Floats = NDArray[np.float64]
STEP = 0.06
"""Longest interval [s]."""
RADAU, PLACES = np.array([[5.0, -1.0], [9.0, 3.0]]) / 12.0, np.array([1.0 / 3.0, 1.0])
"""Radau IIA of third order: Hairer and Wanner, Solving Ordinary Differential Equations II, IV.5."""
POSITION, SPEED, SLIP = 100.0, 10.0, 0.05
"""Scales: what counts as one [m, m/s, m/s]."""
SLIPS, FIRST_SLIP = (-0.05, 100.0), 0.02
"""Slips within which the optimum is sought, and the least with which the search begins, over that scale."""
AGAIN, LEFT = 5, 0.9
"""How often a solution is solved again from itself if it has left the start's places on scatter and line, or the speeds of
the motors' limits, and by how many knots that is."""
TOLERANCE = 1e-5
"""Residual of the conditions of Karush, Kuhn and Tucker that counts as none."""
IPOPT = {"print_level": 0, "sb": "yes", "tol": 1e-7, "max_iter": 150, "mu_init": 1e-4}
"""The barrier begins low: the start is nearly an optimum."""


class NoOptimum(UnsoundRun):
    """The solver ended without an optimum."""


class Optimum(NamedTuple):
    """An optimum; it ends with the last recorded instant of a run, so that both compare."""

    speed: float
    """At the end [m/s]."""
    damage: float
    """Wheel damage Q of the driven axles [J]."""
    states: Floats
    """y at the points, (axles + units + 3, 2 K)."""
    torques: Floats
    """Commanded to each motor in an interval [N m], (units, K)."""
    residual: float
    """Of the conditions of Karush, Kuhn and Tucker [1], in scaled variables."""
    iterations: int
    """Of ipopt."""


class EventProblem:
    """The problem of an event, which starts from a `run`, by default the oracle's.

    Raises `InputError` for an event that the model does not have.
    """

    def __init__(self, event: Event, run: xr.Dataset | None = None, step: float = STEP) -> None:
        self.event, self.world = event, event.world()
        refuse(event, self.world)
        run = simulate(event, "oracle", "none") if run is None else run
        w, p, time = self.world, self.world.plant[0], series(run, "time")
        self.driven = np.flatnonzero(w.wheelsets.unit >= 0)
        """Numbers of the driven axles."""
        self.n, self.m, self.K = self.driven.size, w.drives.size, math.ceil(time[-1] / step)
        self.edges = np.linspace(0.0, time[-1], self.K + 1)
        slip, work = (series(run, k)[:, self.driven] for k in ("slip_velocity", "friction_work"))
        moves, torque = (series(run, k) for k in ("position", "speed")), series(run, "motor_torque")
        y = np.column_stack([*moves, slip, torque, work.sum(axis=1)]).T
        points = (self.edges[:-1, None] + np.diff(self.edges)[:, None] * PLACES).ravel()
        self.begin, self.start = y[:, 0], np.array([np.interp(points, time, row) for row in y])
        self.top = float(w.effort.max())
        scale = [SLIP] * self.n + [self.top] * self.m
        self.scale = np.array([POSITION, SPEED, *scale, max(y[-1, -1], 1.0)])
        self.rim = np.eye(self.scale.size)  # rims' speeds in place of slips
        self.rim[2 : 2 + self.n, 1] = 1.0
        of_unit = w.wheelsets.unit[self.driven] == np.arange(self.m)[:, None]
        self.mean = of_unit / of_unit.sum(axis=1, keepdims=True)
        points = p.line_origin + p.line_spacing * np.arange(w.line.size)
        under = points[:, None] + w.cars.middle
        grade, air = (np.interp(under, points, w.line[k]) for k in ("grade", "air"))
        downhill = gradient_force(w.cars.mass, grade).sum(axis=1)
        self.line = downhill, air @ w.cars.resistance_quadratic
        self.per_torque = w.drives.axles * w.drives.gear / w.drives.radius
        self.demand = self.ask()
        self.solver = self.build_solver()

    def ask(self) -> tuple[Floats, Floats]:
        """The most that computers ask, means of intervals: of a motor [N m], (units, K); of all at the rims [N], (K,)."""
        w, run, board = self.world, self.world.run[0], self.world.onboard[0]
        rising = np.zeros(
            (2, w.command.size + 1)
        )  # as coefficients: without end, and up to the plan
        for k, plan in enumerate(w.command * board.planned):
            free, bounded = rising[:, k] + plan * run.period / run.rise
            rising[:, k + 1] = free * (plan > 0.0), min(bounded, plan)
        time, impulse = run.period * np.arange(len(rising.T)), run.period * rising.cumsum(axis=1)
        impulses = np.array([np.interp(self.edges, time, row) for row in impulse])
        free, wanted = np.diff(impulses) / np.diff(self.edges)
        scale = np.array([torque_per_coefficient(u, u.turning, board) for u in w.units])
        return scale[:, None] * free, (self.per_torque @ scale) * wanted

    def find_places(self, states: Floats) -> Floats:
        """Numbers of knots: of the scatter under each axle, of the line, of the motors' limits, (axles + 1 + units, K)."""
        w, p, x = self.world, self.world.plant[0], states[0, ::2]
        scatter = (x + w.wheelsets.offset[self.driven, None]) / (p.scatter_length or np.inf)
        line = (x - p.line_origin) / (p.line_spacing if w.line.size > 1 else np.inf)
        middle = 0.75 * states[:, ::2] + 0.25 * states[:, 1::2]
        kmh = 3.6 * (middle[1] + self.mean @ middle[2 : 2 + self.n])
        return np.vstack([scatter, line, kmh])

    def find_numbers(self, states: Floats) -> Floats:
        """Parameters of the intervals where the train is at `states`: begin, length, knots, (numbers, K)."""
        w, n, first = self.world, self.n, np.floor(self.find_places(states)) - 1.0
        k = (first[:, None] + np.arange(KNOTS)[:, None]).astype(np.int64)
        tables = [*[w.scatter] * n, *self.line, *w.effort]
        rows = [*range(n), n, *range(n, n + 1 + self.m)]
        numbers = [self.edges[:-1], np.diff(self.edges)]
        for table, row in zip(tables, rows, strict=True):
            at = k[row] % table.size if row < n else np.clip(k[row], 0, table.size - 1)
            numbers += [first[row], *table[at]]
        return np.array(numbers)

    def build_solver(self) -> Any:
        """CasADi's solver; its parameters are the numbers of each interval, then the prices of Q and of speed at the end."""
        n, m, K, scale, d = self.n, self.m, self.K, self.scale, self.scale.size
        z, p = cs.SX.sym("z", 2 * d + m), cs.SX.sym("p", 2 + (KNOTS + 1) * (n + 2 + m))
        begin, length, knots = p[0], p[1], cs.reshape(p[2:], KNOTS + 1, n + 2 + m)
        y, u = (scale * z[:d], scale * z[d : 2 * d]), self.top * z[2 * d :]
        plant = build_plant(self.world, self.event.rail.curve)
        rates = [plant(y[i], u, begin + PLACES[i] * length, knots[:, : n + 2])[0] for i in (0, 1)]
        steps = [self.rim @ y[i] - length * (cs.horzcat(*rates) @ RADAU[i]) for i in (0, 1)]
        middle = 0.75 * y[0] + 0.25 * y[1]
        kmh = 3.6 * (middle[1] + cs.DM(self.mean) @ middle[2 : 2 + n])
        limits = [through_knots(kmh[j], knots[:, n + 2 + j]) for j in range(m)]
        total = cs.dot(self.per_torque, u) / self.demand[1].max()
        g = cs.vertcat(
            *[step / scale for step in steps], total, (u - cs.vertcat(*limits)) / self.top
        )
        dual = cs.SX.sym("dual", g.numel())
        slopes, curvature = cs.jacobian(g, z), cs.triu(cs.hessian(cs.dot(dual, g), z)[0])

        def over_intervals(output: Any, inputs: Any, arguments: Any) -> Any:
            return cs.Function("interval", inputs, cs.cse([output])).map(K)(*arguments)

        def on_diagonal(block: Any, *of: Any) -> Any:
            return cs.sparsity_cast(over_intervals(block, *of), cs.diagcat(*[block.sparsity()] * K))

        # what joins neighbours: an interval begins at the last point of the one before
        corner = cs.DM(g.numel(), z.numel())
        corner[: 2 * d, d : 2 * d] = -np.tile(self.rim * scale / scale[:, None], (2, 1))
        join = cs.kron(cs.DM(cs.Sparsity.band(K, 1), 1.0), cs.sparsify(corner))
        sizes = {"x": join.size2(), "p": p.numel() * K + 2, "weight": 1, "duals": join.size1()}
        x, P, weight, duals = (cs.MX.sym(name, size) for name, size in sizes.items())
        Z, numbers = cs.reshape(x, z.numel(), K), cs.reshape(P[:-2], p.numel(), K)
        of = [z, p, dual], [Z, numbers, cs.reshape(duals, g.numel(), K)]
        f = P[-2] * Z[2 * d - 1, -1] - P[-1] * Z[d + 1, -1]
        G = cs.vec(over_intervals(g, of[0][:2], of[1][:2])) + join @ x
        J, H = on_diagonal(slopes, of[0][:2], of[1][:2]) + join, on_diagonal(curvature, *of)
        # CasADi's names
        jac, hess = (["x", "p"], ["g", "jac:g:x"]), ["x", "p", "lam:f", "lam:g"]
        self.constraints = cs.Function("nlp_jac_g", [x, P], [G, J], *jac)
        hessian = cs.Function(
            "nlp_hess_l", [x, P, weight, duals], [H], hess, ["triu:hess:gamma:x:x"]
        )
        options: Any = {"ipopt": IPOPT, "print_time": False}
        options |= {"jac_g": self.constraints, "hess_lag": hessian}
        nlp: Any = {"x": x, "p": P, "f": f, "g": G}
        return cs.nlpsol("optimum", "ipopt", nlp, options)

    def least_damage(self, speed: float, start: Optimum | None = None) -> Optimum:
        """Least wheel damage at this end speed [m/s], started from an optimum if there is one.

        Raises `NoOptimum` where the solver finds none.
        """
        return self.solve("speed", speed, start)

    def most_speed(self, damage: float, start: Optimum | None = None) -> Optimum:
        """Most end speed at this wheel damage [J]; otherwise as `least_damage`."""
        return self.solve("damage", damage, start)

    def solve(self, bounded: str, value: float, start: Optimum | None) -> Optimum:
        """The optimum where "speed" or "damage" has this value at the end."""
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{bounded} = {value!r}: give a finite number above 0")
        n, m, K, scale, d = self.n, self.m, self.K, self.scale, self.scale.size
        low, high = np.full((2, 2 * d + m, K), np.inf)
        low[: 2 * d], low[2 * d :], high[2 * d :] = -np.inf, 0.0, self.demand[0] / self.top
        for point in (0, d):
            slips, torques = np.split(np.arange(point + 2, point + d - 1), [n])
            low[slips], high[slips] = SLIPS
            low[torques], high[torques] = 0.0, 1.0
        prices = np.array([1.0, 0.0] if bounded == "speed" else [0.0, 1.0])
        if bounded == "speed":
            low[d + 1, -1] = value / SPEED
        else:
            high[2 * d - 1, -1] = value / scale[-1]
        least, most = np.zeros((2, 2 * d + 1 + m, K))
        least[: 2 * d, 0] = most[: 2 * d, 0] = np.tile(self.rim @ self.begin / scale, 2)
        least[2 * d :], most[2 * d] = -np.inf, self.demand[1] / self.demand[1].max()
        lbx, ubx, lbg, ubg = (bound.ravel("F") for bound in (low, high, least, most))
        where, states = (
            f"event {self.event.name!r}, {bounded} = {value:g}",
            start.states if start else self.start,
        )
        for _ in range(AGAIN):
            guess, places = states / scale[:, None], self.find_places(states)
            guess[2 : 2 + n] = np.maximum(guess[2 : 2 + n], FIRST_SLIP)
            x0 = np.vstack([guess[:, ::2], guess[:, 1::2], guess[2 + n : -1, 1::2]]).ravel("F")
            P = np.append(self.find_numbers(states).ravel("F"), prices)
            with signals_afterwards():
                solution = self.solver(x0=x0, p=P, lbx=lbx, ubx=ubx, lbg=lbg, ubg=ubg)
            x, *duals = (np.array(solution[name]).ravel() for name in ("x", "lam_x", "lam_g"))
            residual = self.find_residual(x, P, duals, np.append(lbx, lbg), np.append(ubx, ubg))
            status, count = (self.solver.stats()[name] for name in ("return_status", "iter_count"))
            if status != "Solve_Succeeded" or not residual <= TOLERANCE:
                raise NoOptimum(
                    f"{where}: {status} after {count} iterations, residual {residual:.1g}"
                )
            z = x.reshape(-1, K, order="F")
            states = scale[:, None] * np.stack([z[:d], z[d : 2 * d]], axis=2).reshape(d, -1)
            if np.abs(self.find_places(states) - places).max() < LEFT:
                ends = float(states[1, -1]), float(states[-1, -1])
                return Optimum(*ends, states, self.top * z[2 * d :], residual, count)
        raise NoOptimum(f"{where}: its places on the rail do not settle")

    def find_residual(
        self, x: Floats, P: Floats, duals: list[Floats], low: Floats, high: Floats
    ) -> float:
        """Largest residual of the conditions of Karush, Kuhn and Tucker; of a slope over the size of its terms."""
        g, J = self.constraints(x, P)
        J, values, dual = J.sparse(), np.append(x, np.array(g)), np.concatenate(duals)
        below, above, slope = low - values, values - high, np.zeros(x.size)
        d, m = self.scale.size, self.m
        slope[[-m - 1, -m - d + 1]] = P[-2], -P[-1]
        size = 1.0 + np.abs(slope) + abs(J).T @ np.abs(duals[1]) + np.abs(duals[0])
        stationary = np.abs(slope + J.T @ duals[1] + duals[0]) / size
        # a multiplier above 0 belongs to the upper bound, another to the lower
        slack = np.abs(dual) * np.minimum(np.abs(np.where(dual > 0.0, above, below)), 1.0)
        return float(max(below.max(), above.max(), stationary.max(), slack.max()))

    def replay(self, optimum: Optimum) -> xr.Dataset:
        """The recorded run of its torques in the compiled plant, open loop."""
        run, period = Simulation(self.event, "alone", "none"), self.event.onboard.period
        impulse = np.cumsum(optimum.torques * np.diff(self.edges), axis=1)
        instants = period * np.arange(run.ticks + 1)
        impulses = [np.interp(instants, self.edges, np.append(0.0, row)) for row in impulse]
        torques = np.diff(impulses) / period
        while run.tick < run.ticks:
            run.run_to(BRAKE)
            run.world.units.applied[:] = torques[:, run.tick]
            run.run_to(ADVANCE)
        return run.recorded().assign_attrs(rule="optimum")
