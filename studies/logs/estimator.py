"""What a log says: the reading of it that fits best, and its series in time, at the rims and by true radii.

`studies.logs.motion_fit` fits the speed and the errors of all channels. A reading that is not the usual one is kept where
the cost of the fit falls by more than its price: forces at the rail, late forces, late wheels, a late speed, a scale of the
speed, late axles. What is unknown of a wheel is filled in by the speed, and by creep or the slip around.
"""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.series import spans, usual_period
from studies.logs.aligned_log import (
    LONGEST_FILLED,
    Log,
    bring_together,
    check_units,
    evened,
    find_dead_zone,
    find_stuck,
    leave_out_stuck_speed,
    rate_of,
    turn_forces,
)
from studies.logs.motion_fit import (
    CREEP_UNSURE,
    LEAST_RADIUS,
    WALKS,
    Fit,
    Posterior,
    fit,
    thinned,
)
from studies.logs.own_samples import BRIDGED
from studies.logs.remarks import faulty

Floats = NDArray[np.float64]

PRICE = {
    "contact": 12.0,
    "force_late": 20.0,
    "scaled": 60.0,
    "axles": 30.0,
    "drift": 6.0,
    "early": 60.0,
    "late": 20.0,
    "wheels_late": 40.0,
}
"""By how much the cost must fall for a reading that is not the usual one."""
ROTATING = 0.02
"""Error of g beyond which the usual reading is as likely as forces at the rail."""
DELAYS = np.arange(-0.5, 1.81, 0.05)
"""Delays of the speed from which the fit begins, of which the likeliest is taken [s]."""
EXCERPT = 300.0
"""Time [s] of a longer log in which readings are compared: the one in which forces change most."""


def _first_delay(log: Log, v: Floats) -> float:
    """Delay of the speed's channel by a first guess of the speed, but for an offset and a slope."""
    assert log.fixes is not None
    z, best = thinned(log.fixes), (np.inf, 0.0)
    for d in DELAYS.tolist():
        tau = z.time - d
        guess = np.interp(tau, log.time, v)
        ok = (tau > log.time[0]) & (tau < log.time[-1]) & (np.maximum(guess, z.value) > 0.3)
        if ok.sum() < 4:
            continue
        y = rest = (z.value - guess)[ok]
        X = np.stack([np.ones(y.size), tau[ok] - tau[ok].mean()], axis=1)
        for _ in range(3):
            w = 1 / (1 + (rest / max(1e-4, 2 * np.median(np.abs(rest)))) ** 2)
            rest = y - X @ np.linalg.lstsq(X * w[:, None], y * w, rcond=None)[0]
        best = min(best, (float(np.median(np.abs(rest))), d))
    return best[1]


class Unsure(NamedTuple):
    """What is not known of the speed."""

    posterior: Posterior | None
    """None where the speed is as measured."""
    creep: Floats
    """Mean creep of the axles [m/s], (instants,)."""
    rate: Floats
    """Acceleration [m/s2], (instants,)."""
    speed: Floats
    """[m/s], (instants,)."""
    delay: float
    """Standard deviation of the delay [s]."""
    scale: float
    """Standard deviation of the scale of the speed."""
    noise: float
    """Of a measured speed [m/s]."""

    def of(self, weight: Floats) -> tuple[float, float]:
        """Standard deviations of the integral of a `weight` (instants,) times the speed: of the speed, and of its delay."""
        model = 0.0 if self.posterior is None else self.posterior.deviation(weight)
        terms = (
            model, CREEP_UNSURE * float(weight @ self.creep), self.scale * float(weight @ self.speed),
            self.noise * float(np.sqrt(weight @ weight)),
        )  # fmt: skip
        return float(np.sqrt(np.square(terms).sum())), abs(float(weight @ self.rate)) * self.delay

    def deviation(self, time: Floats) -> Floats:
        """Standard deviation of the speed itself [m/s], (instants,), by some instants."""
        some = np.unique(np.linspace(0, time.size - 1, 60).astype(int))
        found = []
        for k in some:
            weight = np.zeros(time.size)
            weight[k] = 1.0
            found.append(np.hypot(*self.of(weight)))
        return np.interp(time, time[some], found)


@dataclass
class Estimate:
    """What a log says, in time, at the rims and by true radii; nan where nothing is known."""

    log: Log
    fit: Fit
    speed: Floats
    """[m/s], (instants,)."""
    followed: bool
    """Whether the speed is that of the model, or of the channel in another time or scale; else it is as measured."""
    unsure: Unsure
    delay: tuple[float, float] | None
    """Delay of the speed's channel and its standard deviation [s]."""


FAR_OFF, NEAR, RARELY = 0.5, 0.05, 0.1
"""Differences of a measured speed from that of the model [m/s] above which it is none: the smaller if rarely exceeded."""
LEAST_LATE, LEAST_SCALE, LEAST_DELAY = 0.01, 5e-4, 4e-3
"""Delay of forces [s], scale of the speed and its delay [s] below which nothing is changed."""
DELAY_FLOOR, SCALE_UNSURE = 1e-3, 1e-4
"""Least standard deviation of a delay [s], and of the speed's scale, relative."""


def estimate(
    log: Log, names: dict[int, str], source: str, at_contact: bool | None = None
) -> Estimate:
    """Fit a log, and bring its series to what they should be, in place; `at_contact`: what is told of the forces.

    `names` of the axles' columns and `source`, the log's name, are for remarks. Raises `Faulty` for mistaken units.
    """
    if not log.told.any() and log.fixes is None:
        raise faulty(
            source,
            "speed",
            None,
            "neither the train's speed nor a force of an axle is there: nothing tells the speed",
        )
    if log.told.any():
        turn_forces(log, names)
    find_dead_zone(log, log.guess())
    leave_out_stuck_speed(log, names.get(-1, "speed"))
    find_stuck(log, names)
    if log.told.any():
        check_units(log, log.guess(), source)
    some = _busiest(log)
    part = log if some is None else log.rows(some)
    use = log.fixes is not None and log.fixes.time.size >= 3
    as_is = use and log.fixes is not None and log.fixes.kind == "sampled"
    walks = WALKS[1:] if log.told.any() else (0.1, 0.3)
    alone = fit(part, part.guess(), use_speed=False, drift=WALKS[0] if log.told.any() else 0.1)
    drift = min(
        (fit(part, part.guess(), use_speed=False, drift=w) for w in walks),
        key=lambda one: one.evidence,
    )
    if drift.evidence < alone.evidence - PRICE["drift"]:
        alone = drift
    if some is None:
        moved = replace(log, rim=log.rim.copy(), force=log.force.copy(), remarks=list(log.remarks))
        if bring_together(moved, log.guess() if as_is else alone.speed, names):
            again = fit(moved, moved.guess(), use_speed=False)
            if again.cost < alone.cost - PRICE["axles"]:
                log, alone, part = moved, again, moved
    found, start = _readings(part, alone, use, as_is, at_contact, walks)
    if some is not None:
        found = fit(log, use_speed=use, **start | {"first": log.guess()})
    return _corrected(log, found, names)


def _busiest(log: Log) -> slice | None:
    """Of a long log, the rows in which forces change most; None for a short one."""
    t = log.time
    if t[-1] - t[0] < 1.3 * EXCERPT:
        return None
    change = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(evened(log.force.sum(1), 50))))])
    starts = np.searchsorted(t, np.arange(t[0], t[-1] - EXCERPT, 60.0))
    ends = np.searchsorted(t, t[starts] + EXCERPT)
    k = int(np.argmax(change[ends - 1] - change[starts]))
    return slice(int(starts[k]), int(ends[k]))


def _readings(
    log: Log, alone: Fit, use: bool, as_is: bool, at_contact: bool | None, walks: tuple[float, ...]
) -> tuple[Fit, dict[str, Any]]:
    """The fit by the reading that costs least, and what it began with; `alone`: the one without the speed's channel."""
    starts: list[dict[str, Any]] = [{"first": alone.speed}]
    if as_is:
        starts += [{"first": log.guess()}]
    if at_contact:
        starts = [one | {"contact": True} for one in starts]
    if not log.told.any():
        starts = [one | {"drift": walks[0]} for one in starts]
    found, start = min(
        ((fit(log, use_speed=use, **one), one) for one in starts), key=lambda one: one[0].cost
    )
    for late in {0.0, round(_first_delay(log, alone.speed), 2)} if use else ():
        begun = start | {"first": alone.speed, "late": late}
        other = fit(log, use_speed=use, **begun)
        if other.cost + PRICE["late"] * ("late" not in start) < found.cost:
            found, start = other, begun
    for drift in walks:
        other = fit(log, use_speed=use, **start | {"drift": drift})
        if other.evidence < found.evidence - PRICE["drift"]:
            found, start = other, start | {"drift": drift}
    best = found.cost + _early(found)
    wrong = np.count_nonzero(np.abs(found.radius) > LEAST_RADIUS)
    at_rims = _at_rims(log, found.speed) if at_contact is None else None
    others: list[tuple[str, dict[str, Any]]] = []
    # forces that no channel tells explain a change as well as the wheels' inertia
    if at_contact is None and at_rims is not True and log.told.all():
        others += [("contact", {"contact": True})]
    if use:
        others += [("scaled", {"scaled": True})]
    if log.told.any():
        others += [("force_late", {"force_late": late}) for late in (0.0, 0.15, -0.15)]
    if log.told.any() and use:  # all else is early then
        others += [("wheels_late", {"late": -late, "force_late": -late}) for late in (0.15, -0.15)]
    chosen = start
    for name, changes in others:
        begun = start | changes
        if name == "force_late" and _early(found):
            begun["late"] = 0.0
        other = fit(log, use_speed=use, **begun)
        cost = other.cost + _early(other)
        price = max(PRICE[name], 8.0 * wrong if name == "scaled" else 0.0)
        if name.endswith("_late") and not log.dense:  # a rare speed tells two delays badly
            price *= 3.0
        if name == "contact" and at_rims is None and abs(other.x["g"] - 1.0) > ROTATING:
            continue  # a mass that is not told explains it as well
        if name == "scaled" and not _rolling_wheels_agree(log, other):
            continue  # creep of wheels that always brake looks like a scale
        if name == "contact" and at_rims is False:
            found, best, start = other, cost, start | {"contact": True}
            chosen = start
        elif cost + price < best:
            found, best, chosen = other, cost + price, begun
    return found, dict(chosen)


def _early(found: Fit) -> float:
    """What it costs that a speed is measured before the train has it."""
    d, h = found.x["d"], found.x["h"]
    return PRICE["early"] if d < -0.02 and abs(h - d) > 0.02 else 0.0  # else the wheels are late


def _rolling_wheels_agree(log: Log, found: Fit) -> bool:
    """Whether wheels that roll freely differ from the speed's channel by the scale that was found."""
    assert log.fixes is not None
    t = log.time[::5]
    z = np.interp(t + found.x["d"], log.fixes.time, log.fixes.value)
    free = (np.abs(log.force[::5]) < 2e-3 * log.train.axle_load) & (z > 1.0)[:, None]
    ratio = (log.rim[::5] / np.maximum(z, 1.0)[:, None] - 1.0)[free]
    ratio = ratio[np.isfinite(ratio)]
    s = found.x["s"]
    return bool(ratio.size > 20 and abs(np.median(ratio) + s) < 0.3 * abs(s) + 2e-4)


def _at_rims(log: Log, v: Floats) -> bool | None:
    """Whether an accelerated axle that nothing drives has no force, or just that of its inertia; None where none tells."""
    rate = rate_of(log.time, v, 25)
    changes = np.abs(rate) > 0.1
    if not changes.any():
        return True
    own, inertia = (
        np.abs(log.force[changes][:, log.told]),
        log.rotating[log.told] * rate[changes, None],
    )
    load = log.train.axle_load[log.told]
    if ((own < 1e-9 * load).mean(0) > 0.3).any():
        return True
    ratio = -(log.force[changes][:, log.told] * inertia).sum(0) / (inertia**2).sum(0)
    rolls = ~log.train.driven[log.told] & ((own < 5e-3 * load).mean(0) > 0.9)
    return False if rolls.any() and abs(np.median(ratio[rolls]) - 1) < 0.3 else None


def _corrected(log: Log, found: Fit, names: dict[int, str]) -> Estimate:
    """Wheels by their true radii, forces in time and at the rims, the speed as measured where it is exact."""
    t, x, z, v = log.time, found.x, log.fixes, found.speed
    exact = (
        z is not None
        and log.dense
        and z.noise < 0.02
        and found.noise < max(0.02, 0.05 * (log.own is not None))
    )
    delay = None
    deviation = 0.0
    if z is not None and z.time.size >= 3:
        deviation = found.posterior.deviation_of("d")
        delay = (x["d"], float(np.hypot(deviation, DELAY_FLOOR)))
    followed = not exact
    if exact and z is not None:
        late = x["d"] if abs(x["d"]) > max(LEAST_DELAY, 0.6 * usual_period(t)) else 0.0
        scale = x["s"] if abs(x["s"]) > LEAST_SCALE else 0.0
        inside = (t + late <= z.time[-1]) & (t + late >= z.time[0]) & ~log.lost
        after = np.clip(np.searchsorted(z.time, t + late), 1, z.time.size - 1)
        inside &= z.time[after] - z.time[after - 1] < max(BRIDGED, 1.5 * z.period)
        # a receiver without a fix says anything, and one that has stopped repeats itself
        measured = np.interp(t + late, z.time, z.value) / (1 + scale)
        apart = np.abs(measured - v)
        near = max(NEAR, 10.0 * found.noise)
        inside &= apart < (near if np.mean(apart[inside] > near) < RARELY else FAR_OFF)
        v = np.where(inside, measured, v)
        followed = bool(late or scale)
    v = np.maximum(v, min(0.0, float(np.nanmin(log.rim))))  # a train rolls back as its wheels do
    accelerated = np.gradient(v, t)
    log.filled = np.zeros(log.rim.shape, dtype=np.bool_, order="F")
    mean_creep = np.zeros(t.size)
    for i in range(log.rim.shape[1]):
        rim, force = log.rim[:, i], log.force[:, i]
        over = v if log.own is None else v + log.own[:, i]
        if abs(found.radius[i]) > LEAST_RADIUS:
            rim /= 1 + found.radius[i]
        if log.told[i]:
            # a force jumps somewhere between two rows
            if abs(x["h"]) > max(LEAST_LATE, usual_period(t)):
                force[:] = np.interp(t + x["h"], t, force)
            if found.contact:
                force += log.rotating[i] * np.gradient(np.where(np.isfinite(rim), rim, over), t)
        carried = (force - log.rotating[i] * accelerated) / log.train.axle_load[i]
        creep = carried * (x["k0"] + x["k1"] * v) * (v > 0.02)
        mean_creep += np.abs(creep) / log.rim.shape[1]
        if log.turning[i]:
            log.filled[:, i] = np.isnan(rim) | log.lost
            slip = np.where(log.filled[:, i], np.nan, rim - over)
            rim[:] = np.where(log.filled[:, i], over + creep, rim)
            for b, k in spans(log.filled[:, i]):
                if b > 0 and k < t.size and t[k] - t[b - 1] < LONGEST_FILLED:
                    ends = np.nanmean(slip[max(b - 5, 0) : b]), np.nanmean(slip[k : k + 5])
                    line = np.interp(t[b:k], t[[b - 1, k]], ends)
                    rim[b:k] = over[b:k] + line * (over[b:k] > 0.02)
        if not log.told[i]:
            force[:] = np.nan
    unsure = Unsure(
        None if exact else found.posterior, mean_creep if not exact else np.zeros(t.size), accelerated, v,
        float(np.hypot(deviation, DELAY_FLOOR)) if exact and followed else 0.0 if exact else DELAY_FLOOR,
        0.0 if exact and not followed else SCALE_UNSURE, (z.noise if z is not None else 0.0) if exact else 0.0,
    )  # fmt: skip
    return Estimate(log, found, v, followed, unsure, delay)
