"""Radii of a log's wheels by those that roll freely: what differs from the train file is made up for, and said."""

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.series import excerpt
from studies.logs.common_instants import Instants
from studies.logs.known_train import MeasuredTrain
from studies.logs.remarks import Remark
from studies.logs.rolling_wheels import Rolling, rolling_wheel
from studies.logs.speed_shape import rolls_always
from studies.logs.told_channels import FEWEST_ROWS
from studies.logs.train_speed import MeasuredSpeed

Floats = NDArray[np.float64]

LEAST, MOST = 0.002, 0.12
"""Error of a radius, as a share, from which on it is made up for; more than a wheel wears in its life is another fault."""
SURE = 5.0
"""Number of deviations from which on it is not due to chance."""
ALIKE = 0.001
"""Difference of the errors of all wheels up to which the scale of the train's speed is wrong, and no radius."""
LEAST_LATE = 0.03
"""Delay of a wheel [s] that is remarked on."""
AGAINST = 0.005
"""Share by which a wheel that always pulls or brakes creeps the wrong way, if its radius is wrong."""
PULLS = 0.01
"""Force over load above which a wheel pulls or brakes."""
SLOW, SELDOM, MORE = 2.0, 0.02, 0.01
"""Speed [m/s] from which on such a wheel is looked at, share of the time for which it creeps least, and by what it may creep
more then than the others do."""


def make_up_for_radii(
    names: dict[int, str],
    instants: Instants,
    speed: MeasuredSpeed,
    rim: Floats,
    force: Floats,
    train: MeasuredTrain,
    of_train: str,
    rim_deviation: Floats,
) -> list[Remark]:
    """Rim speeds, in place, as fast as the train where wheels roll freely; `of_train`: column of the train's speed.

    If all wheels that roll freely have the same error, it is that of the train's speed, and wheels that never do share it. A
    wheel that rolls all the time is surer than a speed that is followed between measurements: then it counts however small.
    """
    found: dict[int, Rolling] = {}
    remarks: list[Remark] = []
    creeps: dict[int, float] = {}
    for number, name in names.items():
        share = force[:, number - 1] / train.axle_load[number - 1]
        own = rim[:, number - 1]
        of_wheel = float(rim_deviation[number - 1])
        one = rolling_wheel(instants.time, speed.speed, own, share, speed.deviation, of_wheel)
        if one is None:
            creep = _creeps(own, speed.speed, share)
            if creep.size >= FEWEST_ROWS:
                unsure = 2.0 * float(np.nanmedian(speed.deviation)) / SLOW
                remarks += _against_force(name, creep, share, unsure)
                creeps[number] = float(np.quantile(creep, SELDOM))
            continue
        if abs(one.late) > max(LEAST_LATE, SURE * one.late_deviation):
            how = f"{abs(one.late):.2f} s {'later' if one.late > 0.0 else 'earlier'}"
            text = (
                f"recorded {how} than the train's speed, by where it rolls freely: not made up for"
            )
            remarks.append(Remark("delay", name, text))
        found[number] = one
    remarks += _beside_others(names, creeps)
    errors = np.array([one.error for one in found.values()])
    middle = float(np.median(errors)) if errors.size else 0.0
    alike = errors.size > 1 and np.ptp(errors) < ALIKE
    surer = alike and speed.followed and abs(middle) < MOST
    if surer:
        rolling = rolls_always(force, train.axle_load)
        surer = any(rolling[k - 1] for k in found)
    if surer or (alike and _is_wrong(*_least_sure(found))):
        for number in names:
            rim[:, number - 1] /= 1.0 + middle
        if abs(middle) < LEAST:
            return remarks
        how = f"{100.0 * abs(middle):.1f} % {'faster' if middle > 0.0 else 'slower'}"
        text = f"all wheels turn {how} than the train where they roll freely: its scale, or all radii; made up for"
        return [r for r in remarks if r.kind != "radius"] + [Remark("radius", of_train, text)]
    for number, one in found.items():
        if _is_wrong(one.error, one.deviation):
            rim[:, number - 1] /= 1.0 + one.error
            how = f"{100.0 * abs(one.error):.1f} % {'faster' if one.error > 0.0 else 'slower'}"
            text = f"turns {how} than the train where it rolls freely: its radius, made up for"
            remarks.append(Remark("radius", names[number], text))
    return remarks


def _least_sure(found: dict[int, Rolling]) -> tuple[float, float]:
    """The middle error, and the greatest deviation."""
    errors = [one.error for one in found.values()]
    return float(np.median(errors)), max(one.deviation for one in found.values())


def _is_wrong(error: float, deviation: float) -> bool:
    return max(LEAST, SURE * deviation) < abs(error) < MOST


def _creeps(rim: Floats, speed: Floats, share: Floats) -> Floats:
    """By what share a wheel that pulls or brakes is faster or slower than the train, as its force makes it."""
    used = (speed > SLOW) & np.isfinite(rim) & (np.abs(share) > PULLS)
    creep = np.sign(share[used]) * (rim[used] / speed[used] - 1.0)
    return excerpt(np.asarray(creep))


def _against_force(name: str, creep: Floats, share: Floats, unsure: float) -> list[Remark]:
    """Whether a wheel that always pulls or brakes creeps the other way: a braked one is never faster than the train."""
    error = -float(np.quantile(creep, 0.25))
    if error <= AGAINST + unsure:
        return []
    braked = float(np.nanmedian(share)) < 0.0
    text = (
        f"turns {100.0 * error:.1f} % {'faster' if braked else 'slower'} than the train although it "
        f"{'is braked' if braked else 'pulls'}: wheel radius or scale of a speed; Q and slips contain that"
    )
    return [Remark("radius", name, text)]


def _beside_others(names: dict[int, str], creeps: dict[int, float]) -> list[Remark]:
    """Wheels that always pull or brake, and never creep as little as the others do at times."""
    remarks = []
    for number, creep in creeps.items():
        more = creep - float(
            np.median([other for k, other in creeps.items() if k != number] or [creep])
        )
        if more > MORE:
            text = (
                f"never creeps by less than {100.0 * creep:.1f} %, {100.0 * more:.1f} % more than the others: its radius, "
                "or a slip without an end; Q and slips contain that"
            )
            remarks.append(Remark("radius", names[number], text))
    return remarks
