"""What the MPC of a group of units is asked to do beyond that of a unit."""

from dataclasses import dataclass, field

from mpc.settings import MpcError, MpcSettings


@dataclass(frozen=True)
class GroupSettings:
    """Settings of one problem over several units.

    `evenness`: weight per step of sum of shares ((torque - torque of an even split) / torque scale)^2, small against that of
    tracking: it makes the split of the total unique. `limited`: share of its believed adhesion from which a unit counts
    as bound by its own rail and not by what the others need of it. `steps`: most SQP steps where the problem is solved at
    telegram instants only, and its guess is a tenth of a second old.
    """

    mpc: MpcSettings = field(default_factory=MpcSettings)
    evenness: float = 0.05
    limited: float = 0.95
    steps: int = 3

    def __post_init__(self) -> None:
        if not isinstance(self.mpc, MpcSettings):
            raise MpcError(f"group: mpc = {self.mpc!r} must be MpcSettings")
        # without it the Hessian is singular in the split, and so is the problem
        if not 0.0 < self.evenness < float("inf"):
            raise MpcError(f"group: evenness = {self.evenness!r} must be finite and > 0")
        if not 0.0 < self.limited <= 1.0:
            raise MpcError(f"group: limited = {self.limited!r} must lie in (0, 1]")
        if isinstance(self.steps, bool) or not isinstance(self.steps, int) or self.steps < 1:
            raise MpcError(f"group: steps = {self.steps!r} must be an integer, 1 or greater")
