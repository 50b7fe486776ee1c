"""A slip event as an environment of Gymnasium: the agent is the readhesion controller of one unit, of some, or of all.

In: a scenario, a rule, and the built-in controller of the other units. A step is a control period of `alloc.simulation`, so
plant, sensors, telegrams and rule are those of every other run. Needs the extra `gym`. Importing this module registers the
environment as `readhesion/train-v0`.
"""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import gymnasium
import numpy as np
import xarray as xr
from gymnasium import spaces
from numpy.typing import NDArray

from alloc.loop import CONTROL, NOTHING
from alloc.metrics.use import bounds_at
from alloc.onboard.controllers.base import torque_per_coefficient
from alloc.onboard.controllers.collection import BUILT_IN, RESERVE
from alloc.onboard.host import EachUnit, HostedController, TorqueDecision, UnitSense
from alloc.plant.model import Floats
from alloc.plant.workspace import Noted
from alloc.recording import PlantRecord, physical_variables, planned_coefficient
from alloc.rules import find_rule
from alloc.simulation import ControllerInPython, Simulation
from studies.files.study_error import StudyError
from studies.scenario.scenario import Scenario, load_scenario

FRICTION_WEIGHT = 1e-4
"""Price of a kilojoule of friction work between wheels and rail: 100 kJ cost as much as 1 % of the effort. Assumed."""

FASTEST, MOST = 150.0, 10.0
"""Bounds of observations: of speeds [m/s], and of torques as coefficients."""

TORQUES = ("torque", "target", "drive_limit", "brake_limit", "planned")
"""Fields of `UnitSense` that are torques."""
OTHERS = {"coefficient": -MOST, "slipping": 0.0, "in_service": 0.0}
"""Its last ones, and their least values."""

MOST_DRAWN = 2**31
"""Seeds of events are drawn below this."""

Answer = tuple[NDArray[np.float64], float, bool, bool, dict[str, Any]]


class ReadhesionEnvironment(gymnasium.Env[NDArray[np.float64], NDArray[np.float64]]):
    """One slip event per episode, which is truncated at the end of the event; nothing terminates it.

    Action, (agent's units,): the share of its torque target, 0 to 1, that each unit commands. The target is what driver and
    rule want of the unit.

    Observation: what `UnitSense` says of each of the agent's units, as its sensors read it; `names` has what each number is.
    Torques are divided by that for a coefficient of 1. Slips [m/s] are those of each axle against the reference speed.

    Reward of a period: the effort at its start, within 0 and the true bound (as `bound_use` counts it), over the sum of what
    the driver asks for in the whole event (as `effort_ratio` does); less `friction_weight` times the friction work of all
    axles in it [kJ] (`damage`). So a return is the share of the plan that was delivered, less the price of the damage.

    `reset(seed=)` draws the seed of the event; `options={"event_seed": k}` states it, and 0 is the event as its file has it.
    `info` has the `time` [s], the `event_seed`, and the shares that the built-in controller of the others would command here
    (`reserve`, (agent's units,)); after a step also `effort` and `bound` [N] and `friction_work` [kJ].
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 (Gymnasium's own)

    def __init__(
        self,
        scenario: str | Scenario = "wet-patch",
        rule: str = "greedy",
        units: Sequence[int] | None = None,
        others: str = RESERVE,
        friction_weight: float = FRICTION_WEIGHT,
    ) -> None:
        """`units`: numbers of the agent's units, 0 = foremost, all of them if None. `others`: controller of the rest.

        Raises `StudyError` for a scenario, rule, unit or controller that cannot be.
        """
        self.scenario = load_scenario(scenario) if isinstance(scenario, str) else scenario
        event = self.scenario.event()
        eq, count = event.equipment, event.model.layout.units
        self.units = tuple(range(count)) if units is None else tuple(units)
        if not self.units or not set(self.units) <= set(range(count)):
            raise StudyError(
                f"environment: units = {self.units} must be some of the {count} units of scenario {self.scenario.name!r}, "
                "0 = foremost"
            )
        if others not in BUILT_IN:
            raise StudyError(
                f"environment: others = {others!r} must be a built-in controller: {', '.join(BUILT_IN)}"
            )
        if find_rule(rule).needs_truth:
            raise StudyError(f"environment: under rule {rule!r} no readhesion controller acts")
        self.rule, self.friction_weight = rule, friction_weight
        self._agent = HostedController(
            "agent", "an agent of Gymnasium", lambda _: EachUnit(()), reserve=others
        )
        self._full = {j: float(torque_per_coefficient(eq, j)) for j in self.units}
        self._radius = {j: float(eq.radius[j]) for j in self.units}
        bounds = {
            f"unit {j}: {name}": least
            for j in self.units
            for name, least in {
                "speed": -FASTEST,
                **{f"slip {i + 1}": -FASTEST for i in range(int(eq.axles[j]))},
                **dict.fromkeys(TORQUES, -MOST),
                **OTHERS,
            }.items()
        }
        self.names = tuple(bounds)
        """What each number of an observation is."""
        low = np.array(list(bounds.values()))
        self.observation_space = spaces.Box(low, np.where(low < 0.0, -low, 1.0), dtype=np.float64)
        self.action_space = spaces.Box(0.0, 1.0, (len(self.units),), dtype=np.float64)
        self._run: Simulation | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float64], dict[str, Any]]:
        """Start an event, and run to its first control instant."""
        super().reset(seed=seed)
        drawn = int(self.np_random.integers(1, MOST_DRAWN))
        event = self.scenario.event((options or {}).get("event_seed", drawn))
        self._run = Simulation(event, self.rule, self._agent)
        self._asked = np.abs(self._run.given.commanded).sum() * event.model.train.mass
        self._go_on()
        return self._seen()

    def step(self, action: NDArray[np.float64]) -> Answer:
        """Command the torques, and run to the next control instant, or to the end of the event."""
        shares = np.asarray(action, dtype=np.float64)
        if shares not in self.action_space:
            raise StudyError(
                f"environment: action = {action} must be {len(self.units)} numbers from 0 to 1"
            )
        if self._run is None or self._ended:
            raise StudyError("environment: there is no event under way; call reset first")
        run, n = self._run, self._run.loop.plant.rows
        decisions: list[TorqueDecision | None] = [None] * n.units
        for j, share in zip(self.units, shares.tolist(), strict=True):
            decisions[j] = TorqueDecision(share * self._senses[j].target, True, "ok", 0.0)
        self._controller.answer(decisions)
        computers = run.computers.memory
        command = run.loop.progress.commanded.copy()
        told = {
            "driver_command": command,
            "planned_coefficient": planned_coefficient(run.event.model, command, self._blended),
            "torque_factor": computers.unit.torque_factor[None].copy(),
        }
        state = run.loop.plant.state.copy()
        self._go_on()
        found = bounds_at(_instant(run, state, told, self._blended), slice(None))
        bound = float(found.bound[0])
        effort = min(max(float(found.force[0]), 0.0), bound)
        spent = run.loop.plant.state[n.friction_work] - state[n.friction_work]
        work = 1e-3 * float(spent.sum())
        reward = (effort / self._asked if effort else 0.0) - self.friction_weight * work
        seen, info = self._seen()
        info |= {"effort": effort, "bound": bound, "friction_work": work}
        return seen, float(reward), False, self._ended, info

    def recorded(self) -> xr.Dataset:
        """The run of an episode that has ended, for metrics and figures; raises `StudyError` before."""
        if self._run is None or not self._ended:
            raise StudyError("environment: the event has not ended; step until it is truncated")
        return self._run.recorded()

    @property
    def _blended(self) -> bool:
        event = cast(Simulation, self._run).event
        return event.model.layout.groups > 0 and event.onboard.braking.blended

    @property
    def _controller(self) -> ControllerInPython:
        return cast(ControllerInPython, cast(Simulation, self._run).parts[CONTROL])

    def _go_on(self) -> None:
        """Run to the next control instant; what else lives in Python answers on the way."""
        run = cast(Simulation, self._run)
        while (need := run.go(run.loop.ticks)) not in (CONTROL, NOTHING):
            run.parts[need](int(run.loop.progress.tick[0]))
        self._ended = need == NOTHING
        self._senses: list[UnitSense] = self._controller.senses(int(run.loop.progress.tick[0]))

    def _seen(self) -> tuple[NDArray[np.float64], dict[str, Any]]:
        """Observation and what is said beside it; at the end of the event with the readings of its last period."""
        run, values, reserve = cast(Simulation, self._run), list[float](), list[float]()
        for j in self.units:
            sense, full = self._senses[j], self._full[j]
            values += [sense.speed, *(self._radius[j] * sense.omega - sense.speed)]
            values += [getattr(sense, name) / full for name in TORQUES]
            values += [float(getattr(sense, name)) for name in OTHERS]
            command = run.computers.memory.unit.torque_command[j]
            reserve.append(command / sense.target if sense.target else 1.0)
        space = cast(spaces.Box, self.observation_space)
        seen = np.clip(np.nan_to_num(values, posinf=np.inf, neginf=-np.inf), space.low, space.high)
        about = {"time": self._senses[0].time, "event_seed": run.event.seed}
        return seen, about | {"reserve": np.array(reserve)}


def _instant(
    run: Simulation, state: Floats, told: dict[str, Floats], blended: bool
) -> xr.Dataset:
    """The instant at which the last control period began, with the `state` then, as far as bounds read it of a run."""
    plant, model = run.loop.plant, run.event.model
    noted = Noted(*(values[None] for values in plant.workspace.noted))
    time = np.array([(run.loop.progress.tick[0] - 1) * run.loop.timing.period])
    values = physical_variables(model, PlantRecord(time, state[None], noted)) | told
    # what metrics read of a dataset; to make one takes twice as long as all else in a step
    found = SimpleNamespace(
        variables={name: SimpleNamespace(values=one) for name, one in values.items()},
        sizes={"unit": model.layout.units},
        attrs={"blended_brakes": blended},
    )
    return cast(xr.Dataset, found)


gymnasium.register(
    "readhesion/train-v0", entry_point=f"{__name__}:{ReadhesionEnvironment.__name__}"
)
