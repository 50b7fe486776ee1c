"""Settings of the readhesion MPC: horizon, weights, belief, deadline."""

from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

from alloc.old.display import displayed
from alloc.old.errors import InputError
from alloc.old.records import quantity


class MpcError(InputError):
    """A setting of the MPC is impossible; the message names it and what to do."""


def _check(owner: str, record: Any, zero: tuple[str, ...] = ()) -> None:
    """Every number of `record` must be finite and above 0; those named in `zero` may be 0 too."""
    for item in fields(record):
        value = getattr(record, item.name)
        if item.type is int and not isinstance(value, int):
            raise MpcError(f"{owner}: {item.name} = {value!r} must be an integer")
    numbers = [item.name for item in fields(record) if item.type in (int, float)]
    positive = [name for name in numbers if name not in zero]
    MpcError.check(owner, record, positive, zero)


@dataclass(frozen=True)
class Weights:
    """Weights of the cost per prediction step; dimensionless, since every term is divided by its scale.

    The torque scale is the motor torque of a coefficient of `coefficient_scale`.

    Source: assumed.
    """

    tracking: ClassVar[float] = 1.0
    """Weight of ((torque - target) / torque scale)^2."""
    slip: float = quantity(2.0, "1")
    """Weight of the mean over the axles of (excess over the slip limit / `slip_scale`)^2, zero below the limit."""
    rate: float = quantity(0.3, "1")
    """Weight of (change of torque from step to step / torque scale)^2."""
    twisting_rate: ClassVar[float] = 4.8
    """The same where drives twist. The model has stiff ones, so what a fast change of torque excites in them is not
    predicted, and comes back as slip. Source: tuned on 14 starts of the study `effects` (seeds 5300 to 5500)."""
    coefficient_scale: ClassVar[float] = 0.1
    """Coefficient whose motor torque is the torque scale."""
    slip_scale: ClassVar[float] = 0.05
    """Scale of the excess of slip [m/s]."""

    def __post_init__(self) -> None:
        _check("weights", self, zero=("slip", "rate"))


@dataclass(frozen=True)
class PeakBelief:
    """Parameters of the belief about the rail, see `mpc.old.estimator` and `mpc.old.estimator`.

    Source: assumed.
    """

    initial: float = quantity(0.2, "1")
    """Peak coefficient before the first reading."""
    pole: float = quantity(25.0, "1/s")
    """Pole of the observers of single axles [1/s]. Source: that of the unit's own observer."""
    walk: ClassVar[float] = 0.05
    """Relative deviation by which a peak may have changed after a second."""
    slope_walk: ClassVar[float] = 0.05
    """Relative deviation by which the slope at the origin over the peak may have changed after a second."""
    slip_error: ClassVar[float] = 0.001
    """Deviation of measured slip in addition to its noise: that of the reference speed [m/s]."""
    coefficient_error: ClassVar[float] = 0.0006
    """Deviation of the observed coefficient."""
    relative_error: ClassVar[float] = 0.006
    """Relative deviation of the curve's shape."""
    gate: ClassVar[float] = 5.0
    """Number of deviations from the expected value above which the rail counts as changed."""
    floor: float = quantity(0.01, "1")
    """Smallest peak coefficient believed."""
    ceiling: float = quantity(0.5, "1")
    """Largest peak coefficient believed."""

    def __post_init__(self) -> None:
        _check("belief", self)
        if not self.floor < self.initial <= self.ceiling:
            raise MpcError(
                f"belief: needs floor < initial <= ceiling, got {self.floor!r}, {self.initial!r} and "
                f"{self.ceiling!r}"
            )


@dataclass(frozen=True)
class SlipSearch:
    """Parameters of the search for the best slip, see `mpc.old.slip_search`.

    Source: tuned on 20 events of `studies.ladder.events` and 12 of `studies.ladder.curves_study` (seed 3000).
    """

    first: float = quantity(0.08, "km/h")
    """Slip held before the first reading [m/s]."""
    lowest: float = quantity(0.02, "km/h")
    """Smallest slip sought [m/s]."""
    highest: float = quantity(1.6, "km/h")
    """Largest slip sought [m/s]."""
    noise_margin: float = quantity(4.0, "1")
    """Second lower bound of the slip sought, in deviations of the measured slip's noise."""
    friction_price: float = quantity(0.15, "s/m")
    """Relative loss of force that is accepted to avoid a slip of 1 m/s [s/m]."""
    swing: float = quantity(0.1, "1")
    """Largest swing of the slip limit about its mean where noise does not hide the response, as a share of the mean."""
    least_swing: ClassVar[float] = 0.03
    """Smallest swing, used where the response is clear."""
    swing_time: float = quantity(0.2, "s")
    """Period of the swing [s]."""
    memory: ClassVar[float] = 0.3
    """Memory of the response [s]."""
    gain: ClassVar[float] = 40.0
    """Relative speed of the slip sought per elasticity [1/s]."""
    fastest_rise: ClassVar[float] = 3.0
    """Largest relative speed of its rise [1/s]."""
    fastest_fall: ClassVar[float] = 3.0
    """Largest relative speed of its fall [1/s]."""
    seek: bool = True
    """Whether the best slip is sought. Otherwise slip is held at `given_share` of the slip at the peak of the curve that the
    unit was given."""
    given_share: float = quantity(1.0, "1")
    """Share of the slip at the given curve's peak at which slip is held where none is sought."""

    def __post_init__(self) -> None:
        _check("search", self, zero=("noise_margin", "friction_price"))
        if not isinstance(self.seek, bool):
            raise MpcError(f"search: seek = {self.seek!r} must be True or False")
        if not self.swing < 1.0:
            raise MpcError(f"search: swing = {self.swing!r} must lie in (0, 1)")
        if not self.least_swing <= self.swing:
            raise MpcError(
                f"search: least_swing = {self.least_swing!r} must not exceed swing = {self.swing!r}"
            )
        if not self.lowest <= self.first <= self.highest:
            raise MpcError(
                f"search: first = {self.first!r} must lie between lowest = {self.lowest!r} and "
                f"highest = {self.highest!r}"
            )


@dataclass(frozen=True)
class GroupSettings:
    """Settings of one problem over several units.

    Source: assumed.
    """

    evenness: ClassVar[float] = 0.05
    """Weight per step of sum of shares ((torque - torque of an even split) / torque scale)^2. It is small compared with that
    of tracking, and makes the split of the total unique: without it the Hessian is singular."""
    limited: ClassVar[float] = 0.95
    """Share of its believed adhesion above which a unit counts as limited by its own rail, not by what the others need of
    it."""
    steps: int = quantity(3, "1", most=1000)
    """Largest number of SQP steps where the problem is solved at telegram instants only, and its guess is a tenth of a
    second old."""

    def __post_init__(self) -> None:
        _check("group", self)


@displayed
@dataclass(frozen=True)
class MpcSettings:
    """Settings of the readhesion MPC.

    Compared with convergence, a single step costs up to 30 % of the closed loop's cost in the shipped events. Five steps
    cost about 1 % in driving and some percent with blended brakes. Time is simulated, so a run does not depend on the
    machine that computes it.

    Source: assumed.
    """

    horizon: int = quantity(20, "1", most=200)
    """Steps of the prediction, 2 or more."""
    step: float = quantity(0.01, "s")
    """Length of a step of the prediction [s]."""
    headroom: float = quantity(0.1, "1")
    """Share by which the torque command may exceed what the believed peak carries, whatever the optimiser says."""
    iterations: int = quantity(5, "1", most=1000)
    """Largest number of SQP steps per control period. The first is always taken, further ones while the residual exceeds
    `tolerance` and time is left."""
    tolerance: float = quantity(1e-2, "1")
    """Optimality residual before the last step at which the solver stops."""
    step_time: float = quantity(1e-3, "s")
    """Time that the computer on board takes for an SQP step, of a unit or of a group [s]. Source: assumed: ten times what a
    workstation takes for four axles."""
    deadline: float = quantity(0.01, "s")
    """Longest solve; a value longer than the control period counts as the period [s]. No step begins that would end later.
    If not even one step fits, the answer is late, which counts as failed. Source: the default control period."""
    computing_delay: int = quantity(0, "1", most=1)
    """Control periods, 0 or 1, from the readings to the resulting command; with 1 the controller of a unit or a group
    commands the result of the period before."""
    compensated: bool = True
    """Whether, with a computing delay, it solves from the state predicted for the instant at which its command acts."""
    weights: Weights = field(default_factory=Weights)
    """Weights of the cost."""
    belief: PeakBelief = field(default_factory=PeakBelief)
    """Belief about the rail."""
    search: SlipSearch = field(default_factory=SlipSearch)
    """Search for the best slip."""
    group: GroupSettings = field(default_factory=GroupSettings)
    """One problem over several units: mpc-car and mpc-train."""

    def __post_init__(self) -> None:
        _check("mpc", self, zero=("headroom", "tolerance", "computing_delay"))
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(item.default_factory, type) and not isinstance(
                value, item.default_factory
            ):
                kind = item.default_factory.__name__
                raise MpcError(f"mpc: {item.name} = {value!r} must be a {kind}")
        if self.computing_delay not in (0, 1):
            raise MpcError(f"mpc: computing_delay = {self.computing_delay!r} must be 0 or 1")
        if self.horizon < 2:
            raise MpcError(f"mpc: horizon = {self.horizon!r} must be at least 2 steps")

    def steps_in_time(self, period: float) -> int:
        """Largest number of SQP steps in a control period of `period` [s]; 0: not even one ends in time."""
        return min(self.iterations, int(min(self.deadline, period) / self.step_time * (1.0 + 1e-9)))
