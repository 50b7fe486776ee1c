"""A readhesion controller of one's own: torque falls in proportion to the slip velocity beyond a threshold."""

from alloc.onboard.host import CONTROLLERS, HostedController, TorqueDecision, each_unit

THRESHOLD, WIDTH = 0.1, 0.3
"""Slip velocity [m/s] up to which the target stands, and over which it falls to zero."""


class SlipLimit:
    """Controller of one unit; `context` is what its computer knows of its equipment."""

    def __init__(self, context):
        self.radius = context.radius

    def decide(self, sense):
        """Torque command for the coming control period."""
        slip = max(abs(self.radius * omega - sense.speed) for omega in sense.omega)
        share = min(max(1.0 - (slip - THRESHOLD) / WIDTH, 0.0), 1.0)
        return TorqueDecision(share * sense.target, True, "ok", 0.0)


CONTROLLERS.register(
    "slip-limit",
    HostedController("slip-limit", "torque falls with slip", each_unit(SlipLimit), "#117733", "H"),
)
