"""The speed control of JP H07-322414 as a driver: feedback, compensation, feedforward, learning, switching.

In: a `TrainSense` per control period. Out: `Controls`, the current that becomes the motors' torque.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, NamedTuple, Protocol, get_args

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from alloc.errors import OnboardError
from alloc.onboard.line_memory import (
    EXTENDED_WEIGHTS,
    Detection,
    LineMemory,
    Motion,
    PositionDetector,
    Regression,
    RegressionFilter,
    compensation_force,
    feedforward_force,
    regressor,
)
from alloc.plant.laws import limit_place
from alloc.plant.model import Floats
from alloc.plant.operations import look_up
from alloc.plant.train import EFFORT_SPEED_STEP, Train

# Interface of a driver of `alloc.driving.drive`: a person, or a speed control.


class TrainSense(NamedTuple):
    """What the driver reads."""

    time: float
    """[s]"""
    position: float
    """Of the train's front [m]."""
    speed: float
    """Of the foremost car [m/s]."""
    acceleration: float
    """Change of that speed over the last control period [m/s2]; 0 at the first."""
    torque: Floats
    """Torque of each motor of the units [N m], (units,)."""
    pressure: Floats
    """Brake cylinder pressures [Pa], (groups,)."""
    wheel_speed: Floats
    """Speed of each axle's tread [m/s], (axles,)."""


class Controls(NamedTuple):
    """What the driver sets, in place; it stays as set until changed."""

    torque: Floats
    """Torque wanted of each motor of the units [N m], (units,), negative braking."""
    pressure: Floats
    """Brake cylinder pressures wanted [Pa], (groups,); the plant delays them by each brake's dead time."""
    valve: Floats
    """Per brake group, (groups,): 0 the cylinder follows the pressure wanted, 1 it holds, 2 it releases."""
    sand: Floats
    """Sand that each sander lays on each rail [kg/s], (sanders,)."""


class Driver(Protocol):
    """A person or a speed control that drives the train."""

    def __call__(self, sense: TrainSense, controls: Controls) -> bool:
        """Set `controls` for the coming control period; False ends the run."""


# Speed command over time, with bounded acceleration: the speed command unit 1 and 11 of JP H07-322414.


@dataclass(frozen=True)
class SpeedCommand:
    """Target `speeds` [m/s] from each of `times` [s] on, reached with `acceleration` [m/s2] up or down.

    Before the first time the command is `initial` [m/s]. Raises `OnboardError` for what is no command.
    """

    times: tuple[float, ...]
    speeds: tuple[float, ...]
    acceleration: float
    initial: float = 0.0

    def __post_init__(self) -> None:
        if len(self.times) != len(self.speeds) or not self.times:
            raise OnboardError(
                f"speed command: {len(self.times)} times and {len(self.speeds)} speeds; give as many of each"
            )
        if any(not b > a for a, b in zip(self.times, self.times[1:], strict=False)):
            raise OnboardError(f"speed command: times {self.times} must grow")
        for name, values in (
            ("times", self.times), ("speeds", self.speeds), ("initial", (self.initial,)),
        ):  # fmt: skip
            if not all(math.isfinite(value) and value >= 0.0 for value in values):
                raise OnboardError(f"speed command: {name} = {values} must be finite, 0 or greater")
        if not (math.isfinite(self.acceleration) and self.acceleration > 0.0):
            raise OnboardError(
                f"speed command: acceleration = {self.acceleration!r} must be finite and greater than 0"
            )

    @cached_property
    def _ramps(self) -> tuple[Floats, Floats, Floats]:
        """Beginnings [s] of constant acceleration, speeds [m/s] there and accelerations [m/s2]."""
        ramps = [(-math.inf, self.initial, 0.0)]
        speed = self.initial
        ends = [*self.times[1:], math.inf]
        for begin, end, target in zip(self.times, ends, self.speeds, strict=True):
            rate = math.copysign(self.acceleration, target - speed) if target != speed else 0.0
            ramps.append((begin, speed, rate))
            arrived = begin + abs(target - speed) / self.acceleration
            if rate and arrived < end:
                ramps.append((arrived, target, 0.0))
            speed = target if arrived <= end else speed + rate * (end - begin)
        begin, at, rates = np.array(ramps).T
        return begin, at, rates

    def at(self, time: ArrayLike) -> tuple[Floats, Floats]:
        """Commanded speed V_c [m/s] and acceleration a_c [m/s2] at `time` [s], of its shape."""
        begin, at, rates = self._ramps
        time = np.asarray(time, dtype=float)
        k = np.searchsorted(begin, time + 1e-9, side="right") - 1
        since = np.where(np.isinf(begin[k]), 0.0, time - begin[k])
        return at[k] + rates[k] * np.maximum(since, 0.0), rates[k]


# Speed feedback: proportional, or proportional and integral with anti-windup (JP H07-322414, speed control 2, 12).


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
    ) -> Feedback:
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


# The switch command unit 187 of JP H07-322414, Fig. 6: learn on the feedback, then use what was learnt.


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


# Current, force and torque: from the speed control's current to all motors of the train.


@dataclass(frozen=True)
class Traction:
    """Every motor of the train gets the same torque within its limits; force F = I / K_i [N], braking electrically too.

    `rim_force` (units,) [N] at the rims of a unit per N m of each of its motors; `drive_limit`, `brake_limit`
    (units, EFFORT_TABLE_LENGTH) [N m]; `current_per_force` K_i [A/N].
    """

    rim_force: Floats
    drive_limit: Floats
    brake_limit: Floats
    current_per_force: float = 1e-3

    def __post_init__(self) -> None:
        OnboardError.check("traction", self, positive=("current_per_force",))

    @classmethod
    def of(cls, train: Train, current_per_force: float = 1e-3) -> Traction:
        """The traction of `train`; raises `OnboardError` where it has no motors. K_i = 1 A per kN is assumed."""
        force, drive, brake = [], [], []
        for car in train.cars:
            for axles in car.units():
                assert car.motors is not None
                force.append(len(axles) * car.motors.gear_ratio / car.wheel_radius)
                drive.append(car.motors.drive.tabulate(car.wheel_radius, car.motors.gear_ratio))
                brake.append(car.motors.brake.tabulate(car.wheel_radius, car.motors.gear_ratio))
        if not force:
            raise OnboardError(f"traction: train {train.name!r} has no motors")
        return cls(np.array(force), np.stack(drive), np.stack(brake), current_per_force)

    def limit(self, speed: float, braking: bool) -> Floats:
        """Largest torque of each unit's motors [N m] at `speed` [m/s], (units,)."""
        table = self.brake_limit if braking else self.drive_limit
        place = limit_place(speed, 1.0 / EFFORT_SPEED_STEP, table.shape[1])
        return np.asarray(look_up(table.T, place))

    def torques(self, current: float, speed: float) -> tuple[Floats, float]:
        """Torques [N m] (units,) for `current` [A] at `speed` [m/s], and the current that these stand for [A].

        Where a unit is at its limit the others do not take over what it lacks.
        """
        torque = current / self.current_per_force / float(self.rim_force.sum())
        limit = self.limit(speed, torque < 0.0)
        torques = np.minimum(np.maximum(torque, -limit), limit)
        return torques, float(self.rim_force @ torques) * self.current_per_force


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


class ResistanceLearner(Protocol):
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

    learner: ResistanceLearner | None = None
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
        detected = self._detection.read(sense.time, sense.position, sense.speed, sense.wheel_speed)
        position, speed = detected
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
