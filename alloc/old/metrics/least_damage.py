"""Excess damage: wheel damage Q over the least Q of the same train effort, split among units with the truth at hand.

In: a recorded run and the adhesion curve that it names. Out: one metric, `excess_damage`.

At each sampled instant the driven units together deliver the effort F of the run. With the true curves, loads and motor
limits of that instant, the least power that wheels can dissipate for it is

    minimise    sum_j x_j sum_i s_i(x_j)    over the force x_j >= 0 of each axle of unit j
    subject to  sum_j n_j x_j = F,          x_j <= what its motors and its weakest axle allow,

where unit j has n_j axles, and s_i(x) is the slip velocity below the peak at which axle i carries x. It is a quasi-static
bound: wheels are in balance, and what they have cleaned of the rail stays as it was. A force needs more slip the nearer it
is to the peak, without end at the peak itself, so the program is convex, and at its optimum all units that are at no bound
have one marginal cost

    d(x_j sum_i s_i) / d(n_j x_j)  =  mean_i (s_i + x_j ds_i/dx_j).

The search for it is water filling. Slip and marginal cost are tabulated over w = sqrt(1 - force / force at the peak), in
which they are nearly straight lines, for a curve with a sharp peak and with a flat one. The split that is found delivers F,
and its slips are those of the curve itself. So the power is never too small, and an error of the split counts squared: at
nine tenths of what the rail carries it is below 0.1 %, at half of that below 0.5 %.
"""

import json
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.old.compilation import inlined_jit, jit
from alloc.old.metrics.registry import (
    direction,
    instants_in,
    metric,
    series,
    under_demand,
)
from alloc.old.metrics.use import motor_bounds
from alloc.old.plant.adhesion import CURVES, AdhesionCurve
from alloc.old.plant.laws import tangential_coefficient
from alloc.old.plant.operations import WIDTH, load, maximum, minimum, padded, sqrt, store

Floats = NDArray[np.float64]

SAMPLED = 0.1
"""Time [s] between the instants that count: a telegram's period."""
NODES = 12
"""Steps of slip from 0 to that of the peak in a table, and of w from 0 to 1 in that of a unit's marginal cost."""
PASSES = 6
"""Passes that find the peak coefficient which a curve takes from its maximum; they gain a digit or more each."""
ENOUGH = 1e-9
"""Relative error of the effort at which the search for the marginal cost ends."""
POLISHED = 4
"""Most steps from the table's slip to that of the curve itself."""
MOST_STEPS = 60
"""Most steps of that search."""


@jit
def tabulate(kind, curve, limit, top, speed, way, contact, peak, table):
    """Fill `peak` and `table` for contacts in whole blocks; all arrays flat, `table` with NODES + 1 rows of that length.

    `limit`, `top`: maximum of each contact's curve and its slip velocity [m/s]. `way`: 1 driving, -1 braking. Row k < NODES
    has w at the share (k / NODES)^2 of `top`, and the last one the coefficient at `top`.
    """
    size = limit.size
    for i in range(0, size, WIDTH):
        most, slip, v, c = load(limit, i), load(top, i), load(speed, i), load(contact, i)
        sign = load(way, i)
        local = most
        for _ in range(PASSES):
            found = tangential_coefficient(kind, curve, slip, v, v + slip, local, c)
            local = local * most / maximum(found, 1e-12)
        best = sign * tangential_coefficient(kind, curve, sign * slip, v, v + sign * slip, local, c)
        store(peak, i, local)
        store(table, NODES * size + i, best)
        inverse, before = 1.0 / maximum(best, 1e-12), 1.0 + 0.0 * most
        for k in range(NODES):
            part = sign * (k * k * (1.0 / NODES**2)) * slip
            mu = sign * tangential_coefficient(kind, curve, part, v, v + part, local, c)
            before = minimum(before, sqrt(maximum(0.0, 1.0 - mu * inverse)))
            store(table, k * size + i, before)


@inlined_jit
def slip_share(table, size, i, w, k):
    """Slip over that of the peak at which contact `i` of `table` has this w, and minus its derivative over w; linear.

    `k`: the step of the table that is tried first, or one behind it; that of the answer is returned before it.
    """
    k = min(k, NODES - 1)
    while k > 0 and w > table[k * size + i]:
        k -= 1
    upper = table[k * size + i]
    lower = table[(k + 1) * size + i] if k + 1 < NODES else 0.0
    slope = 1.0 / max(upper - lower, 1e-9)
    step = (2 * k + 1) * (1.0 / NODES**2)
    share = k * k * (1.0 / NODES**2) + min(max((upper - w) * slope, 0.0), 1.0) * step
    return k, share, slope * step


@inlined_jit
def _force_at(marginal, product, least_w, cap, price):
    """Force of an axle of a unit whose marginal cost is `price`, from the tables at w = m / NODES: cost and w times cost."""
    m = NODES
    while marginal[m - 1] <= price:  # it has no end at w = 0
        m -= 1
    slope = (product[m] - product[m - 1]) * NODES
    rest = product[m] - slope * (m / NODES)
    w = max(rest / max(price - slope, 1e-12), (m - 1) / NODES)
    w = min(max(w, least_w), 1.0)
    return cap * (1.0 - w * w)


@jit
def least_power(kind, curve, contacts, table, loads, first, count, most, effort, work, split, out):
    """Fill `out` (instants,) with the least power [W] at which the units deliver `effort` (instants,) [N].

    `split` (instants, units) is filled with the force of an axle of each [N]. `contacts`: slip velocity at the peak, speed,
    way, stiffness and `peak` of each contact, flat and padded, by instant and axle as `loads` (instants, axles) [N]; axles
    of a unit stand together. `first`, `count` (units,): its axles. `most` (instants, units): force of an axle [N] that its
    motors allow. `work`: arrays to write to.
    """
    top, speed, way, contact, peak = contacts
    instants, axles = loads.shape
    units, size = first.size, top.size
    marginal, product, (cap, least_w) = work
    price = 0.1
    for t in range(instants):
        able, force = 0.0, split[t]
        for j in range(units):
            cap[j] = np.inf
            for a in range(first[j], first[j] + count[j]):
                cap[j] = min(cap[j], table[NODES * size + t * axles + a] * loads[t, a])
            own = min(max(most[t, j], 0.0), cap[j])
            least_w[j] = np.sqrt(max(1.0 - own / cap[j], 0.0)) if cap[j] > 0.0 else 1.0
            able += count[j] * cap[j] * (1.0 - least_w[j] ** 2)
            product[j, :] = 0.0
            for a in range(first[j], first[j] + count[j]):
                i = t * axles + a
                ratio = cap[j] / max(table[NODES * size + i] * loads[t, a], 1e-9)
                k = NODES
                for m in range(NODES + 1):
                    w = m * (1.0 / NODES)
                    used = (1.0 - w * w) * ratio
                    own_w = np.sqrt(max(1.0 - used, 0.0))
                    k, share, slope = slip_share(table, size, i, own_w, k)
                    rise = w / own_w if own_w > w else 1.0
                    # w times slip, and w times force times its derivative
                    product[j, m] += top[i] * (w * share + 0.5 * rise * slope * used)
            marginal[j, 0] = np.inf
            for m in range(NODES + 1):
                product[j, m] /= count[j]
                if m > 0:
                    marginal[j, m] = product[j, m] * NODES / m
        wanted = min(max(effort[t], 0.0), able)
        if wanted >= able * (1.0 - ENOUGH):
            for j in range(units):
                force[j] = cap[j] * (1.0 - least_w[j] ** 2)
        else:
            price = _price(marginal, product, least_w, cap, count, wanted, able, price, force)
        out[t] = 0.0
        for j in range(units):
            for a in range(first[j], first[j] + count[j]):
                i = t * axles + a
                full = max(table[NODES * size + i] * loads[t, a], 1e-9)
                w = np.sqrt(max(1.0 - force[j] / full, 0.0))
                _, share, slope = slip_share(table, size, i, w, NODES)
                before, before_w = 0.0, 1.0
                for _ in range(POLISHED):
                    slip = way[i] * share * top[i]
                    mu = way[i] * tangential_coefficient(
                        kind, curve, slip, speed[i], speed[i] + slip, peak[i], contact[i]
                    )
                    there = np.sqrt(max(1.0 - mu * loads[t, a] / full, 0.0))
                    if abs(there - w) < 1e-7:
                        break
                    if abs(there - before_w) > 1e-9 and before > 0.0:
                        slope = (before - share) / (there - before_w)
                    before, before_w = share, there
                    share = min(max(share - (w - there) * slope, 0.5 * share), 1.0)
                out[t] += force[j] * share * top[i]


@inlined_jit
def _price(marginal, product, least_w, cap, count, wanted, able, guess, force):
    """Marginal cost at which units deliver `wanted` [N], less than `able`; fills `force` of an axle of each.

    Bracketed by factors of two from `guess`, then by false position with halved weights (the Illinois method). What the
    last step leaves is shared in proportion.
    """
    low, high, at_low, at_high = 0.0, np.inf, -wanted, able - wanted
    price, side = guess, 0
    for _ in range(MOST_STEPS):
        given = -wanted
        for j in range(cap.size):
            force[j] = _force_at(marginal[j], product[j], least_w[j], cap[j], price)
            given += count[j] * force[j]
        if abs(given) <= ENOUGH * able:
            break
        if given > 0.0:
            high, at_high = price, given
            at_low *= 0.5 if side > 0 else 1.0
            side = 1
        else:
            low, at_low = price, given
            at_high *= 0.5 if side < 0 else 1.0
            side = -1
        if np.isinf(high):
            price = 2.0 * price
        elif low == 0.0:
            price = 0.5 * price
        else:
            price = (low * at_high - high * at_low) / (at_high - at_low)
    total = given + wanted
    for j in range(cap.size):
        if given > 0.0:
            force[j] *= wanted / max(total, 1e-9)
        else:
            room = cap[j] * (1.0 - least_w[j] ** 2) - force[j]
            force[j] -= room * given / max(able - total, 1e-9)
    return price


def curve_of(run: xr.Dataset) -> AdhesionCurve | None:
    """The adhesion curve of the rail of `run`; None where its class is not registered, or the run does not say."""
    told = json.loads(str(run.attrs.get("adhesion_curve", "{}")))
    for made in CURVES.values():
        if made.__name__ == told.get("class"):
            return made(**told["values"])
    return None


def sampled(run: xr.Dataset) -> NDArray[np.intp]:
    """Numbers of the sampled instants under demand."""
    return np.flatnonzero(under_demand(run))[:: max(1, instants_in(run, SAMPLED))]


def least_split(
    run: xr.Dataset,
    curve: AdhesionCurve,
    chosen: Any,
    axles: Any,
    unit: Any,
    most: Any,
    effort: Any,
) -> tuple[Floats, Floats]:
    """Least power [W] at which `axles` deliver `effort` (instants,) [N] at the `chosen` instants, and the split.

    `unit` (axles,): whose force each axle has, equal numbers together; `most` (instants, units): force of an axle [N] that
    brakes or motors allow. The split is the force of an axle of each unit [N], (instants, units).
    """  # fmt: skip
    first = np.flatnonzero(np.append(True, np.diff(unit) != 0))
    count = np.diff(np.append(first, unit.size))

    def of_axles(name: str) -> Floats:
        return np.ascontiguousarray(series(run, name)[chosen][:, axles])

    shape = chosen.size, unit.size
    size = padded(chosen.size * unit.size)

    def flat(values: Any) -> Floats:
        found = np.ones(size)
        found[: chosen.size * unit.size] = np.broadcast_to(values, shape).ravel()
        return found

    radius, weight = series(run, "axle_radius")[axles], series(run, "axle_static_load")[axles]
    limit, top = flat(of_axles("adhesion_limit")), flat(of_axles("peak_slip"))
    car = series(run, "axle_car")[axles]
    speed = flat(np.abs(series(run, "car_speed")[chosen][:, car]))
    way, contact = flat(direction(run)[chosen][:, None]), flat(curve.contact(0.5 * weight, radius))
    peak, table, least = np.empty(size), np.empty((NODES + 1) * size), np.empty(chosen.size)
    q, nodes, split = (
        np.array(curve.q),
        (first.size, NODES + 1),
        np.empty((chosen.size, first.size)),
    )
    work = np.empty(nodes), np.empty(nodes), tuple(np.empty((2, first.size)))
    tabulate(curve.kind, q, limit, top, speed, way, contact, peak, table)
    least_power(
        curve.kind, q, (top, speed, way, contact, peak), table, of_axles("axle_load"), first, count,
        np.ascontiguousarray(most), effort, work, split, least,
    )  # fmt: skip
    return least, split


def _powers(run: xr.Dataset, curve: AdhesionCurve) -> tuple[Floats, Floats]:
    """Power dissipated by the driven axles, and the least for their effort [W], at the sampled instants under demand."""
    chosen, unit = sampled(run), series(run, "axle_unit")
    driven = np.argsort(unit, kind="stable")[(unit < 0).sum() :]
    unit = unit[driven]
    able = motor_bounds(run, chosen)
    # wheels that failed motors do not turn resist, whatever the split
    dragged = np.minimum(able, 0.0).sum(axis=1)
    able /= np.maximum(np.bincount(unit, minlength=run.sizes["unit"]), 1)
    # motors that share an inverter let each axle find its own torque
    apart = (series(run, "unit_parallel") > 0)[unit]
    begins = np.append(True, (np.diff(unit) != 0)) | apart
    force = direction(run)[chosen][:, None] * series(run, "rail_force")[chosen][:, driven]
    slip = series(run, "slip_velocity")[chosen][:, driven]
    least, _ = least_split(
        run, curve, chosen, driven, np.cumsum(begins), able[:, unit[begins]], force.sum(axis=1) - dragged
    )  # fmt: skip
    return np.abs(slip * force).sum(axis=1), least


@metric(
    "excess_damage",
    "1",
    "wheel damage Q of driven axles over the least of the same train effort, less 1",
    -1,
    (-1.0, np.inf),
)
def excess_damage(run: xr.Dataset) -> float:
    """Excess of the driven axles' damage under demand over the least at the same effort, see `alloc.old.metrics.least_damage`.

    nan without driven axles or demand, and for a curve that is not registered. Wheels that speed up or slow down are not in
    balance, so the axles of a unit may differ for a moment, and a run without slip may be a little below 0.
    """
    curve = curve_of(run)
    if curve is None or not (series(run, "axle_unit") >= 0).any() or not under_demand(run).any():
        return float("nan")
    power, least = _powers(run, curve)
    return float(power.sum() / least.sum() - 1.0) if least.sum() > 0.0 else float("nan")
