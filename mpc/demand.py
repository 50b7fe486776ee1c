"""How much of a demand that the rail does not carry the cost tracks.

The limit of slip is soft. The further a demand lies above what the rail carries, the more it pulls slip beyond the limit: a
locomotive that is asked for five times its adhesion stood at one and a half times the slip sought on a narrow peak, beyond
the peak believed, and its slip no longer followed the search. At rest, the pull of the torque t that is tracked and that of
the slip s beyond its limit balance. In coefficients mu of the motors' torque, with the torque scale's coefficient c,

    tracking (t - mu) / c^2 = slip (excess / slip scale^2) ds / dmu,    ds / dmu >= s / mu,

for curves bend down. So slip exceeds its limit by no more than the share `EXCESS` if

    t <= mu + EXCESS (slip / tracking) (c s / slip scale)^2 / mu.

On wide peaks this is more than any demand. Source: this project.
"""

from alloc.compilation import equation

EXCESS = 0.1
"""Share of the slip limit by which a demand may pull slip beyond it."""

LEAST = 1e-3
"""Least coefficient that is believed to be carried here: where there is none, all demand is tracked."""


@equation
def tracked_coefficient(held, slip, scale, tracking, penalty, slip_scale):
    """Largest coefficient that is tracked where the rail carries `held` at the `slip` limit [m/s].

    `scale`: coefficient of the torque scale; `tracking`, `penalty` and `slip_scale` [m/s]: those of `mpc.cost.CostWeights`.
    """
    carried = held if held > LEAST else LEAST
    part = scale * slip / slip_scale
    return carried + EXCESS * penalty / tracking * part * part / carried
