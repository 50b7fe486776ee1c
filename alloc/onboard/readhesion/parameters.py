"""Parameters of the readhesion controllers that are built in. SI units; what no source prints is "assumed"."""

from dataclasses import dataclass

from alloc.onboard.errors import OnboardError, check_numbers


@dataclass(frozen=True)
class CutAndRamp:
    """Readhesion control on the observer's estimate, after Kadowaki and Ohishi.

    On detection the torque is cut to `cut` times the torque that the estimate says the rail can carry; once the wheels
    have readhered it is held at `recover` times that torque for `hold` [s], then raised to the target in `ramp` [s]
    per unit of expected torque. Values assumed (the sources print none), typical of published controllers.
    """

    cut: float = 0.5
    recover: float = 0.9
    hold: float = 0.1
    ramp: float = 3.0

    def __post_init__(self) -> None:
        check_numbers("cut-and-ramp", self, ("ramp",), ("cut", "recover", "hold"))
        if not self.cut <= self.recover <= 1.0:
            raise OnboardError(
                f"cut-and-ramp: needs cut <= recover <= 1, got {self.cut!r} and {self.recover!r}"
            )


@dataclass(frozen=True)
class TorqueTable:
    """Static table of the readhesion paper, section 2.3 and Fig. 5: torque factor over the deviation of acceleration.

    The deviation is the rim's acceleration, by a pseudo-differentiator of `time_constant` tau [s], less the commanded one.
    Factor 1 up to `margin` a_0 [m/s2], 0 from `margin` + `width` a_w [m/s2] on, linear between. Factor times target
    passes a filter that rises with `rise` T_u [s] and falls with `fall` T_d [s]. a_0 and a_w are those of the paper's case
    A, read as km/h/s; T_u, T_d and tau are not printed: these are of a trial that does all that the paper says but for its
    half-slip, as does the best set of `studies.readhesion_paper.calibration`.
    """

    margin: float = 0.4 / 3.6
    width: float = 0.2 / 3.6
    rise: float = 1.8
    fall: float = 0.25
    time_constant: float = 0.18

    def __post_init__(self) -> None:
        check_numbers("table", self, ("width", "rise", "fall", "time_constant"), ("margin",))


@dataclass(frozen=True)
class CreepControl:
    """Creep control: the torque is what a PI controller of the slip velocity allows.

    `reference` [m/s] is the slip of the unit's worst axle that is held; `proportional` [s/m] and `integral` [1/m] are gains
    from slip to coefficient. Assumed: the poles of a wheelset on a flat curve are then at 40 1/s with damping 0.7. The
    searching controllers move the reference and use the same gains. The reference is a compromise: over the probe events
    of `PerturbObserve` 0.10 uses 97 % of the adhesion under a narrow peak and 93 % under Polach's wide one, 0.30 uses
    92 and 99 %.
    """

    reference: float = 0.10
    proportional: float = 0.4
    integral: float = 8.0

    def __post_init__(self) -> None:
        check_numbers("creep", self, ("reference", "proportional", "integral"))


@dataclass(frozen=True)
class PerturbObserve:
    """Perturb and observe: every `interval` [s] the creep reference moves by `step` [m/s], on if the coefficient rose.

    The coefficient is the observer's, averaged over the second half of the interval. The reference stays within `lowest`
    and `highest` [m/s]. Bounds assumed. Of nine pairs of interval (0.2, 0.3, 0.5 s) and step (0.01, 0.02, 0.04 m/s) this one
    used most adhesion over eight probe events of `studies.ladder.events` (seed 1000, the multiple units): 97.4 %
    where short, against 96.8 % at 0.3 s and 91.9 % at 0.3 s and 0.04 m/s. arXiv 2406.13650 names the weaknesses: the step
    is a compromise between search time and fluctuation around the peak, and a change of the rail is taken for an answer
    to the step.
    """

    interval: float = 0.2
    step: float = 0.01
    lowest: float = 0.02
    highest: float = 0.5

    def __post_init__(self) -> None:
        check_numbers("perturb-observe", self, ("interval", "step", "lowest", "highest"))
        if not self.lowest < self.highest:
            raise OnboardError(
                f"perturb-observe: lowest = {self.lowest!r} must be below highest = {self.highest!r}"
            )


@dataclass(frozen=True)
class SteepestGradient:
    """Steepest gradient: as `PerturbObserve`, but the step is `gain` [m2/s2] times the slope d mu / d slip.

    The slope is the quotient of both changes between intervals. Steps are bounded by `least` and `largest` [m/s]: without
    the least one nothing is learnt at the peak, without the largest a small change of slip makes a wild step. Bounds and
    interval assumed. Of five triples of gain, least and largest this one used most adhesion over the probe events of
    `PerturbObserve`, with the shortest search of equals: 97.0 % where short in 0.04 s, against 95.9 % in 0.18 s with 0.04,
    0.003 and 0.03. arXiv 2406.13650 names the weaknesses: the quotient is noisy, and small where the curve falls slowly.
    """

    interval: float = 0.3
    gain: float = 0.15
    least: float = 0.01
    largest: float = 0.06
    lowest: float = 0.02
    highest: float = 0.5

    def __post_init__(self) -> None:
        names = ("interval", "gain", "least", "largest", "lowest", "highest")
        check_numbers("steepest-gradient", self, names)
        if not self.lowest < self.highest:
            raise OnboardError(
                f"steepest-gradient: lowest = {self.lowest!r} must be below highest = {self.highest!r}"
            )
        if not self.least <= self.largest:
            raise OnboardError(
                f"steepest-gradient: least = {self.least!r} must not exceed largest = {self.largest!r}"
            )
