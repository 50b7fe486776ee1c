"""The least wheel damage for an effort, split among units with the truth at hand: at an instant, and in a whole event.

At an instant the driven units deliver F together. With the true curve, loads and motors of that instant, the least power

    minimise  sum_j x_j sum_i s_i(x_j)   over the force x_j of each axle of unit j,  sum_j n_j x_j = F,  x_j <= its cap

is convex: s_i(x), the slip at which axle i carries x, grows without end towards its peak. All units that are at no bound
have one marginal cost, so each unit's best force is tabulated over that cost, and what all deliver, and the power it takes,
follow (water filling). Over w = sqrt(1 - x / most) slip and cost are nearly straight lines between nodes. It is a
quasi-static bound: wheels are in balance, and what they have cleaned of the rail stays as it was.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from alloc.backends import compiled as law
from alloc.compilation import jit
from alloc.evaluation.recorded_run import RecordedRun
from alloc.plant.curves import PIECEWISE, coefficient

Floats = NDArray[np.float64]

SAMPLED = 0.1
"""Time [s] between the instants at which the least damage is found: a telegram's period."""
NODES, STEPS = 48, 32
"""Steps of slip from 0 to that of the peak, and of a unit's force from 0 to its cap."""
SQUARES, PARTS = (
    (np.arange(NODES + 1) / NODES) ** 2,
    1.0 - (1.0 - np.arange(STEPS + 1) / STEPS) ** 2,
)
"""These slips and forces, as shares of the last one."""
COSTS = np.concatenate([[0.0], np.geomspace(1e-4, 100.0, 160)])
"""Marginal costs in the tables [m/s]."""


@dataclass(frozen=True)
class BestSplits:
    """Best splits at sampled instants."""

    force: Floats
    """Of the driven axles [N], as far as the best split can deliver it, (instants,)."""
    power: Floats
    """That they dissipated [W], (instants,)."""
    ceiling: Floats
    """The most that the event's best course may deliver [N], (instants,)."""
    delivered: Floats
    """What the best split delivers at each of `COSTS` [N], (instants, costs)."""
    dissipated: Floats
    """The power that it dissipates [W], (instants, costs)."""

    def least(self, force: Floats) -> Floats:
        """Least power [W] for `force` [N], (instants,): between two costs, which are its slopes, it is a parabola."""
        enough = self.delivered >= force[:, None]
        enough[:, -1] = True
        k, q = np.arange(force.size), np.maximum(enough.argmax(axis=1), 1)
        delivered, power = self.delivered[k, q - 1], self.dissipated[k, q - 1]
        step = np.maximum(self.delivered[k, q] - delivered, 1e-9)
        u = np.clip((force - delivered) / step, 0.0, 1.0)
        bend = 0.5 * u * (1.0 - u) * step * (COSTS[q] - COSTS[q - 1])
        return np.asarray(power + u * (self.dissipated[k, q] - power) - bend)

    def excess(self, force: Floats) -> float:
        """The power over the least at which `force` (instants,) [N] is delivered, less 1; nan where that is 0."""
        least = self.least(force).sum()
        return float(self.power.sum() / least - 1.0) if least > 0.0 else float("nan")

    def best_course(self) -> Floats:
        """The force (instants,) [N] of the same impulse that has one marginal cost in the whole event, at most `ceiling`."""
        course = np.minimum(self.delivered, self.ceiling[:, None])
        total, wanted = course.sum(axis=0), self.force.sum()
        q = min(max(int(np.searchsorted(total, wanted)), 1), COSTS.size - 1)
        part = np.clip((wanted - total[q - 1]) / max(total[q] - total[q - 1], 1e-9), 0.0, 1.0)
        return np.asarray(course[:, q - 1] + part * (course[:, q] - course[:, q - 1]))


def find_best_splits(run: RecordedRun) -> BestSplits | None:
    """Best splits of the effort; None without driven axles or demand, or where the run names no curve."""
    instants = np.flatnonzero(run.demand)[:: run.instants(SAMPLED)]
    axles = np.argsort(run.unit, kind="stable")[(~run.driven).sum() :]
    if "curve" not in run.attrs or not axles.size or not instants.size:
        return None

    def select_axles(name: str) -> Floats:
        return run[name].take(instants, axis=0).take(axles, axis=1).astype(float)

    speed = np.abs(run["car_speed"].take(instants, axis=0).take(run["axle_car"][axles], axis=1))
    values = np.atleast_1d(np.asarray(run.attrs["curve_values"], dtype=float))
    # a part has one torque: a unit, or an axle of a unit whose motors are in parallel
    unit, pull = run.unit[axles], run.motors[instants]
    new = np.append(True, np.diff(unit) != 0) | (run["unit_parallel"][unit] > 0)
    first = np.flatnonzero(np.append(new, True))
    most = np.maximum(pull / run.axles, 0.0)[:, unit[first[:-1]]]
    contact = run["axle_contact"][axles].astype(float)
    peak, top, load = map(select_axles, ("offered", "peak_slip", "axle_load"))
    curve, way = int(run.attrs["curve"]), run.way[instants]
    delivered, dissipated = np.zeros((2, way.size, COSTS.size))
    tabulate_splits(
        curve, values, way, speed, peak, contact, top, load, most, first, delivered, dissipated
    )
    # wheels that failed motors do not turn resist, whatever the split
    carried = (way[:, None] * run["rail_force"][instants])[:, axles]
    force = carried.sum(axis=1) - np.minimum(pull, 0.0).sum(axis=1)
    plan = (run.built_up[instants, : run.axles.size] * run["unit_static_load"]).sum(axis=1)
    power = np.abs(run["slip_velocity"][instants][:, axles] * carried).sum(axis=1)
    possible = np.clip(force, 0.0, delivered[:, -1])
    return BestSplits(possible, power, np.maximum(plan, force), delivered, dissipated)


@jit
def tabulate_splits(
    curve, values, way, speed, peak, contact, top, load, pull, first, delivered, dissipated
):
    """Add up what all parts deliver [N] and dissipate [W] at each of `COSTS`, into (instants, costs).

    `way` (instants,); `contact` (axles,); `speed`, `peak`, `top` (slip of the peak), `load` (instants, axles); `pull`
    (instants, parts): what motors allow an axle [N]; the axles of part j are those from `first[j]` to `first[j + 1]`.
    Between steps of w, power is a parabola of force.
    """
    table, most = np.empty((top.shape[1], NODES + 1)), np.empty(top.shape[1])
    force, power, middle, price, root, place, above, width = np.zeros((8, STEPS + 1))
    for k in range(top.shape[0]):
        for i in range(top.shape[1]):  # coefficients, then w, at the slips (node / NODES)^2 top
            v, slip, w, offered = speed[k, i], way[k] * top[k, i], table[i], peak[k, i]
            steep, breadth = values[0], 0.0
            if curve == PIECEWISE:  # quick without its tail, an exponential
                breadth = law.parabola_breadth(offered, steep, values[1], values[2], values[3])
            for node in range(1, NODES + 1):
                part = slip * SQUARES[node]
                if curve == PIECEWISE:
                    w[node] = way[k] * law.piecewise_rise(abs(part), offered, steep, breadth)
                else:
                    w[node] = coefficient(curve, values, part, v, v + part, offered, contact[i])
            best = max(way[k] * w[NODES], 1e-12)
            most[i] = best * load[k, i]
            w[0] = 1.0  # 48 nodes and 32 steps fill whole vectors, 49 and 33 would not
            for node in range(1, NODES + 1):
                w[node] = np.sqrt(max(1.0 - way[k] * w[node] / best, 0.0))
            for node in range(NODES):
                w[node + 1] = min(w[node], w[node + 1])
        for j in range(first.size - 1):
            number, cap = first[j + 1] - first[j], pull[k, j]
            for i in range(first[j], first[j + 1]):
                cap = min(cap, most[i])
            if cap <= 0.0:
                continue
            power[:] = 0.0
            for i in range(first[j], first[j + 1]):
                for m in range(1, STEPS + 1):
                    root[m] = np.sqrt(max(1.0 - cap * PARTS[m] / most[i], 0.0))
                w, node = table[i], 0
                for m in range(1, STEPS + 1):
                    while node < NODES - 1 and root[m] < w[node + 1]:
                        node += 1
                    place[m], above[m], width[m] = node, w[node], max(w[node] - w[node + 1], 1e-9)
                for m in range(1, STEPS + 1):
                    inside = min(max((above[m] - root[m]) / width[m], 0.0), 1.0)
                    square = place[m] * place[m] + inside * (2.0 * place[m] + 1.0)
                    power[m] += top[k, i] * square / NODES**2 * (cap * PARTS[m])
            for m in range(1, STEPS + 1):
                force[m] = number * (cap * PARTS[m])
            for m in range(STEPS):
                slope = (power[m + 1] - power[m]) / (force[m + 1] - force[m])
                price[m + 1], middle[m + 1] = max(slope, price[m]), 0.5 * (force[m] + force[m + 1])
            q = 0
            for m in range(STEPS):  # the best force at a cost lies between the middles of two steps
                rise, more = middle[m + 1] - middle[m], max(price[m + 1] - price[m], 1e-12)
                while q < COSTS.size and COSTS[q] < price[m + 1]:
                    f = middle[m] + rise * (COSTS[q] - price[m]) / more
                    n = m if 0.0 < f <= force[m] else m + 1
                    step = force[n] - force[n - 1]
                    u = (f - force[n - 1]) / step
                    bend = price[min(n + 1, STEPS)] - price[n - 1]
                    bend = 0.25 * bend * step * u * (1.0 - u)
                    delivered[k, q] += f
                    dissipated[k, q] += power[n - 1] + u * (power[n] - power[n - 1]) - bend
                    q += 1
            last = power[STEPS - 1] + (power[STEPS] - power[STEPS - 1])
            for beyond in range(q, COSTS.size):  # it is at its cap
                delivered[k, beyond] += force[STEPS]
                dissipated[k, beyond] += last
