"""Stand-alone learner of running resistance on a recorded run: JP H07-322414, claims 6 and 7, Fig. 7."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.display import displayed
from alloc.errors import EstimationError
from alloc.estimation.excitation import Excitation, judge_excitation
from alloc.estimation.finite_series import finite_series
from alloc.estimation.running_resistance import Learner
from alloc.onboard.speed_control.line_memory import LineMemory
from alloc.onboard.speed_control.resistance import EXTENDED_WEIGHTS, Motion, regressor
from alloc.onboard.speed_control.sampling import Regression, RegressionFilter

Floats = NDArray[np.float64]

Source = Literal["measured", "commanded"]


@displayed
@dataclass(frozen=True)
class RunLog:
    """Log of a run, all (samples,), evenly spaced: the only input of the learner.

    `force` [N]: of the motors at the rims, the current over K_i, over the interval that begins at its sample.
    `commanded_speed`, `commanded_acceleration`: V_c and a_c, for learning from these (the source's paragraph 0054).
    """

    time: Floats
    """[s]"""
    position: Floats
    """[m]"""
    speed: Floats
    """[m/s]"""
    force: Floats
    """[N]"""
    commanded_speed: Floats | None = None
    """[m/s]"""
    commanded_acceleration: Floats | None = None
    """[m/s2]"""

    def __post_init__(self) -> None:
        for name, values in vars(self).items():
            if values is not None:
                array = finite_series(f"resistance log: {name}", values, (np.size(self.time),))
                object.__setattr__(self, name, array)
        if self.time.size < 3:
            raise EstimationError("resistance log: time needs 3 samples at least")
        steps = np.diff(self.time)
        if steps.min() <= 0.0 or np.ptp(steps) > 1e-6 * max(float(steps.max()), 1.0):
            raise EstimationError("resistance log: time must grow in even steps; resample the log")

    @property
    def period(self) -> float:
        """Time between samples [s]."""
        return float(self.time[1] - self.time[0])

    @classmethod
    def of_run(cls, run: xr.Dataset, speed_noise: float = 0.0, seed: int = 0) -> "RunLog":
        """The log of a run recorded by `alloc.driving.drive` or `alloc.simulation.simulate`, without air brakes.

        The force is that of the motor torques as recorded, the mean over each interval; `speed_noise` [m/s] is added to the
        speed, drawn from `seed`.
        """
        unit = run["axle_unit"].values
        axles = np.bincount(unit[unit >= 0], minlength=run.sizes["unit"])
        per_torque = axles * run["unit_gear"].values / run["unit_radius"].values
        if "cylinder_pressure" in run and run["cylinder_pressure"].values.max(initial=0.0) > 1e3:
            raise EstimationError(
                "resistance log: air brakes acted in this run; leave braking out, their force is not known"
            )
        # the torque follows its command within milliseconds: what was asked of an interval acts at its end
        force = run["motor_torque"].values @ per_torque
        force = np.append(force[1:], force[-1])
        noise = np.random.default_rng(seed).standard_normal(force.size) * speed_noise
        return cls(
            run["time"].values, run["position"].values, run["car_speed"].values[:, 0] + noise, force
        )  # fmt: skip


@displayed
class Learnt(NamedTuple):
    """What was learnt from a run."""

    time: Floats
    """[s], (samples,)."""
    weights: Floats
    """After each sample, (samples, weights)."""
    error: Floats
    """Error of the force with the weights of that instant [N], (samples,)."""
    excitation: Excitation
    """Status of every weight, from all samples together."""


def learn_from_log(
    log: RunLog,
    memory: LineMemory,
    learner: Learner,
    rotating_mass: float = 0.0,
    filter_time: float = 0.0,
    train_length: float = 0.0,
    source: Source = "measured",
    keep: Callable[[Floats], NDArray[np.bool_]] | None = None,
) -> Learnt:
    """Let `learner` learn from `log`, as on board in Fig. 7: the error is force less W Z, with measured V and a.

    `rotating_mass` [kg] as in `alloc.onboard.speed_control.resistance`; `filter_time` [s]; `train_length` [m]: samples with
    a change of section or gradient under the train are left out. `source` "commanded": V_c and a_c in place of V and a.
    `keep` picks samples by time. Raises `EstimationError` for a log from which nothing can be learnt.
    """
    if source not in get_args(Source):
        raise EstimationError(f"resistance log: source = {source!r} must be measured or commanded")
    count = learner.weights.size
    middle = 0.5 * (log.position[1:] + log.position[:-1])
    speed = log.speed
    if source == "commanded":
        if log.commanded_speed is None or log.commanded_acceleration is None:
            raise EstimationError("resistance log: it holds no commanded speed and acceleration")
        speed, acceleration = log.commanded_speed, log.commanded_acceleration[:-1]
    else:
        acceleration = np.diff(speed) / log.period
    tunnel, slope = memory.read(middle)
    z = regressor(Motion(0.5 * (speed[1:] + speed[:-1]), acceleration, slope, tunnel), count)
    target = log.force[:-1] - rotating_mass * acceleration
    used = np.ones(middle.size, dtype=bool)
    if train_length > 0.0:
        used &= ~memory.straddled(middle, train_length)
    if keep is not None:
        used &= keep(log.time[:-1])
    if not used.any():
        raise EstimationError("resistance log: no sample is left to learn from")
    smooth = RegressionFilter(filter_time, log.period)
    history, filtered = np.full_like(z, np.nan), np.full_like(z, np.nan)
    errors, forces = np.full(middle.size, np.nan), np.full(middle.size, np.nan)
    for k in range(middle.size):
        if used[k]:
            raw = Regression(z[k], float(target[k]), 0.0, float(acceleration[k]))
            sample = smooth.add(raw, tunnel[k] > 0.5)
            if sample is not None:
                errors[k] = sample.target - float(learner.weights @ sample.regressor)
                learner.update(sample.regressor, errors[k], sample.acceleration)
                filtered[k], forces[k] = sample.regressor, sample.target
        else:
            smooth.restart()
        history[k] = learner.weights
    taken = np.isfinite(forces)
    if not taken.any():
        raise EstimationError("resistance log: no section is long enough for the filter to settle")
    excitation = judge_excitation(filtered[taken], forces[taken], EXTENDED_WEIGHTS[:count])
    return Learnt(log.time[:-1], history, errors, excitation)
