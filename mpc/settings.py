"""What the readhesion MPC is asked to do: horizon, weights, belief, deadline."""

from dataclasses import dataclass, field, fields
from typing import Any

from alloc.errors import InputError
from alloc.onboard.quantity import quantity

CODES = ("numba", "c")
"""Ways of compiling the model."""


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

    tracking: ((torque - target) / torque scale)^2. slip: mean over the axles of
    (excess over the slip limit / `slip_scale`)^2, zero below the limit. rate: (change of torque from step to
    step / torque scale)^2. The torque scale is the motor torque of a coefficient of `coefficient_scale`.
    """

    tracking: float = quantity(1.0, "1")
    slip: float = quantity(2.0, "1")
    rate: float = quantity(0.3, "1")
    coefficient_scale: float = quantity(0.1, "1")
    slip_scale: float = quantity(0.05, "km/h")
    """[m/s]"""

    def __post_init__(self) -> None:
        _check("weights", self, zero=("slip", "rate"))


@dataclass(frozen=True)
class PeakBelief:
    """Parameters of the belief about the rail, see `mpc.axle_observer` and `mpc.curve_filter`.

    `initial`: peak coefficient before anything was felt. `pole` [1/s] of the observers of single axles: that of the
    unit's own. `walk`, `slope_walk`: relative deviation by which a peak, and the slope at the origin over it, may have
    changed after a second. `slip_error` [m/s]: of measured slip beside its noise, that of the reference speed;
    `coefficient_error` and `relative_error`: of the observed coefficient and of the curve's shape. `gate`: deviations
    from what was expected that say that the rail has changed. `floor`, `ceiling`: bounds of the belief.
    """

    initial: float = quantity(0.2, "1")
    pole: float = quantity(25.0, "1/s")
    walk: float = quantity(0.05, "1")
    slope_walk: float = quantity(0.05, "1")
    slip_error: float = quantity(0.001, "km/h")
    coefficient_error: float = quantity(0.0006, "1")
    relative_error: float = quantity(0.006, "1")
    gate: float = quantity(5.0, "1")
    floor: float = quantity(0.01, "1")
    ceiling: float = quantity(0.5, "1")

    def __post_init__(self) -> None:
        _check("belief", self, zero=("walk", "slope_walk", "slip_error"))
        if not self.floor < self.initial <= self.ceiling:
            raise MpcError(
                f"belief: needs floor < initial <= ceiling, got {self.floor!r}, {self.initial!r} and "
                f"{self.ceiling!r}"
            )


@dataclass(frozen=True)
class SlipSearch:
    """Parameters of the search for the best slip, see `mpc.slip_search`; slips in m/s.

    `first`: slip held before anything is known; `lowest`, `highest`: bounds, and `noise_margin` deviations of the
    measured slip's noise are a bound from below too. `friction_price` [s/m]: relative loss of force that a slip of 1
    m/s is worth avoiding. `swing`: greatest one of the slip limit about its mean where noise hides none, as a share of
    it, with the period `swing_time` [s]; `least_swing`: what it shrinks to where the answer is clear. `memory` [s] of
    the answer. `gain` [1/s]: relative speed of the slip sought per elasticity, at most `fastest_rise` and
    `fastest_fall` [1/s]. Tuned on 20 events of `studies.ladder.events` and 12 of `studies.curves` (seed 3000).
    `seek`: off, slip is held at `given_share` of the slip at the peak of the curve that the unit was given.
    """

    first: float = quantity(0.08, "km/h")
    lowest: float = quantity(0.02, "km/h")
    highest: float = quantity(1.6, "km/h")
    noise_margin: float = quantity(4.0, "1")
    friction_price: float = quantity(0.15, "s/m")
    swing: float = quantity(0.1, "1")
    least_swing: float = quantity(0.03, "1")
    swing_time: float = quantity(0.2, "s")
    memory: float = quantity(0.3, "s")
    gain: float = quantity(40.0, "1/s")
    fastest_rise: float = quantity(3.0, "1/s")
    fastest_fall: float = quantity(3.0, "1/s")
    seek: bool = True
    given_share: float = quantity(1.0, "1")

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
                f"search: needs lowest <= first <= highest, got {self.lowest!r}, {self.first!r} and "
                f"{self.highest!r}"
            )


@dataclass(frozen=True)
class GroupSettings:
    """What is asked of one problem over several units.

    `evenness`: weight per step of sum of shares ((torque - torque of an even split) / torque scale)^2. It is small against
    that of tracking and makes the split of the total unique. `limited`: share of its believed adhesion from which a unit
    counts as bound by its own rail and not by what the others need of it. `steps`: most SQP steps where the problem is
    solved at telegram instants only, and its guess is a tenth of a second old.
    """

    evenness: float = quantity(0.05, "1")
    limited: float = quantity(0.95, "1")
    steps: int = quantity(3, "1", most=1000)

    def __post_init__(self) -> None:
        # without evenness the Hessian is singular in the split, and so is the problem
        _check("group", self)
        if self.limited > 1.0:
            raise MpcError(f"group: limited = {self.limited!r} must lie in (0, 1]")


@dataclass(frozen=True)
class MpcSettings:
    """Settings of the readhesion MPC; times in s.

    `horizon` steps of `step`. `headroom`: the torque command never exceeds what the believed peak carries by more than
    this share, whatever the optimiser says. `iterations`: most SQP steps per control period, the first always taken,
    more while the optimality residual before the last one exceeds `tolerance` and time is left. Against convergence one
    step alone costs up to 30 % of the closed loop's cost in the shipped events, five cost about 1 % in driving and some
    percent with blended brakes. Time is simulated, so a run does not depend on the machine that computes it.
    `step_time`: time that the computer on board takes for an SQP step, of a unit or of a group; assumed, ten times what
    a workstation takes for four axles.
    `deadline`: longest solve, by default as long as the default control period; what is longer than the control period
    counts as the period. No step is begun that would end later, and where not even one fits, the answer is late, which
    counts as failed. `computing_delay`: control periods, 0 or 1, from the readings to the command that they lead to; the
    controller of a unit or a group then commands what it found before. `compensated`: it solves from the state that it
    predicts for the instant at which its command will act. `exact_hessian`: second derivatives of the plant in the QP,
    indefinite parts reflected; else Gauss-Newton. `code`: the model compiled by Numba ("numba", needs nothing else) or
    from C by the system's compiler ("c"); the answers are the same.
    """

    horizon: int = quantity(20, "1", most=200)
    step: float = quantity(0.01, "s")
    headroom: float = quantity(0.1, "1")
    iterations: int = quantity(5, "1", most=1000)
    tolerance: float = quantity(1e-2, "1")
    step_time: float = quantity(1e-3, "s")
    deadline: float = quantity(0.01, "s")
    computing_delay: int = quantity(0, "1", most=1)
    compensated: bool = True
    exact_hessian: bool = False
    code: str = "numba"
    weights: Weights = field(default_factory=Weights)
    belief: PeakBelief = field(default_factory=PeakBelief)
    search: SlipSearch = field(default_factory=SlipSearch)
    group: GroupSettings = field(default_factory=GroupSettings)

    def __post_init__(self) -> None:
        _check("mpc", self, zero=("headroom", "tolerance", "computing_delay"))
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(item.default_factory, type) and not isinstance(
                value, item.default_factory
            ):
                kind = item.default_factory.__name__
                raise MpcError(f"mpc: {item.name} = {value!r} must be a {kind}")
        if self.code not in CODES:
            raise MpcError(
                f"mpc: code = {self.code!r} must be one of {', '.join(map(repr, CODES))}"
            )
        if self.computing_delay not in (0, 1):
            raise MpcError(f"mpc: computing_delay = {self.computing_delay!r} must be 0 or 1")
        if self.horizon < 2:
            raise MpcError(f"mpc: horizon = {self.horizon!r} must be at least 2 steps")

    def steps_in_time(self, period: float) -> int:
        """Most SQP steps in a control period of `period` [s]; 0: not even one ends in time."""
        return min(self.iterations, int(min(self.deadline, period) / self.step_time * (1.0 + 1e-9)))
