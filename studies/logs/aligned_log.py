"""The channels of a log at common instants, and what is plainly wrong with them before anything is fitted.

Forces that drive what they brake, sensors that say 0 at low speed or stay the same, units that the train's momentum
contradicts, and recorders of some axles that are late against the others.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.series import excerpt, spans, usual_period
from studies.logs.channels import FEWEST_ROWS
from studies.logs.own_samples import BRIDGED, Samples, at
from studies.logs.remarks import Remark, faulty
from studies.logs.train import MeasuredTrain

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

LONGEST_FILLED = 10.0
"""Rows that are lost for longer [s] are a gap, which is not filled."""
UNITS_OF_SPEED = {
    "mile/h called km/h": 1.609344,
    "km/h called mile/h": 1.0 / 1.609344, "knots called km/h": 1.852,
    "km/h called m/s": 1.0 / 3.6, "m/s called km/h": 3.6,
}  # fmt: skip
UNITS_OF_FORCE = {
    "lbf called kN": 1.0 / 224.809, "N called kN": 1e-3, "kN called N": 1e3, "kgf called kN": 9.80665e-3,
    "kgf called N": 9.80665, "lbf called N": 4.44822,
}  # fmt: skip
"""Mistaken units, and the factor that puts them right."""


def evened(x: Floats, half: int) -> Floats:
    """Mean over a row and `half` rows to each side."""
    total = np.cumsum(np.pad(x, (half + 1, half), "edge"))
    return (total[2 * half + 1 :] - total[: -2 * half - 1]) / (2 * half + 1)


def rate_of(t: Floats, v: Floats, half: int) -> Floats:
    """Rate of change of a mean over a row and `half` rows to each side."""
    return np.gradient(evened(v, half), t)


def integral(t: Floats, x: Floats, moves: Any = 1.0) -> Floats:
    """Integral by trapezia, from row to row as far as it `moves`."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (x[1:] + x[:-1]) * np.diff(t) * moves)])


@dataclass
class Log:
    """Series in SI units at common instants; nan where a wheel is unknown."""

    time: Floats
    """[s], (instants,)."""
    rim: Floats
    """[m/s], (instants, axles)."""
    force: Floats
    """[N], 0 where no channel tells it, (instants, axles)."""
    fixes: Samples | None
    """The speed's channel."""
    lost: Flags
    """Rows that are missing, (instants,)."""
    train: MeasuredTrain
    noise: Floats
    """Of each wheel [m/s], (axles,)."""
    span: Floats
    """Time over which each wheel is a mean [s], (axles,)."""
    told: Flags
    """Axles whose force is measured, (axles,)."""
    turning: Flags
    """Axles whose speed is measured, (axles,)."""
    coarse: Flags
    """Axles whose speed is rounded or counted, (axles,)."""
    own: Floats | None = None
    """Speed of each axle's car less the train's [m/s], (instants, axles)."""
    uphill: Floats | None = None
    """Deceleration by the gradient [m/s2], (instants,)."""
    filled: Flags = field(default_factory=lambda: np.zeros((0, 0), dtype=np.bool_))
    """What was unknown of the wheels, (instants, axles)."""
    remarks: list[Remark] = field(default_factory=list)

    @property
    def rotating(self) -> Floats:
        """Inertia of each wheelset at its rim [kg], (axles,)."""
        return self.train.inertia / self.train.radius**2

    @property
    def mass(self) -> float:
        """Of the train [kg], with wheelsets whose speed no channel tells."""
        return float(self.train.car_mass.sum() + self.rotating[~self.turning].sum())

    @property
    def dense(self) -> bool:
        """Whether the speed is measured at most instants."""
        z = self.fixes
        return z is not None and z.kind == "sampled" and z.time.size > 0.5 * self.time.size

    def against_train(self, i: int) -> Floats:
        """A wheel's speed less what its car has over the train, (instants,)."""
        return self.rim[:, i] if self.own is None else self.rim[:, i] - self.own[:, i]

    def guess(self) -> Floats:
        """The speed as measured, else the fastest wheel under braking and the slowest under traction."""
        if self.fixes is not None and self.fixes.kind == "sampled" and self.fixes.time.size > 2:
            return np.interp(self.time, self.fixes.time, self.fixes.value)
        high, low = np.full(self.time.size, -np.inf), np.full(self.time.size, np.inf)
        for i in np.flatnonzero(self.turning).tolist():
            own = self.against_train(i)
            np.fmax(high, own, out=high)
            np.fmin(low, own, out=low)
        share = np.clip(
            0.5 - evened(self.force.sum(1) / self.train.axle_load.sum(), 25) / 0.01, 0, 1
        )
        known = np.isfinite(high) & np.isfinite(low)
        v = share[known] * high[known] + (1 - share[known]) * low[known]
        return np.interp(self.time, self.time[known], v)

    def middle(self) -> Floats:
        """Median of the wheels [m/s], (instants,); of every 50 ms."""
        every = max(1, round(0.05 / usual_period(self.time)))
        time, rim = self.time[::every], self.rim[::every, self.turning]
        known = np.isfinite(rim).any(axis=1)
        return np.interp(self.time, time[known], np.nanmedian(rim[known], axis=1))

    def rows(self, some: slice) -> "Log":
        """That of some instants."""
        t = self.time[some]
        z = self.fixes
        if z is not None:
            near = (z.time >= t[0] - 2.0) & (z.time <= t[-1] + 2.0)
            z = z._replace(time=z.time[near], value=z.value[near])
        cut: dict[str, Any] = {name: None if (x := getattr(self, name)) is None else x[some]
               for name in ("rim", "force", "lost", "own", "uphill")}  # fmt: skip
        return replace(self, time=t, fixes=z, remarks=list(self.remarks), **cut)


def open_log(
    speed: Samples | None,
    wheels: dict[int, Samples],
    forces: dict[int, Samples],
    train: MeasuredTrain,
    rates: Sequence[Samples] = (),
) -> Log:
    """Channels by axle from 0 at the instants of the wheel that has most of them, rows that were lost among them.

    `rates`: accelerations of all cars [m/s2], or none.
    """
    t = max((w.time if w.steps is None else w.steps[0] for w in wheels.values()), key=len)
    dt = usual_period(t)
    step = np.diff(t)
    gaps = np.flatnonzero((step > max(1.5 * dt, BRIDGED)) & (step < LONGEST_FILLED))
    more = [np.arange(t[k] + dt, t[k + 1] - 0.5 * dt, dt) for k in gaps]
    lost = np.zeros(t.size, dtype=np.bool_)
    if more:
        added = np.concatenate(more)
        place = np.searchsorted(t, added)
        t, lost = (
            np.insert(t, place, added),
            np.insert(lost, place, np.ones(added.size, dtype=bool)),
        )
    axles = train.radius.size
    rim, force = np.full((t.size, axles), np.nan, order="F"), np.zeros((t.size, axles), order="F")
    noise, span, coarse = np.full(axles, 2e-4), np.zeros(axles), np.zeros(axles, dtype=np.bool_)
    for i, w in wheels.items():
        rim[:, i] = at(t, w, np.inf if w.kind == "quantised" else BRIDGED)
        rim[lost, i] = np.interp(t[lost], w.time, w.value)
        noise[i], span[i] = max(w.noise, 2e-4), 0.0 if w.kind == "quantised" else w.span
        coarse[i] = w.kind in ("quantised", "counted")
    for i, f in forces.items():
        if f.time.size > 1:
            force[:, i] = np.interp(t, f.time, f.value)
    own = None
    if rates and train.coupler is not None and min(r.time.size for r in rates) > 1:
        a = np.stack([np.interp(t, r.time, r.value) for r in rates], axis=1)
        own = np.nan_to_num(speeds_against_train(t, parts_of(t), a, train.car_mass))[
            :, train.axle_car
        ]
    told, turning = np.zeros(axles, dtype=np.bool_), np.zeros(axles, dtype=np.bool_)
    told[list(forces)], turning[list(wheels)] = True, True
    return Log(t, rim, force, speed, lost, train, noise, span, told, turning, coarse, own)


def parts_of(time: Floats) -> NDArray[np.int64]:
    """Number of the part, from gap to gap, that each instant belongs to."""
    step = np.diff(time)
    return np.concatenate(
        [[0], np.cumsum(step > max(LONGEST_FILLED, 1.5 * float(np.median(step))))]
    )


def turn_forces(log: Log, names: dict[int, str]) -> None:
    """Forces that would drive what they brake are turned round: all, then single ones."""
    v = log.guess()
    rate, total = rate_of(log.time, v, 50), log.force.sum(1)
    if rate @ total < 0 and (rate - rate.mean()) @ (total - total.mean()) < 0:
        log.force *= -1.0
        total = -total
        text = "all forces drive what brakes, by the train's momentum: turned round"
        log.remarks.append(Remark("sign", "axleN_force", text))
    for i in np.flatnonzero(log.told).tolist():
        one = log.force[:, i] / log.train.axle_load[i]
        other = total / log.train.axle_load.mean() - one
        alike = one @ other / max(np.sqrt((one @ one) * (other @ other)), 1e-12)
        if alike < -0.8 and log.force[:, i] @ np.nan_to_num(log.rim[:, i] - v) < 0:
            log.force[:, i] *= -1.0
            text = "against all others, and its wheel says so: turned round"
            log.remarks.append(Remark("sign", names[i], text))


def find_dead_zone(log: Log, v: Floats) -> None:
    """Wheels whose sensors say 0 below a speed are unknown there, but those that slid into it have locked."""
    found, zeros = [], {}
    for i in np.flatnonzero(log.turning).tolist():
        size = np.abs(np.nan_to_num(log.rim[:, i]))
        zeros[i] = spans(size < 0.01)
        ends = zeros[i][zeros[i] % size.size != 0] if zeros[i].size else np.zeros(0, dtype=int)
        found.append(np.maximum(size[ends], size[ends - 1]))
    jumps = np.concatenate(found) if found else np.zeros(0)
    if jumps.size < 4 or np.median(jumps) < 0.2:
        return
    bound = float(np.quantile(jumps, 0.2))
    if np.mean(jumps < 1.3 * bound) < 0.3:
        return
    stands = between = 0
    for i in zeros:  # such a sensor never says a part of that speed, and wheels that lock do
        size = np.abs(np.nan_to_num(log.rim[:, i]))
        stands += int(np.count_nonzero(size < 0.01))
        between += int(np.count_nonzero((size > 0.1 * bound) & (size < 0.8 * bound)))
    if between > 0.2 * stands:
        return
    unknown = False
    for i, stretches in zeros.items():
        size = np.abs(np.nan_to_num(log.rim[:, i]))
        for a, b in stretches:
            ends = [size[k] for k in (a - 1, b) if 0 <= k < size.size]
            if any(0.15 < x < 1.3 * bound for x in ends) and not (a > 0 and v[a] > 1.5 * bound):
                log.rim[a:b, i] = np.nan
                unknown = True
    if unknown:
        text = f"all wheels say 0 below {bound:.2g} m/s: filled in there"
        log.remarks.append(Remark("stuck", "axleN_speed", text))


def find_stuck(log: Log, names: dict[int, str]) -> None:
    """Wheels that stay exactly the same while the train does not are unknown there; a braked one at rest has locked."""
    others = np.nan_to_num(log.middle())
    if log.fixes is not None and log.fixes.time.size > 1:
        others = np.maximum(others, np.interp(log.time, log.fixes.time, log.fixes.value))
    t, under_way = log.time, others > 0.5
    for i in np.flatnonzero(log.turning).tolist():
        own = log.rim[:, i]
        dead = under_way.any() and np.mean(own[under_way] == 0.0) > 0.95
        same = np.append(np.abs(np.diff(own)) < 1e-12, False)
        for a, b in spans(same & (others > 0.3)):
            if t[b] - t[a] < 0.9 or np.ptp(others[a : b + 1]) < 0.3 or log.lost[a:b].any():
                continue
            stands = abs(own[a]) <= 0.01
            if log.coarse[i] and not stands:
                continue
            when = f"{t[a]:.6g} s to {t[b]:.6g} s"
            load, acting = log.train.axle_load[i], log.force[max(a - 10, 0) : a + 1, i]
            # neither brake nor rail brings a wheelset to rest from one row to the next
            at_once = a > 0 and log.rotating[i] * (own[a - 1] - own[a]) > (
                np.abs(acting).max() + load
            ) * (t[a] - t[a - 1])
            braked = np.mean(log.force[a:b, i]) < -5e-3 * load
            if stands and braked and not (dead or at_once):
                text = f"zero while the train runs: a locked wheel, and taken for one, {when}"
            else:
                own[a : b + 1] = np.nan
                text = f"stuck while the train's speed changes: filled in, {when}"
            log.remarks.append(Remark("stuck", names[i], text, int(a) + 1, float(t[a])))


def leave_out_stuck_speed(log: Log, name: str) -> None:
    """Leave out the speed's samples where it stays the same while the wheels do not."""
    z = log.fixes
    if z is None or z.time.size < 5:
        return
    wheels, keep = np.interp(z.time, log.time, log.middle()), np.ones(z.time.size, dtype=np.bool_)
    for a, b in spans(np.append(np.diff(z.value) == 0.0, False)):
        if z.time[b] - z.time[a] > 1.0 and b - a > 3 and np.ptp(wheels[a : b + 1]) > 0.5:
            keep[a : b + 1] = False
            text = f"stuck while the wheels' speeds change: left out, {z.time[a]:.6g} s to {z.time[b]:.6g} s"
            log.remarks.append(Remark("stuck", name, text, None, float(z.time[a])))
    if not keep.all():
        log.fixes = z._replace(time=z.time[keep], value=z.value[keep])


def check_units(log: Log, v: Floats, source: str) -> None:
    """Raise `Faulty` where the momentum over a second, beside a gradient and the air, says that units were mixed up."""
    t = log.time
    given = integral(t, log.force.sum(1) / log.mass)
    gained = v.copy()
    for i in np.flatnonzero(log.turning).tolist():
        own = log.rim[:, i]
        gained += np.where(np.isfinite(own), own, v) * (log.rotating[i] / log.mass)
    k = np.searchsorted(t, np.arange(t[0], t[-1], 1.0))
    use = (v[k][1:] > 0.5) & (v[k][:-1] > 0.5)
    peak = (
        np.quantile(np.abs(log.force[:, log.told]), 0.999, axis=0) / log.train.axle_load[log.told]
    )
    high = float(peak.max()) if peak.size else 0.1
    g, unsure = 0.0, np.inf
    if use.sum() >= 8:
        beside = np.stack([np.diff(t[k]), v[k][1:] ** 2 / 1e3], axis=1)[use]
        y, x = (u - beside @ np.linalg.lstsq(beside, u, rcond=None)[0]
                for u in (np.diff(gained[k])[use], np.diff(given[k])[use]))  # fmt: skip
        power = max(float(x @ x), 1e-12)
        g = float(x @ y / power)
        unsure = float(np.sqrt(((y - g * x) ** 2).sum() / (y.size - 3) / power))
    wrong = [("force", name, factor) for name, factor in UNITS_OF_FORCE.items()]
    wrong += [("speed", name, 1.0 / factor) for name, factor in UNITS_OF_SPEED.items()]
    for what, name, factor in wrong:
        if abs(g / factor - 1.0) < 0.09 and unsure < 0.05 * factor:
            text = (
                f"by the train's momentum the {what}s are in {name}: say the unit in a mapping file"
            )
            raise faulty(source, f"axleN_{what}", None, text)
    if high > 1.0:
        text = f"forces of up to {high:.3g} axle loads at the rim; wrong unit?"
        axle = np.flatnonzero(log.told)[peak.argmax()] + 1
        column = "axleN_force" if (peak > 1.0).sum() > 1 else f"axle{axle}_force"
        raise faulty(source, column, None, text)


def bring_together(log: Log, v: Floats, names: dict[int, str]) -> bool:
    """Axles of a recorder that is late, by the wheels that roll; in place. Whether there are any."""
    t, load, a = log.time, log.train.axle_load, log.rim.shape[1]
    free = np.mean(np.abs(log.force) < 2e-3 * load, axis=0) > 0.95
    rate = rate_of(t, v, 25)
    some = np.flatnonzero((v > 0.3) & (np.abs(rate) > 0.3 * np.quantile(np.abs(rate), 0.9)))[::5]
    if some.size < 10:
        return False
    width = np.hypot(0.02, 2 * np.median(log.noise))
    rolls = [
        np.nan_to_num(log.rim[:, i] - 0.2 * (log.force[:, i] - log.rotating[i] * rate) / load[i])
        for i in range(a)
    ]

    def share(i: int, late: float) -> float:
        y = np.interp(t[some] + late, t, rolls[i]) - v[some]
        e = np.median(y / v[some])
        return float(
            np.mean(1 / (1 + ((y - (e if abs(e) > 2e-3 else 0.0) * v[some]) / width) ** 2))
        )

    grid = np.arange(-0.5, 0.501, 0.02)
    shares = np.array(
        [[share(i, late) if log.turning[i] else 0.0 for late in grid] for i in range(a)]
    )
    best, sure = grid[shares.argmax(1)], np.flatnonzero(shares.max(1) > 0.3)
    if sure.size < max(0.3 * a, 2):
        return False
    order = sure[np.argsort(best[sure], kind="stable")]
    k = int(np.argmax(np.diff(best[order]))) + 1
    early, later = order[:k], order[k:]
    if best[later[0]] - best[early[-1]] < 0.039 or min(early.size, later.size) < 0.2 * a:
        return False
    near = order[
        np.argmin(np.abs(np.arange(a)[:, None] - order), axis=1)
    ]  # those that do not tell: as the next one
    windows = np.lib.stride_tricks.sliding_window_view(
        np.pad(np.isin(near, later).astype(float), 3, "edge"), 7
    )
    block = np.median(windows, axis=1) > 0.5
    if np.count_nonzero(np.diff(block)) > 2 or not block.any():
        return False
    lates = []
    for group in (early, later):
        tell = group[free[group]] if free[group].any() else group
        late = float(np.median(best[tell]))
        for step in (0.01, 0.005, 0.002, 0.001, 5e-4):
            late = max(
                (late - step, late, late + step),
                key=lambda d: np.median([share(i, d) for i in tell[:6]]),
            )
        lates.append(late)
    late = lates[1] - lates[0]
    if later.size > 1.2 * early.size:
        block, late = ~block, -late
    inside = np.flatnonzero((t + late <= t[-1]) & (t + late >= t[0]))
    for i in np.flatnonzero(block):
        slip = np.interp(t + late, t, log.rim[:, i]) - v
        slip[inside[-1] + 1 :] = np.mean(slip[max(inside[-1] - 20, 0) : inside[-1] + 1])
        slip[: inside[0]] = np.mean(slip[inside[0] : inside[0] + 20])
        log.rim[:, i] = slip + v
        log.force[:, i] = np.interp(t + late, t, log.force[:, i])
    which = np.flatnonzero(block) + 1
    text = (
        f"axles {which[0]} to {which[-1]} are recorded {abs(late):.3f} s {'later' if late > 0 else 'earlier'} than the "
        "others: made up for, the end filled in"
    )
    log.remarks.append(Remark("delay", names.get(int(which[0]) - 1, "axleN_speed"), text))
    return True


FORGOTTEN = 60.0
"""Time [s] within which an error of an acceleration is forgotten, and with it that slack was run out: less would make wheels
that pull slip by that way again."""
UNSURE, UNKNOWN = 0.0015, 0.003
"""Standard deviation of the mean speed of a car over a start of 15 s [m/s], by accelerations at 10 ms, and by the train's
speed in its place: some 2 and 4 cm of slack."""
SLOWEST = 0.05
"""Time between two instants [s] above which the impacts that run slack out are missed."""


def speeds_against_train(
    time: Floats, part: NDArray[np.int64], rate: Floats, mass: Floats
) -> Floats:
    """Speed of each car less the train's [m/s], (instants, cars); nan where a car's acceleration lacks in a part.

    `rate` (instants, cars) [m/s2], `mass` (cars,) [kg].
    """
    from scipy.signal import lfilter  # slow to import, and needed for coupled trains alone

    apart = rate - (rate @ mass / mass.sum())[:, None]
    own = np.full(apart.shape, np.nan)
    if usual_period(time) > SLOWEST:
        return own
    for number in np.unique(part):
        inside = part == number
        if inside.sum() < 2 or not np.isfinite(apart[inside]).all():
            continue
        step = usual_period(time[inside])
        values = apart[inside] - apart[inside].mean(axis=0)
        gained = np.zeros(values.shape)
        gained[1:] = 0.5 * (values[1:] + values[:-1]) * step
        own[inside] = lfilter([1.0], [1.0, -np.exp(-step / FORGOTTEN)], gained, axis=0)
    return own


COARSE = 0.25
"""Sampling period [s] above which slips are missed."""
CONSTANT_TIME = 10.0
"""Time [s] for which a measured force never is exactly constant."""
OTHER_UNIT = 1.5
"""Factor between two speeds from which on their units differ: less than that between miles and kilometres."""


def check_instants(time: Floats) -> list[Remark]:
    """Gaps and uneven or coarse sampling of the common instants."""
    step = np.diff(time)
    period = float(np.median(step))
    wide = step > max(1.5 * period, BRIDGED)
    gaps = np.flatnonzero(wide)
    remarks = [
        Remark(
            "gap", "time", f"gap of {step[k]:.4g} s from {time[k]:.6g} s to {time[k + 1]:.6g} s",
            int(k) + 1, float(time[k]),
        )
        for k in gaps
    ]  # fmt: skip
    near = step[~wide]
    uneven = np.abs(near / period - 1.0) > 0.1
    if uneven.size and uneven.mean() > 0.01:
        remarks.append(
            Remark(
                "sampling", "time",
                f"uneven sampling: {100.0 * uneven.mean():.0f} % of the steps differ from {period:.4g} s by more than "
                f"10 % ({near.min():.4g} to {near.max():.4g} s); the times are used as they are",
            )
        )  # fmt: skip
    if period > COARSE:
        text = f"wheels every {period:.4g} s: short slips are missed"
        remarks.append(Remark("sampling", "time", text))
    return remarks


def check_constant(name: str, force: Floats, time: Floats) -> list[Remark]:
    """Whether a force has one and the same value, not zero, all the time."""
    if force.size == 0 or force[0] == 0.0 or not np.all(force == force[0]):
        return []
    if time[-1] - time[0] < CONSTANT_TIME:
        return []
    return [Remark("stuck", name, "the same value all the time: a dead channel, or a set value?")]


def check_ratio(name: str, rim: Floats, train_name: str, speed: Floats, source: str) -> None:
    """Raise where wheels and train differ all the time by a factor that no slip has: that between two units."""
    moving = np.isfinite(rim) & np.isfinite(speed) & (speed > 2.0)
    if moving.sum() < FEWEST_ROWS:
        return
    low, middle, high = np.quantile(excerpt(rim[moving] / speed[moving]), (0.25, 0.5, 0.75))
    if high - low >= 0.1 * middle or 1.0 / OTHER_UNIT < middle < OTHER_UNIT:
        return
    known = any(abs(middle / factor - 1.0) < 0.08 for factor in (3.6, 1.0 / 3.6))
    reason = (
        "km/h and m/s are mixed up"
        if known
        else "their units do not agree; say them in a mapping file"
    )
    raise faulty(
        source, name, None,
        f"{middle:.3g} times the train's speed in column {train_name!r} all the time: {reason}",
    )  # fmt: skip
