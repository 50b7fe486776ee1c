"""The speed control as a driver of `alloc.driving.drive`: feedback, compensation, feedforward, learning."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Protocol, get_args

import numpy as np
import xarray as xr

from alloc.errors import OnboardError
from alloc.onboard.speed_control.command import SpeedCommand
from alloc.onboard.speed_control.feedback import Feedback
from alloc.onboard.speed_control.line_memory import LineMemory
from alloc.onboard.speed_control.position_detector import Detection, PositionDetector
from alloc.onboard.speed_control.resistance import (
    EXTENDED_WEIGHTS,
    Motion,
    compensation_force,
    feedforward_force,
    regressor,
)
from alloc.onboard.speed_control.sampling import Regression, RegressionFilter
from alloc.onboard.speed_control.switch import USE, LearnThenUse
from alloc.onboard.speed_control.traction import Traction
from alloc.plant.model import Floats

if TYPE_CHECKING:
    from alloc.onboard.driver import Controls, TrainSense

Mode = Literal["feedback", "compensation", "feedforward", "learn-then-use"]
"""Feedback alone (Fig. 8); compensation by position (claims 1, 2); feedforward from commanded values, with learning at the
same time if there is a learner (claims 3, 4); learning on the feedback, then using the result (claim 5)."""

LOGGED: dict[str, tuple[str, str]] = {
    "commanded_speed": ("m s-1", "speed command V_c"),
    "commanded_acceleration": ("m s-2", "acceleration command a_c"),
    "measured_speed": ("m s-1", "speed V as measured"),
    "position": ("m", "position X as reported"),
    "feedback_current": ("A", "feedback current I_FB"),
    "feedforward_current": ("A", "compensating current I_FF"),
    "current": ("A", "current I that is supplied"),
    "force": ("N", "force I / K_i"),
    "switch": ("1", "switch command of claim 5: 1 learn, 2 use"),
}
"""Signals that a speed control records once per control period: unit and meaning."""


class Learner(Protocol):
    """Interface of an object that learns the weights: see `alloc.estimation.running_resistance`."""

    weights: Floats

    def update(self, regressor: Floats, error: float, acceleration: float | None = None) -> None:
        """Learn from one sample: `regressor` Z (weights,), `error` [N], and a [m/s2], printed as Z3."""


@dataclass(frozen=True)
class Learning:
    """How a speed control learns the weights.

    `error`: the error to learn from, "feedback" (I_FB, claims 4, 6) or "model" (what the weights do not explain of the force
    supplied, with measured V and a; claims 5, 7). `switch`: of claim 5. `filter_time` [s] of `RegressionFilter`.
    `train_length` [m]: no learning while section or gradient change under the train (not in the source); 0: learn there too.
    """

    learner: Learner | None = None
    error: Literal["feedback", "model"] = "feedback"
    switch: LearnThenUse | None = None
    filter_time: float = 0.0
    train_length: float = 0.0

    def __post_init__(self) -> None:
        OnboardError.check("speed control", self, nonnegative=("train_length",))
        OnboardError.check_choice("speed control", "error", self.error, ("feedback", "model"))


class SpeedControl:
    """Drives the train by current I = I_FB + I_FF; call it once per control period `period` [s], as `drive` does.

    `weights` (3,) or (5,) are used where nothing learns them. `rotating_mass` M_r [kg] as in `resistance`. `detector`:
    source of position and speed. Raises `OnboardError` for impossible parameters.
    """

    def __init__(
        self,
        command: SpeedCommand,
        feedback: Feedback,
        traction: Traction,
        period: float,
        mode: Mode = "feedback",
        memory: LineMemory | None = None,
        weights: Floats | None = None,
        learning: Learning | None = None,
        rotating_mass: float = 0.0,
        detector: PositionDetector | None = None,
    ) -> None:
        self.command, self.feedback, self.traction = command, feedback, traction
        self.period, self.mode = period, mode
        self.memory, self.learning = memory or LineMemory(), learning or Learning()
        self.rotating_mass = rotating_mass
        learner, switch = self.learning.learner, self.learning.switch
        OnboardError.check("speed control", self, ("period",), ("rotating_mass",))
        OnboardError.check_choice("speed control", "mode", mode, get_args(Mode))
        if weights is None and learner is None and mode != "feedback":
            raise OnboardError(f"speed control: mode {mode!r} needs weights or a learner")
        if (switch is None or learner is None) and mode == "learn-then-use":
            raise OnboardError("speed control: mode 'learn-then-use' needs a learner and a switch")
        self._weights = np.zeros(3) if weights is None else np.array(weights, dtype=float)
        if self.weights.shape not in ((3,), (5,)) or not np.all(np.isfinite(self.weights)):
            raise OnboardError(f"speed control: weights = {self.weights} must be 3 or 5 numbers")
        self._filter = RegressionFilter(self.learning.filter_time, period)
        self._detection = Detection(detector or PositionDetector(), period)
        self._last: tuple[float, float, float, float, bool] | None = None
        self._rows: list[list[float]] = []
        self._times: list[float] = []
        self._history: list[Floats] = []

    @property
    def weights(self) -> Floats:
        """Weights in use, (3,) or (5,)."""
        learner = self.learning.learner
        return self._weights if learner is None else learner.weights

    @property
    def _using(self) -> bool:
        switch = self.learning.switch
        return self.mode != "learn-then-use" or (switch is not None and switch.signal == USE)

    def __call__(self, sense: TrainSense, controls: Controls) -> bool:
        """Set the torques of all units for the coming control period."""
        position, speed = self._detection.read(sense)
        switch = self.learning.switch
        wanted, rate = (float(value) for value in self.command.at(sense.time))
        error = self._learn(speed, position)
        difference = wanted - speed
        ahead = self._feedforward(speed, wanted, rate, position)
        if switch is not None and error is not None and switch.update(error, self.period):
            # what the feedforward gives from now on the integrator need no longer give, and the other way round
            self.feedback.shift(ahead if self._using else -ahead)
            self._filter.restart()
        back = self.feedback.current(difference)
        current = back + ahead
        if self.mode == "learn-then-use":
            assert switch is not None
            if not self._using:
                current = back
            elif not switch.feedback:
                current = ahead
        torques, supplied = self.traction.torques(current, speed)
        controls.torque[:] = torques
        bounded = abs(current - supplied) > 1e-9 * max(abs(current), 1.0)
        self.feedback.integrate(difference, current - supplied if bounded else 0.0, self.period)
        self._last = (speed, position, supplied, back, bounded)
        self._times.append(sense.time)
        ahead_used = ahead if self._using else 0.0
        self._rows.append(
            [wanted, rate, speed, position, back, ahead_used, supplied,
             supplied / self.traction.current_per_force,
             np.nan if switch is None else switch.signal]
        )  # fmt: skip
        self._history.append(self.weights.copy())
        return True

    def _feedforward(self, speed: float, wanted: float, rate: float, position: float) -> float:
        """I_FF [A]."""
        if self.mode == "feedback":
            return 0.0
        tunnel, slope = (float(value) for value in self.memory.read(position))
        if self.mode == "compensation":
            force = compensation_force(self.weights, Motion(speed, 0.0, slope, tunnel))
        else:
            commanded = Motion(wanted, rate, slope, tunnel)
            force = feedforward_force(self.weights, commanded, self.rotating_mass)
        return self.traction.current_per_force * float(force)

    def _learn(self, speed: float, position: float) -> float | None:
        """Learn from the control period that has passed; returns the error [N] that the switch looks at, if any."""
        if self._last is None or (self.learning.learner is None and self.learning.switch is None):
            return None
        before, behind, supplied, back, bounded = self._last
        middle = 0.5 * (position + behind)
        tunnel, slope = (float(value) for value in self.memory.read(middle))
        acceleration = (speed - before) / self.period
        motion = Motion(0.5 * (speed + before), acceleration, slope, tunnel)
        per_force = self.traction.current_per_force
        length = self.learning.train_length
        if bounded or (length > 0.0 and bool(self.memory.straddled(middle, length))):
            self._filter.restart()
            return None
        sample = self._filter.add(
            Regression(
                regressor(motion, self.weights.size),
                supplied / per_force - self.rotating_mass * acceleration,
                back / per_force,
                acceleration,
            ),
            tunnel > 0.5,
        )
        if sample is None:
            return None
        model = sample.target - float(self.weights @ sample.regressor)
        if self.mode == "learn-then-use" and self._using:
            return sample.feedback
        if self.learning.learner is not None:
            # learning on the feedback that drives alone is claim 5's: its error is against the model
            on_model = self.learning.error == "model" or self.mode == "learn-then-use"
            self.learning.learner.update(
                sample.regressor, model if on_model else sample.feedback, sample.acceleration
            )
        return model

    def log(self) -> xr.Dataset:
        """Recorded signals over time: `LOGGED`, and the weights in use (time, weight)."""
        rows = np.array(self._rows).reshape(-1, len(LOGGED))
        data: dict[str, Any] = {
            name: ("time", rows[:, k], {"units": unit, "long_name": meaning})
            for k, (name, (unit, meaning)) in enumerate(LOGGED.items())
        }
        names = list(EXTENDED_WEIGHTS[: self.weights.size])
        data["weights"] = (("time", "weight"), np.array(self._history).reshape(-1, len(names)))
        time = ("time", np.array(self._times), {"units": "s", "long_name": "time"})
        return xr.Dataset(data, coords={"time": time, "weight": names})
