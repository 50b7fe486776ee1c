"""A slip event as an environment of Gymnasium: the agent is the readhesion controller of some units of the train, or of all.

A step is a control period of `alloc.old.simulation`, so plant, sensors, telegrams and rule are those of every other run.
Needs the extra `gym`. Importing this module registers the environment as ``readhesion/train-v0``.
"""

from collections.abc import Sequence
from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium import spaces

from alloc.old.loop import CONTROL, NOTHING
from alloc.old.onboard.controllers.base import torque_per_coefficient
from alloc.old.onboard.controllers.collection import BUILT_IN, RESERVE
from alloc.old.onboard.host import EachUnit, HostedController, TorqueDecision, UnitSense
from alloc.old.plant.model import Floats
from alloc.old.rules import find_rule
from alloc.old.simulation import ControllerInPython, Simulation
from studies.core import StudyError
from studies.scenario import Scenario, load

TORQUES = ("torque", "target", "drive_limit", "brake_limit", "planned")
OTHERS = ("coefficient", "slipping", "in_service")
"""What `UnitSense` says beside speeds."""
MOST = 150.0
"""Bound of every observation: no train is as fast [m/s], and no coefficient as large."""
PRICE = 1e-4
"""Of a kilojoule of friction work, assumed: 100 kJ cost 1 % of the effort."""


class ReadhesionEnvironment(gymnasium.Env[Floats, Floats]):
    """One slip event per episode, truncated where it ends; then `simulation.recorded()` is the run.

    Action, (agent's units,): the share, 0 to 1, of its torque target that each unit commands. Observation, for each of them:
    speed, slip of each axle [m/s] against it, `TORQUES` as coefficients, `OTHERS`. Reward of a period: force along the
    demand at its start, within 0 and the true plan, over the plan's sum in the event, less `PRICE` times friction work [kJ].
    `info`: `time` [s], `event_seed`, and `reserve`, the action of the controller `others` here.

    `reset(seed=)` draws the event's seed, `options={"event_seed": k}` states it; 0 is the event as in its file. A copy, or
    what comes out of a pickle, has played the episode again up to that instant.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 (Gymnasium's own)

    def __init__(
        self,
        scenario: str | Scenario = "wet-patch",
        rule: str = "greedy",
        units: Sequence[int] | None = None,
        others: str = RESERVE,
    ) -> None:
        """`units`: numbers of the agent's, 0 = foremost; all if None. `others`: built-in controller of the rest.

        Raises `StudyError` for a unit, controller or rule that cannot be.
        """
        self.scenario = load(scenario) if isinstance(scenario, str) else scenario
        axles = self.scenario.event().equipment.axles
        self.units, self.rule, self.others = list(units or range(axles.size)), rule, others
        if not set(self.units) <= set(range(axles.size)):
            raise StudyError(f"units = {self.units} must be some of 0 to {axles.size - 1}")
        if others not in BUILT_IN:
            raise StudyError(f"others = {others!r} must be built in: {', '.join(BUILT_IN)}")
        if find_rule(rule).needs_truth:
            raise StudyError(f"under rule {rule!r} no readhesion controller acts")
        size = sum(1 + int(axles[j]) + len(TORQUES) + len(OTHERS) for j in self.units)
        self.observation_space = spaces.Box(-MOST, MOST, (size,), dtype=np.float64)
        self.action_space = spaces.Box(0.0, 1.0, (len(self.units),), dtype=np.float64)
        self._ended = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Start an event, and run to its first control instant."""
        super().reset(seed=seed)
        self._begin((options or {}).get("event_seed", int(self.np_random.integers(1, 2**31))))
        return self._seen()

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Command the torques, and run to the next control instant, or to the end of the event."""
        shares = np.array(action, dtype=np.float64)
        if self._ended or shares not in self.action_space:
            raise StudyError(f"action = {action}: {len(self.units)} of 0 to 1, after a reset")
        plant, asked = self.simulation.loop.plant, self._plan[len(self._played)]
        spent = plant.state[plant.rows.friction_work].sum()
        self._go_on(shares)
        work = 1e-3 * float(plant.state[plant.rows.friction_work].sum() - spent)
        force = np.sign(asked) * plant.workspace.noted.force.sum()  # at the start of the period
        effort = min(max(force, 0.0), abs(asked)) / (np.abs(self._plan).sum() or 1.0)
        seen, info = self._seen()
        return seen, float(effort - PRICE * work), False, self._ended, info

    def _begin(self, event_seed: int) -> None:
        agent = HostedController(
            "agent", "of Gymnasium", lambda _: EachUnit(()), reserve=self.others
        )
        event = self.scenario.event(event_seed)
        self.simulation, self._event_seed = Simulation(event, self.rule, agent), event_seed
        self._plan = self.simulation.given.commanded * event.model.train.mass
        self._played: list[Floats] = []
        self._go_on()

    def _go_on(self, shares: Floats | None = None) -> None:
        """Command these shares, and run to the next control instant; a rule in Python answers on the way."""
        run, tick = self.simulation, self.simulation.loop.progress.tick
        control = cast(ControllerInPython, run.parts[CONTROL])
        if shares is not None:
            self._played.append(shares)
            decisions: list[TorqueDecision | None] = [None] * len(self._senses)
            for j, share in zip(self.units, shares.tolist(), strict=True):
                decisions[j] = TorqueDecision(share * self._senses[j].target, True, "ok", 0.0)
            control.answer(decisions)
        while (need := run.go(run.loop.ticks)) not in (CONTROL, NOTHING):
            run.parts[need](int(tick[0]))
        self._ended = need == NOTHING
        self._senses: list[UnitSense] = control.senses(int(tick[0]))

    def _seen(self) -> tuple[Floats, dict[str, Any]]:
        """Observation and what is said beside it; at the end of the event with the readings of its last period."""
        values, reserve, computers = list[float](), list[float](), self.simulation.computers
        for j in self.units:
            one, eq = self._senses[j], computers.equipment
            values += [one.speed, *(eq.radius[j] * one.omega - one.speed)]
            values += [getattr(one, name) / torque_per_coefficient(eq, j) for name in TORQUES]
            values += [float(getattr(one, name)) for name in OTHERS]
            command = computers.memory.unit.torque_command[j]
            reserve.append(command / one.target if one.target else 1.0)
        about = {"time": self._senses[0].time, "event_seed": self._event_seed}
        return np.clip(values, -MOST, MOST), about | {"reserve": np.array(reserve)}

    def __getstate__(self) -> dict[str, Any]:
        left_out = ("simulation", "_senses")  # compiled memory cannot be copied
        return {name: one for name, one in vars(self).items() if name not in left_out}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        if "_event_seed" in state:
            self._begin(self._event_seed)
            for shares in state["_played"]:
                self._go_on(shares)


gymnasium.register(
    "readhesion/train-v0", entry_point=f"{__name__}:{ReadhesionEnvironment.__name__}"
)
