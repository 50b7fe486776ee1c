"""Controllers that meet the rails: two without a model, the MPC that seeks its slip, and one that was given it."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from studies.mismatch.rails import RAILS

NOISES = (0.0, 0.02, 0.04)
"""Standard deviation of measured axle speeds [km/h]."""
MIDDLE = 0.02
"""Noise in the runs of an MPC that holds a given slip."""
OWN = "its own"
"""Believed curve: that of the rail."""
USUAL = "piecewise"
"""Curve that trains believe in where nothing is said."""


class Setting(NamedTuple):
    """A controller with its settings, and the curve that its train believes in."""

    name: str
    controller: str
    mpc: Mapping[str, Any] = MappingProxyType({})
    """Keys of `[onboard.mpc]`."""
    believed: str = USUAL

    def on(self, curve: str) -> "Setting":
        """The same where the believed curve is named."""
        return self._replace(believed=curve) if self.believed == OWN else self


def _given(share: float, believed: str, name: str) -> Setting:
    keys = {"search": {"seek": False, "given_share": share}}
    return Setting(name, "mpc", keys, believed)


REFERENCE = Setting("cut-and-ramp", "cut-and-ramp")
SEARCHER = Setting("perturb-observe", "perturb-observe")
SOUGHT = Setting("mpc", "mpc")
DELAYED = Setting("mpc, delayed", "mpc", {"computing_delay": 1})
"""Its commands act a control period after the readings that they follow from."""
EVERYWHERE = (REFERENCE, SEARCHER, SOUGHT, DELAYED)
"""Those that meet every noise."""
SHARES = {0.5: "half its peak", 1.0: "its peak", 1.5: "1.5 times its peak"}
RIGHT = SHARES[1.0]
GIVEN = (
    *(_given(share, OWN, name) for share, name in SHARES.items()),
    *(
        _given(1.0, curve, f"peak of {curve}")
        for curve in ("piecewise", "Polach wet", "slip ratio")
    ),
)
"""MPC that holds the slip of a believed curve's peak, which Railway Sciences 4(1):22 (2025) assumes to be known: that of the
rail's own curve, right and wrong by half, and that of another curve."""
SAME_BELIEF = tuple(
    Setting(f"mpc, believes {curve}", "mpc", {}, curve) for curve in ("Polach wet", "slip ratio")
)
"""MPC that seeks its slip under other beliefs; met on one curve, to show that belief makes no difference."""


def settings_at(curve: str, noise: float) -> tuple[Setting, ...]:
    """Every setting that meets a rail of `curve` with this noise, each once."""
    if noise != MIDDLE:
        return EVERYWHERE
    # to believe in the rail's curve by its name, or as its own, is the same run
    given = [one for one in GIVEN if one.believed != curve]
    return (*EVERYWHERE, *given, *(SAME_BELIEF if curve == next(iter(RAILS)) else ()))
