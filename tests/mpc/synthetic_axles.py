"""A unit whose axles run at a slip that is told, on a known curve: torque and speeds as its belief reads them."""

import numpy as np

from mpc.belief import UnitBelief
from mpc.settings import MpcSettings
from tests.mpc.conftest import make_unit


class SyntheticUnit:
    """Axles on rails of a known `curve`, with the torque that holds their slip: no dynamics but the wheelsets' inertia.

    `noise`: deviation of a speed sensor [m/s].
    """

    acceleration = 0.5
    air = 0.0
    """Coefficient that an air brake gives, of which the unit's own estimate knows."""

    def __init__(self, curve, peak=0.12, settings=None, noise=0.0, seed=0, speed=10.0, **context):
        # with so long a lag, torque changes evenly from reading to reading
        self.context = make_unit(**({"believed": curve, "torque_lag": 10.0} | context))
        self.settings = settings or MpcSettings()
        self.belief = UnitBelief(self.context, self.settings)
        self.curve, self.peak, self.noise = curve, peak, noise
        self.rng, self.speed = np.random.default_rng(seed), speed
        self.known = self.before = self.now = None
        """Slip of the period before and of this one [m/s]; none yet at first."""

    @property
    def search(self):
        """State of the search."""
        return self.belief.record.search.state[0]

    @property
    def believed(self):
        """State of the curve's filter."""
        return self.belief.record.curve.state[0]

    @property
    def swing(self):
        """Slip limit over its mean."""
        return self.belief.slip_limit / self.search.slip

    def coefficient(self, slip):
        """What the axles feel at `slip` [m/s]."""
        return self.curve.coefficient(slip, self.peak, self.speed)

    def period(self, slip, **reading):
        """A control period of readings; `slip` [m/s] of the axles a period later, one for all or (axles,)."""
        c = self.context
        after = np.broadcast_to(np.asarray(slip, dtype=float), (c.axles,))
        if self.now is None:
            self.before = self.now = after
        # torque is known at the instants of the readings: so must the rate be
        rate = self.acceleration + 0.5 * (after - self.before) / c.period
        force = self.coefficient(self.now) * self.belief.axle_load * c.radius
        shoes = self.air * self.belief.axle_load * c.radius
        torque = float(np.mean(force - shoes + c.inertia * rate / c.radius)) / c.gear_ratio
        if self.air:
            # by the unit's observer, as late as those of the axles
            felt, share = (
                float(np.mean(self.coefficient(self.now))),
                self.belief.record.constants.keep,
            )
            self.known = felt if self.known is None else share * self.known + (1.0 - share) * felt
            reading = {"estimate": self.known} | reading
        rim = self.speed + self.now + self.noise * self.rng.standard_normal(c.axles)
        self.belief.update(self.speed, rim / c.radius, torque, **reading)
        self.before, self.now = self.now, after
        self.speed += self.acceleration * c.period
