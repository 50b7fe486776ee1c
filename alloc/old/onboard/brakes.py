"""Brakes on board: torque and air blended, slide protection by valves, sanding.

In: limits, readings and parameters. Out: the units' torque targets, cylinder pressures, valve actions, sand.
"""

import math
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.old.compilation import inlined_jit
from alloc.old.errors import OnboardError
from alloc.old.onboard.laws import (
    HOLD,
    RELEASE,
    SUPPLY,
    believed_shoe_force,
    differentiate,
    differentiator_gain,
    empty_torque_limit,
    infer,
    load_compensated,
    valve_action,
)
from alloc.old.plant.laws import GRAVITY, slip_ratio
from alloc.old.plant.model import Floats
from alloc.old.records import numbers_of, quantity

# Wheel slide protection of the air brakes: what a bogie's supply and release valve do while its wheels slide.
#
# Each car has a computer of its own that decides for every bogie. The laws are `threshold` (switching points of the
# slip ratio) and `fuzzy` (rules on slip and its rate); `protect` runs the one that a train has, and its safeguards.


NONE, THRESHOLD, FUZZY = range(3)
"""Identifiers in compiled code."""

LAWS: dict[str, int] = {"none": NONE, "threshold": THRESHOLD, "fuzzy": FUZZY}
"""Laws by name, from the simplest on."""


# Parameters of the wheel slide protection. SI units; what no source prints is "assumed" or calibrated.


SENSITIVITIES: dict[str, float] = {"low": 0.915, "medium": 1.0, "high": 3.1374}
"""Detection sensitivities of JP4209318, Table 4, as numbers for `Fuzzy.sensitivity`; calibrated with its sets."""


def _check_growing(name: str, knots: tuple[float, float, float]) -> None:
    numbers = all(isinstance(x, (int, float)) and math.isfinite(x) for x in knots)
    if len(knots) != 3 or not numbers or not knots[0] < knots[1] < knots[2]:
        raise OnboardError(
            f"fuzzy slide protection: {name} = {knots} must be three growing numbers"
        )


@dataclass(frozen=True)
class Threshold:
    """Plain switching points of the slip ratio.

    Source: assumed.
    """

    release: float = quantity(0.15, "1")
    """Slip ratio above which a bogie's pressure is released."""
    hold: float = quantity(0.08, "1")
    """Slip ratio above which a bogie's pressure is held, at most `release`."""

    def __post_init__(self) -> None:
        OnboardError.check("threshold slide protection", self, positive=("release", "hold"))
        OnboardError.check_order("threshold slide protection", self, "hold", "release", equal=True)


@dataclass(frozen=True)
class Fuzzy:
    """Fuzzy inference on slip and slip rate; the rules are `alloc.old.onboard.laws.RULES`.

    JP4209318 discloses neither rules nor sets. These are one of several sets of numbers with which
    `studies.jp4209318` reaches its tables.

    Source: JP4209318; assumed, one of many sets that reach its tables.
    """

    sensitivity: float = quantity(SENSITIVITIES["medium"], "1", SENSITIVITIES)
    """Detection sensitivity: at 2 every set is at half its slip and rate. Low, medium and high are those of JP4209318, Table
    4."""
    slip: tuple[float, float, float] = quantity((0.0, 0.077716, 0.17027), "1")
    """Increasing slip ratios at which the sets small, medium and large peak."""
    rate: tuple[float, float, float] = quantity((-3.5912, 0.0, 3.5912), "km/h/s")
    """Increasing slip accelerations at which the sets falling, steady and growing peak [m/s2]."""
    pole: float = quantity(6.6789, "1/s")
    """Pole of the filter that differentiates the slip [1/s]."""

    def __post_init__(self) -> None:
        OnboardError.check("fuzzy slide protection", self, positive=("sensitivity", "pole"))
        _check_growing("slip", self.slip)
        _check_growing("rate", self.rate)


@dataclass(frozen=True)
class SlideProtection:
    """Wheel slide protection of a train's air brakes, one computer per car, a pair of valves per bogie.

    Slip is measured from the train's reference speed; its estimator may ask for a bogie to be released for a moment. An axle
    that stands while its car runs is released.

    Source: assumed, as usual.
    """

    law: Literal["none", "threshold", "fuzzy"] = "threshold"
    """Law that moves the valves. Source: fuzzy is that of JP4209318; threshold is this project's."""
    threshold: Threshold = field(default_factory=Threshold)
    """Numbers of the law threshold."""
    fuzzy: Fuzzy = field(default_factory=Fuzzy)
    """Numbers of the law fuzzy."""
    period: float = quantity(0.01, "s")
    """Period of its decisions, rounded to control periods [s]."""
    cut_out_speed: float = quantity(5.0 / 3.6, "km/h")
    """Speed below which the valves do not act [m/s]."""
    time_out: float = quantity(10.0, "s")
    """A valve that has not supplied for this time supplies for `refill`, whatever the law says: sliding wheels must not make
    a train lose its brakes for good [s]."""
    refill: float = quantity(0.5, "s")
    """Time for which it then supplies [s]."""

    def __post_init__(self) -> None:
        OnboardError.check(
            "slide protection",
            self,
            ("period", "time_out", "refill"),
            ("cut_out_speed",),
        )
        OnboardError.check_choice("slide protection", "law", self.law, LAWS)


# Input of the slide protection of a run, and its memory.


class SlideMemory(NamedTuple):
    """What the cars' computers remember."""

    filtered: Floats  # (axles,) slip behind the differentiator's filter [m/s]
    locked: NDArray[np.bool_]  # (axles,) stands while its car runs
    severity: Floats  # (groups,) action that the worst axle asks for, before it is rounded
    action: Floats  # (groups,) of the valves until the next decision
    away: Floats  # (groups,) time since the valve last supplied [s]
    refill: Floats  # (groups,) time that it must still supply [s]


def slide_settings(protection: SlideProtection, period: float) -> Any:
    """Numbers for a control period [s]; a decision is taken `every` so many, the protection's `period` rounded."""
    every = max(1, round(protection.period / period))
    fuzzy = protection.fuzzy
    return numbers_of(
        protection,
        law=LAWS[protection.law],
        every=every,
        period=float(every * period),
        fuzzy=numbers_of(
            fuzzy,
            slip=np.array(fuzzy.slip, dtype=float),
            rate=np.array(fuzzy.rate, dtype=float),
            gain=differentiator_gain(fuzzy.pole, every * period),
        ),
    )


def slide_memory(axles: int, groups: int) -> SlideMemory:
    """Memory at the start of a run."""
    return SlideMemory(
        np.zeros(axles), np.zeros(axles, dtype=np.bool_),
        *(np.zeros(groups) for _ in range(4)),
    )  # fmt: skip


# The decisions of the cars' slide protection: the law on every axle, safeguards, the valves.


LOWEST_SPEED = 1.0
"""Smallest speed [m/s] that slip ratios are relative to."""

STANDING_SPEED = 0.1
"""Rim speed [m/s] below which an axle counts as standing; sensors see no less."""


@inlined_jit
def _severity(p, ratio, rate):
    """What the law asks for at one axle: `SUPPLY` to `RELEASE`."""
    if p.law == FUZZY:
        return infer(ratio, rate, p.fuzzy.sensitivity, p.fuzzy.slip, p.fuzzy.rate)
    if p.law == THRESHOLD:
        if ratio > p.threshold.release:
            return RELEASE
        return HOLD if ratio > p.threshold.hold else SUPPLY
    return SUPPLY


@inlined_jit
def _ask_axles(eq, p, m):
    """The worst axle of each bogie asks for its valves' action; a standing one asks for release."""
    k = m.slide
    for g in range(k.severity.size):
        k.severity[g] = SUPPLY
    for i in range(m.axle_omega.size):
        g = eq.axle_group[i]
        if g < 0:
            continue
        reference = m.reference[eq.axle_body[i]]
        rim = eq.axle_radius[i] * m.axle_omega[i]
        slip = max(reference - rim, 0.0)
        k.filtered[i], rate = differentiate(k.filtered[i], slip, p.fuzzy.pole, p.fuzzy.gain)
        asked = _severity(p, slip_ratio(slip, reference, rim, LOWEST_SPEED), rate)
        stands = rim < STANDING_SPEED and reference > p.cut_out_speed
        if stands and not k.locked[i]:
            m.counter.locks[0] += 1
        k.locked[i] = stands
        if stands and p.law != NONE:
            asked = RELEASE
        k.severity[g] = max(k.severity[g], asked)


@inlined_jit
def _decide(eq, p, m, g):
    """Action of the valves of group `g` until the next decision."""
    k = m.slide
    action = valve_action(k.severity[g])
    if m.estimate.relief.group[0] == g and p.law != NONE:
        action = RELEASE
    if m.reference[eq.group.body[g]] < p.cut_out_speed:
        action = SUPPLY
    k.away[g] = 0.0 if action == SUPPLY else k.away[g] + p.period
    if k.away[g] > p.time_out:
        m.counter.time_outs[0] += 1
        k.refill[g], k.away[g] = p.refill, 0.0
    if k.refill[g] > 0.0:
        k.refill[g] -= p.period
        k.away[g] = 0.0
        action = SUPPLY
    k.action[g] = action


@inlined_jit
def protect(eq, st, m, tick, braking, valve):
    """Fill `valve` (groups,) with the actions of all bogies; everything rests while the air brakes do."""
    p, k = st.brakes.slide_protection, m.slide
    if not braking:
        for i in range(k.filtered.size):
            k.filtered[i], k.locked[i] = 0.0, False
        for g in range(k.action.size):
            k.action[g] = k.away[g] = k.refill[g] = 0.0
    elif tick % p.every == 0:
        _ask_axles(eq, p, m)
        for g in range(k.action.size):
            _decide(eq, p, m, g)
    for g in range(k.action.size):
        valve[g] = k.action[g]


# When a train sands: on slip or slide after a delay, and by the driver's command; and how much each sander lays.


@dataclass(frozen=True)
class Sanding:
    """When the train's sanders work, all alike.

    Source: assumed.
    """

    on_slide: bool = True
    """They begin on a sign of sliding: a valve of the slide protection leaves supply, or a unit's slip signal comes on,
    anywhere in the train."""
    delay: float = quantity(1.0, "s")
    """Time from the sign, or from the driver's command, to the sand [s]."""
    hold: float = quantity(5.0, "s")
    """Time from the last such sign to the end of sanding [s]."""
    begin: float = quantity(math.inf, "s")
    """Instant from which the driver commands sand [s]. Left out: the driver commands none."""
    until: float = quantity(math.inf, "s")
    """Instant at which the driver's command ends [s]. Left out: it does not end."""
    least_speed: float = quantity(16.0 / 3.6, "km/h")
    """Below this speed no sand is laid [m/s]. Source: GM/RT2461, 7.5 g/m per rail where a train comes to rest, which 2
    kg/min would exceed."""

    def __post_init__(self) -> None:
        OnboardError.check("sanding", self, nonnegative=("delay", "hold", "begin", "least_speed"))
        OnboardError.check_order("sanding", self, "begin", "until", equal=True)


class SandingMemory(NamedTuple):
    """When the present slide, or the last one, was first and last seen [s], (1,) each."""

    first: Floats
    last: Floats


class Sanders(NamedTuple):
    """The train's sanders, (sanders,) each."""

    body: NDArray[np.int64]  # whose speed a sander knows
    rate: Floats  # [kg/s], the greatest
    amount: Floats  # [kg/m]; inf: of fixed rate


@inlined_jit
def _slides(m):
    """Whether any wheel is seen to slide or slip."""
    found = False
    for g in range(m.slide.action.size):
        found = found or m.slide.action[g] != SUPPLY
    for j in range(m.unit.slipping.size):
        found = found or m.unit.slipping[j] > 0.0
    return found


@inlined_jit
def command_sand(eq, st, m, time, rate):
    """Fill `rate` (sanders,) [kg/s]: fixed, or what lays the sander's amount at the reference speed."""
    s, k = st.sanding, m.sanding
    if s.on_slide and _slides(m):
        if time - k.last[0] > s.hold:
            k.first[0] = time
        k.last[0] = time
    asked = time - k.last[0] <= s.hold and time - k.first[0] >= s.delay
    asked = asked or s.begin <= time - s.delay < s.until
    for i in range(rate.size):
        speed = abs(m.reference[eq.sander.body[i]])
        wanted = min(eq.sander.rate[i], eq.sander.amount[i] * speed)
        rate[i] = wanted if asked and speed >= s.least_speed else 0.0


# From the units' limits to their torque targets and the brakes' cylinder pressures.
#
# Driving and without blended brakes: limits (6) and (6') of JP5484215, load compensation, the motor's limit. Blended
# braking, embodiment 3: the electric brake comes first, and the air brake supplies what the line does not take. The air
# brake of a unit that receives limits fills up to the limit in the same way. Its motors do not follow the pattern then
# (par. 0078): they brake with the limit less the air brake's force, and so make up at once for the lag of the
# cylinders. The air brake makes up for what the line or failed motors lack. What readhesion control takes away it does
# not fill, and in the end it gives way too.


MIDDLE = 0.5
"""Share of their torque that readhesion control leaves the motors, below which the air brake gives way."""

LEAST_GAIN = 1e-9
"""Shoe force over pressure [N/Pa] below which a brake is asked for all its pressure: it gives nothing."""

EASE_TIME = 1.0
"""Integral time [s] of that."""


@inlined_jit
def set_targets(eq, st, m, commanded):
    """Torque target of each unit: (6) and (6') plus its wheelsets' inertia, within the motor's limit, with bounded rise."""
    sign = 1.0 if commanded >= 0.0 else -1.0
    for j in range(eq.axles.size):
        limit = m.unit.limit[j] if commanded != 0.0 else 0.0
        empty = empty_torque_limit(limit, eq.empty_axle_mass[j], eq.radius[j], eq.gear[j])
        share = 1.0 + eq.own_inertia[j]
        wanted = share * load_compensated(empty, eq.empty_axle_mass[j], eq.load_per_axle[j])
        planned = m.train.expected[0] * (eq.empty_axle_mass[j] + eq.load_per_axle[j])
        step = share * planned * GRAVITY * eq.radius[j] / eq.gear[j] * st.period / st.rise_time
        bound = m.drive_limit[j] if sign > 0.0 else m.brake_limit[j]
        m.rise[j] = min(min(wanted, bound), m.rise[j] + step) if commanded != 0.0 else 0.0
        m.unit.torque_target[j] = sign * m.rise[j]
        m.unit.air_brake_force[j] = 0.0
        m.taken[j] = np.inf
        m.kept[j] = 1.0
    m.lead.brake_rise[0] = 0.0


@inlined_jit
def _share_of_motors(st, m, j, pattern, full):
    """Torque that unit `j` asks of its motors: what the line takes of the `pattern`; `full` is that of the whole plan."""
    if not m.in_service[j]:
        m.taken[j] = 0.0
        return 0.0
    electric = max(-m.torque[j], 0.0)
    # what the line turns out to take the motors take over slowly, for cylinders empty slowly
    slow = full * st.period / st.brakes.blend_time
    # less than foreseen: the line does not take it, or motors have failed. Their lag, what the unit's own readhesion control
    # takes away and a relief are foreseen
    if min(-m.foreseen[j], pattern, m.brake_limit[j]) > electric + 2.0 * slow:
        m.taken[j] = electric
    m.taken[j] = max(m.taken[j], electric + slow)
    return min(pattern, m.brake_limit[j], m.taken[j])


@inlined_jit
def _share_of_air(st, m, j, motors):
    """Share of its part that the air brake of unit `j` keeps: it gives way while readhesion control has little torque left.

    Mid-ranging control: the slow air brake leaves the fast motors room on both sides. Else it could hold wheels in a slide
    that no cut of torque ends.
    """
    left = -m.unit.torque_command[j] / motors if motors > 0.0 else 1.0
    m.kept[j] = min(max(m.kept[j] + (left - MIDDLE) * st.period / EASE_TIME, 0.0), 1.0)
    return m.kept[j]


@inlined_jit
def set_brake_targets(eq, st, m):
    """Torque targets and air brake forces of the units while the train brakes."""
    expected = m.train.expected[0]
    air = m.unit.air_brake_force
    for j in range(eq.axles.size):
        to_torque = (1.0 + eq.brake_inertia[j]) * eq.axle_load[j] * eq.radius[j] / eq.gear[j]
        at_rim = eq.gear[j] / eq.radius[j]
        step = expected * to_torque * st.period / st.rise_time
        m.rise[j] = min(m.unit.limit[j] * to_torque, m.rise[j] + step)
        pattern = m.rise[j]
        motors = _share_of_motors(st, m, j, pattern, expected * to_torque)
        air[j] = _share_of_air(st, m, j, motors) * (pattern - motors) * at_rim
        if np.isfinite(m.received[j]) and m.in_service[j]:
            motors = max(pattern - m.air_force[j] / at_rim, 0.0)
        m.unit.torque_target[j] = -min(motors, m.brake_limit[j])
    m.lead.brake_rise[0] = min(m.lead.brake_rise[0] + st.period / st.rise_time, 1.0)


@inlined_jit
def foresee_torque(eq, m, j, applied):
    """Torque that the motors of unit `j` would have in the next period under the command `applied` [N m] to the inverter."""
    m.foreseen[j] += eq.response[j] * (applied - m.foreseen[j])


@inlined_jit
def restrain_blind_units(st, m):
    """A unit that knows the speed of none of its axles could not notice slip: it gets a part of its target."""
    for j in range(m.unit.torque_target.size):
        if m.unit.axles_seen[j] == 0.0:
            m.unit.torque_target[j] *= st.sensors.blind_share


@inlined_jit
def brake_receiver(eq, st, m, tick, braking, pressure, valve):
    """Cylinder pressures [Pa] and valves of every brake group: force wanted of it, and its slide protection.

    `pressure`, `valve` (groups,) are filled. A trailer follows the plan by air alone.
    """
    protect(eq, st, m, tick, braking, valve)
    for g in range(eq.group.unit.size):
        if not braking:
            pressure[g] = m.estimate.full[g] = 0.0
            continue
        reference = max(m.reference[eq.group.body[g]], LOWEST_SPEED)
        unit = eq.group.unit[g]
        if unit >= 0:
            force = m.unit.air_brake_force[unit]
        else:
            planned = eq.group.share[g] * m.train.expected[0] * m.lead.brake_rise[0]
            force = planned * eq.group.weight[g] * (1.0 + eq.group.inertia[g])
            force = min(force, m.air_most[g] * (1.0 + eq.group.inertia[g]))
        # of wheels that roll: one that slides must not lower the pressure of the others
        per_pascal = max(believed_shoe_force(eq.group, g, 1.0, reference), LEAST_GAIN)
        pressure[g] = min(force / per_pascal, eq.group.pressure[g])
        m.estimate.full[g] = pressure[g]
