"""Every registered readhesion controller keeps the laws of `alloc.testing`; faulty ones break them."""

import pytest

from alloc.onboard.host import CONTROLLERS, HostedController, TorqueDecision, each_unit
from alloc.rules.testing import BrokenLaw, check
from alloc.testing import CONTROLLER_LAWS, check_controller

SLOW = {"mpc-opti", "mpc-train", "mpc-train-ideal"}
"""Those that solve by CasADi, or for the whole train at once, take minutes; tests/mpc has their laws."""


@pytest.mark.parametrize("controller", [name for name in CONTROLLERS if name not in SLOW])
def test_every_controller_keeps_the_laws(controller):
    check_controller(CONTROLLERS[controller])


FAULTS = {
    "plan reached": lambda self, sense: 0.99 * sense.target,
    "within target": lambda self, sense: 1.01 * sense.target,
    "finite": lambda self, sense: None,
    "recovers": lambda self, sense: self.lower(sense),
    "no cut below the peak": lambda self, sense: sense.target * (self.slip(sense) < 0.02),
    "repeatable": lambda self, sense: sense.target - self.calls(),
}  # fmt: skip
CALLS = []


class Faulty:
    """A controller of one unit with the fault of this name."""

    def __init__(self, fault):
        self.fault, self.share = fault, 1.0

    def decide(self, sense):
        return TorqueDecision(FAULTS[self.fault](self, sense), True, "ok", 0.0)

    def lower(self, sense):
        """A cut that is never made good."""
        self.share = 0.5 if sense.slipping else self.share
        return self.share * sense.target

    def slip(self, sense):
        return max(abs(0.43 * omega - sense.speed) for omega in sense.omega)

    def calls(self):
        CALLS.append(1)
        return 1e-9 * len(CALLS)


@pytest.mark.parametrize("law", FAULTS)
def test_a_faulty_controller_is_told_the_law_and_the_event(law):
    faulty = HostedController("faulty", "", each_unit(lambda context: Faulty(law)))
    asked = [one for one in CONTROLLER_LAWS if one.name == law]
    with pytest.raises(BrokenLaw, match=rf"faulty breaks the law '{law}' .* counterexample: Start"):
        check(faulty, asked)
