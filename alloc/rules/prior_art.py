"""What JP5484215 compares itself with: units left alone, a preset pattern, dynamic sharing."""

from alloc.compilation import jit


@jit
def alone_limits(expected, limit_max, limit_out):
    """Every unit keeps the plan, within its torque limit; only its own readhesion control acts."""
    for j in range(limit_out.size):
        limit_out[j] = min(expected, limit_max[j])


@jit
def preset_limits(expected, mass, limit_max, moved, limit_out):
    """A fixed part of the front's effort moved to the rear whatever happens (JP H05-276606, patent par. 0007).

    Linear along the train with the plan as its mean, weighted with mass: of n equal units the foremost stands at
    (1 - moved) expected and the rearmost at (1 + moved) expected.
    """
    n = limit_out.size
    spacing = 2.0 / (n - 1) if n > 1 else 0.0
    total, moment = 0.0, 0.0
    for j in range(n):
        total += mass[j]
        moment += mass[j] * spacing * j
    centre = moment / total
    for j in range(n):
        limit_out[j] = min(expected * (1.0 + moved * (spacing * j - centre)), limit_max[j])


@jit
def sharing_limits(
    expected, mass, limit_max, previous, delivered, gain, tolerance, limit_out
):  # fmt: skip
    """One step of dynamic sharing (JP 4225233, patent par. 0007 and 0009); to be repeated with every telegram.

    A unit is short if it delivers less than its limit by more than `tolerance` of the plan. What the train lacks
    against the plan is handed in equal parts to the units that are not short, and a limit that is not reached is
    lowered towards what is delivered; both by the share `gain` per step. A negative estimate counts as nothing delivered.
    `limit_out` may be the same array as `previous`.
    """
    lacking, able = 0.0, 0.0
    for j in range(limit_out.size):
        got = max(delivered[j], 0.0)
        lacking += mass[j] * (expected - got)
        if previous[j] - got <= tolerance * expected:
            able += mass[j]
    handed = gain * lacking / able if able > 0.0 else 0.0
    for j in range(limit_out.size):
        over = max(previous[j] - max(delivered[j], 0.0), 0.0)
        limit = previous[j] - gain * over
        if over <= tolerance * expected:
            limit += handed
        limit_out[j] = min(max(limit, 0.0), limit_max[j])
