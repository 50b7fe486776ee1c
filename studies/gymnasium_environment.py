"""A slip event as an environment of Gymnasium: the agent is the readhesion controller of some units of the train, or of all.

A step is a control period of `Simulation`, so plant, sensors, telegrams and rule are those of every other run. Needs
the extra `gym`. Importing this module registers the environment as ``readhesion/train-v0``. As a program it prints the
returns of `BASELINES`.
"""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
import pandas as pd
from gymnasium import spaces
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from alloc.onboard.controllers import CONTROLLERS
from alloc.plant.columns import WHEELSET
from alloc.rules import RULES
from alloc.run.simulation import COMMAND, Simulation
from studies import StudyError
from studies.files.scenario import Scenario
from studies.files.scenario_files import load_scenario
from studies.population import population
from studies.runner.rows import markdown_table
from studies.statistics import in_digits, mean

Floats = NDArray[np.float64]
TORQUES = ("motor_torque", "torque_target", "drive_limit", "brake_limit")
STATES = ("coefficient_estimate", "slipping", "works")
"""What a unit's row says beside speeds."""
MOST = 150.0
"""Bound of every observation: no train is as fast [m/s], and no coefficient as large."""
PRICE = 1e-4
"""Of a kilojoule of friction work, assumed: 100 kJ cost 1 % of the effort."""
BASELINES = ("none", "cut-and-ramp", "perturb-observe", "mpc")
"""Controllers whose returns an agent is compared with."""


class ReadhesionEnvironment(gymnasium.Env[Floats, Floats]):
    """One slip event per episode, truncated where it ends; then `simulation.recorded()` is the run.

    Action, (agent's units,): the share, 0 to 1, of its torque target that each unit commands. Observation, for each of them:
    reference speed, slip of each axle [m/s] against it, `TORQUES` and the plan as coefficients, `STATES`. Reward of a
    period: force along the demand at its start, within 0 and the true plan, over the plan's sum in the event, less `PRICE`
    times friction work [kJ]. `info`: `time` [s], `event_seed`, and `others`, the shares that the controller `others` would
    command.

    `reset(seed=)` draws the event's seed, `options={"event_seed": k}` states it; 0 is the event as in its file. A copy, or
    what comes out of a pickle, has played the episode again up to that instant. `render_mode="rgb_array"` gives pictures.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 100}  # noqa: RUF012 (Gymnasium's own)

    def __init__(
        self,
        scenario: str | Scenario = "wet-patch",
        rule: str = "cooperative",
        units: Sequence[int] | None = None,
        others: str = "perturb-observe",
        render_mode: str | None = None,
    ) -> None:
        """`units`: numbers of the agent's, 0 = foremost; all if None. `others`: controller of the rest.

        Raises `StudyError` for a unit that the train does not have, `InputError` for an unknown controller or rule.
        """
        if not isinstance(scenario, Scenario):
            scenario = load_scenario(scenario)
        self.scenario = scenario
        world = self.scenario.event().world()
        axles = world.units.last - world.units.first
        chosen = np.ravel(np.arange(axles.size) if units is None else units)
        self.units, self.rule, self.others = chosen.tolist(), rule, others
        whole = chosen.dtype.kind in "iu" and chosen.size > 0
        if not whole or len(set(self.units) & set(range(axles.size))) < chosen.size:
            raise StudyError(f"units = {self.units}: give distinct integers, 0 to {axles.size - 1}")
        CONTROLLERS.find(others)
        if RULES.find(rule).belief.knows:
            raise StudyError(f"under rule {rule!r} no readhesion controller acts")
        size = sum(2 + int(axles[j]) + len(TORQUES) + len(STATES) for j in self.units)
        self.observation_space = spaces.Box(-MOST, MOST, (size,), dtype=np.float64)
        self.action_space = spaces.Box(0.0, 1.0, (len(self.units),), dtype=np.float64)
        rate = round(1.0 / float(world.run[0].period))
        self.render_mode, self.metadata = render_mode, self.metadata | {"render_fps": rate}
        self._ended = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Start an event, and run to its first control instant."""
        super().reset(seed=seed)
        self._begin_event((options or {}).get("event_seed", int(self.np_random.integers(1, 2**31))))
        return self._observe_units()

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Command the torques, and run to the next control instant, or to the end of the event."""
        if self._ended:
            raise StudyError("no event runs; call reset first")
        try:
            shares = np.array(action, dtype=np.float64)
        except (TypeError, ValueError):
            shares = np.array([])
        if shares not in self.action_space:
            raise StudyError(f"action = {action!r:.80}: give {len(self.units)} numbers from 0 to 1")
        world = self.simulation.world
        spent = world.wheelsets.friction_work.sum()
        self._run_period(shares)
        work = 1e-3 * float(world.wheelsets.friction_work.sum() - spent)
        run, planned = world.run[0], self._plan[len(self._played) - 1]
        forces = self.simulation.recording.find_column(WHEELSET, "rail_force")
        # at the start of the period
        force = run.sign * float(forces[self.simulation.tick - 1].sum())
        effort = min(max(force, 0.0), abs(planned)) / (np.abs(self._plan).sum() or 1.0)
        observation, info = self._observe_units()
        return observation, float(effort - PRICE * work), False, self._ended, info

    def render(self) -> NDArray[np.uint8] | None:
        """The instant as a picture (240, 640, 3): adhesion and slip of all axles, those of the agent in orange."""
        if self.render_mode is None:
            return None
        run, axles = self.simulation.world.run[0], self.simulation.world.wheelsets
        figure, number = Figure(figsize=(6.4, 2.4), dpi=100), np.arange(1, axles.size + 1)
        left, right = figure.subplots(1, 2)
        figure.subplots_adjust(0.09, 0.2, 0.98, 0.88, 0.25)  # a constrained layout takes longer
        colours = np.where(np.isin(axles.unit, self.units), "tab:orange", "tab:blue").tolist()
        left.bar(number, axles.offered, width=0.9, color="0.85")
        left.bar(number, run.sign * axles.coefficient, width=0.6, color=colours)
        right.bar(number, run.sign * axles.slip_velocity, width=0.6, color=colours)
        left.set(xlabel="axle", ylabel="offered, carried [1]", ylim=(0.0, 0.3))
        right.set(xlabel="axle", ylabel="slip [m/s]", ylim=(0.0, 1.0))
        figure.suptitle(f"{run.time:.2f} s, {3.6 * axles.rim_speed.min():.0f} km/h")
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        return np.array(canvas.buffer_rgba())[..., :3]

    def _begin_event(self, event_seed: int) -> None:
        event = self.scenario.event(event_seed)
        self.simulation, self._event_seed = Simulation(event, self.rule, self.others), event_seed
        world = self.simulation.world
        self._plan = world.command * world.cars.mass.sum()
        self._played: list[Floats] = []
        self._ended = False
        self.simulation.run_to(COMMAND)  # as the controller `others` would

    def _run_period(self, shares: Floats) -> None:
        """Command these shares, and run to the next control instant."""
        self._played.append(shares)
        for j, share in zip(self.units, shares.tolist(), strict=True):
            row = self.simulation.world.units[j]
            row.torque_command = share * row.torque_target
        self.simulation.run_to(COMMAND)
        self._ended = self.simulation.tick == self.simulation.ticks

    def _observe_units(self) -> tuple[Floats, dict[str, Any]]:
        """Observation and what is said beside it; at the end of the event with the readings of its last period."""
        w, values, shares = self.simulation.world, list[float](), list[float]()
        run = w.run[0]
        for j in self.units:
            row = w.units[j]
            axles = w.axles[row.first : row.last]
            per = row.gear / (row.load * row.radius)
            values += [run.reference_speed, *(run.sign * (axles.reading - run.reference_speed))]
            values += [row[name] * per for name in TORQUES] + [run.plan]
            values += [float(row[name]) for name in STATES]
            shares.append(row.torque_command / row.torque_target if row.torque_target else 1.0)
        info = {"time": float(run.time), "event_seed": self._event_seed}
        return np.clip(values, -MOST, MOST), info | {"others": np.array(shares)}

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "simulation"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        if "_event_seed" in state:
            played = state["_played"]
            self._begin_event(self._event_seed)
            for shares in played:
                self._run_period(shares)


def play_event(environment: ReadhesionEnvironment, event_seed: int) -> float:
    """Return of an event in which the agent does as the controller `others`."""
    _, info = environment.reset(options={"event_seed": event_seed})
    total, ended = 0.0, False
    while not ended:
        _, reward, _, ended, info = environment.step(np.clip(info["others"], 0.0, 1.0))
        total += reward
    return total


def tabulate_returns(events: int) -> pd.DataFrame:
    """Returns of `BASELINES`, a row each: on `wet-patch`, and over the first `events` of the benchmark."""
    scenarios = [population.event(population.SEED, k) for k in range(events)]
    rows = []
    for name in BASELINES:
        patch = play_event(ReadhesionEnvironment(others=name), 0)
        returns = [play_event(ReadhesionEnvironment(x, others=name), 0) for x in scenarios]
        rows.append((name, patch, mean(returns).text(3), in_digits(min(returns), 3, False)))
    heads = ["controller", "wet-patch", f"{events} events of the benchmark [95 %]", "worst"]
    return pd.DataFrame(rows, columns=heads)


gymnasium.register(
    "readhesion/train-v0", entry_point=f"{__name__}:{ReadhesionEnvironment.__name__}"
)

if __name__ == "__main__":
    print(markdown_table(tabulate_returns(events=30)), end="")
