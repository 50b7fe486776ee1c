"""The switch command unit 187 of JP H07-322414, Fig. 6: learn on the feedback, then use what was learnt."""

import math
from dataclasses import dataclass, field

from alloc.errors import OnboardError

LEARN, USE = 1, 2
"""The switch command's signals."""


@dataclass
class LearnThenUse:
    """Switches to `USE` when the root mean square error over `window` [s] falls below `small` [N], back above `large` [N].

    The error is the residual of I_FB / K_i by (6) and (7) during learning, and I_FB / K_i itself while the learnt weights
    are used. The source gives no thresholds. `feedback`: whether I_FB still acts while the learnt weights are used. As
    printed it does not (the output switch 185 makes the feedforward alone the current command), and then nothing holds the
    speed.
    """

    small: float
    large: float
    window: float = 10.0
    feedback: bool = True
    signal: int = field(default=LEARN, init=False)
    mean_square: float = field(default=math.nan, init=False)
    since: float = field(default=0.0, init=False)
    """Time [s] since the last change."""

    def __post_init__(self) -> None:
        OnboardError.check("learn-then-use", self, positive=("small", "large", "window"))
        OnboardError.check_order("learn-then-use", self, "small", "large", equal=True)

    def update(self, error: float, period: float) -> bool:
        """Take the error [N] of one `period` [s]; whether the signal changed."""
        share = min(period / self.window, 1.0)
        if math.isnan(self.mean_square):
            self.mean_square = error * error
        self.mean_square += share * (error * error - self.mean_square)
        self.since += period
        size = math.sqrt(self.mean_square)
        change = size < self.small if self.signal == LEARN else size > self.large
        if not change or self.since < self.window:
            return False
        self.signal = USE if self.signal == LEARN else LEARN
        self.mean_square, self.since = math.nan, 0.0
        return True
