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
    """Parameters of the belief about the peak coefficient, see `mpc.belief`.

    `initial`: before anything was felt. `pole` [1/s] of the observers of single axles: that of the unit's own.
    `gain` [1/s]: how fast the belief takes over what slipping axles feel. `probe` [1/s]: relative rate at which an
    untested belief rises. `informative`: slip, as a multiple of the peak's, from which an axle's coefficient tells the
    peak; `slip_error` [m/s], the error of measured slip, and `noise_margin` times its mean deviation are added to it.
    Without them, noise on a slippery rail passes for slip, and belief and torque pull each other down to the `floor`.
    `floor`, `ceiling`: bounds of the belief.
    """

    initial: float = quantity(0.2, "1")
    pole: float = quantity(25.0, "1/s")
    gain: float = quantity(60.0, "1/s")
    probe: float = quantity(0.04, "1/s")
    informative: float = quantity(0.9, "1")
    slip_error: float = quantity(0.015, "km/h")
    noise_margin: float = quantity(4.0, "1")
    floor: float = quantity(0.01, "1")
    ceiling: float = quantity(0.5, "1")

    def __post_init__(self) -> None:
        _check("belief", self, zero=("probe", "slip_error", "noise_margin"))
        if not self.floor < self.initial <= self.ceiling:
            raise MpcError(
                f"belief: needs floor < initial <= ceiling, got {self.floor!r}, {self.initial!r} and "
                f"{self.ceiling!r}"
            )


@dataclass(frozen=True)
class CurveBelief:
    """Parameters of the belief about the adhesion curve's slope, see `mpc.curve_belief`.

    `estimate`: off, the curve that the unit was given is believed. `slip_scale` [m/s]: slip of one unit of excitation.
    `memory` [s]: how long one axle that slips by the scale is remembered; `prior` [s]: how long it must do so to count as
    much as the given curve. `smallest`, `largest`: bounds of the stretch. A pair counts as micro slip while what is felt is
    less than `tested_share` of the peak that the axle has slipped at, or, where it never slipped or has felt more since,
    `untested_share` of the peak believed.
    """

    estimate: bool = True
    slip_scale: float = quantity(0.015, "km/h")
    memory: float = quantity(5.0, "s")
    prior: float = quantity(0.02, "s")
    smallest: float = quantity(0.4, "1")
    largest: float = quantity(2.5, "1")
    tested_share: float = quantity(0.75, "1")
    untested_share: float = quantity(0.5, "1")

    def __post_init__(self) -> None:
        _check("curve", self)
        if not isinstance(self.estimate, bool):
            raise MpcError(f"curve: estimate = {self.estimate!r} must be True or False")
        if not self.smallest <= 1.0 <= self.largest:
            raise MpcError(
                f"curve: needs smallest <= 1 <= largest, got {self.smallest!r} and {self.largest!r}"
            )
        if not self.untested_share <= self.tested_share < 1.0:
            raise MpcError(
                "curve: needs untested_share <= tested_share < 1, got "
                f"{self.untested_share!r} and {self.tested_share!r}"
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

    `horizon` steps of `step`. `slip_limit`: multiple of the believed curve's peak slip that the slip should stay below.
    `headroom`: the torque command never exceeds what the believed peak carries by more than this share, whatever the
    optimiser says. `iterations`: most SQP steps per control period, the first always taken, more while the optimality
    residual before the last one exceeds `tolerance` and time is left. Against convergence one step alone costs up to 30 % of
    the closed loop's cost in the shipped events, five cost less than 1 % in driving and some percent with blended brakes.
    Time is simulated, so a run does not depend on the machine that computes it. `step_time`: time that the computer on
    board takes for an SQP step, of a unit or of a group; assumed, ten times what a workstation takes for four axles.
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
    slip_limit: float = quantity(1.0, "1")
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
    curve: CurveBelief = field(default_factory=CurveBelief)
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
