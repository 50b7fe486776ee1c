"""Speed feedback: proportional, or proportional and integral with anti-windup (JP H07-322414, speed control 2, 12)."""

from dataclasses import dataclass, field

from alloc.errors import OnboardError


@dataclass
class Feedback:
    """Current command I_FB [A] from the speed difference V_d = V_c - V [m/s].

    `proportional` [A s/m]; `integral` [A/m], 0 for P control. Anti-windup by conditional integration: while the motors give
    less than the command, the integrator does not move further in that direction.
    """

    proportional: float
    integral: float = 0.0
    state: float = field(default=0.0, init=False)
    """The integrator [A]."""

    def __post_init__(self) -> None:
        OnboardError.check("speed feedback", self, ("proportional",), ("integral",))

    @classmethod
    def for_train(
        cls, mass: float, current_per_force: float, time_constant: float, reset_time: float = 0.0
    ) -> "Feedback":
        """Gains for a closed loop of `time_constant` [s] of a train of `mass` [kg]; `reset_time` [s], 0 for P control."""
        proportional = current_per_force * mass / time_constant
        return cls(proportional, proportional / reset_time if reset_time else 0.0)

    def current(self, difference: float) -> float:
        """I_FB [A] for V_d = `difference` [m/s]."""
        return self.proportional * difference + self.state

    def integrate(self, difference: float, missing: float, period: float) -> None:
        """Move the integrator over `period` [s]; `missing` [A]: current asked for less the current supplied."""
        if missing * difference <= 0.0:
            self.state += self.integral * difference * period

    def shift(self, current: float) -> None:
        """Take `current` [A] off the integrator because another part of the command adds it now; P control has none."""
        if self.integral > 0.0:
            self.state -= current
