"""Controllers tuned alike: what one search with one budget gains on the ladder's events, judged on events it has not seen.

`docs/numbers.toml` takes a table of docs/controllers.md from here. The defaults that ship are not changed by it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from operator import attrgetter
from typing import Any

import cma
import numpy as np
import pandas as pd

from alloc.event import Event
from alloc.metrics import evaluate
from alloc.simulation import simulate
from mpc.settings import MpcSettings
from studies.ladder import events as ladder

MPC = "mpc"
PARAMETERS: Mapping[str, tuple[str, ...]] = {
    "cut-and-ramp": ("detector.pole", "detector.speed_on", "cut_and_ramp.hold", "cut_and_ramp.ramp"),
    "perturb-observe": ("perturb_observe.interval", "perturb_observe.step", "perturb_observe.highest"),
    "pi-creep": ("creep.reference", "creep.proportional", "creep.integral"),
    MPC: ("belief.pole", "search.friction_price", "search.swing_time"),
}  # fmt: skip
"""Controller -> the fields that are searched for: of the equipment, of the MPC's settings."""
WIDEST = 5.0
"""A parameter stays within this factor of its default, either way."""
STEP = 0.4
"""First standard deviation of the search, in the logarithm of a parameter."""
TOGETHER = 8
"""Candidates of a generation."""
OBJECTIVE = "bound_use"
"""What the search maximises, as a mean over events under the rule `alone`."""
COSTS = ("slip_time", "damage", "jerk_rms")


def drawn(seed: int, count: int) -> list[Event]:
    """Events of the ladder."""
    return [ladder.scenario(seed, k).event(k) for k in range(count)]


def _changed(record: Any, path: str, value: float) -> Any:
    """`record` with a field of it, or of a part of it, at another value."""
    name, _, rest = path.partition(".")
    return replace(
        record, **{name: _changed(getattr(record, name), rest, value) if rest else value}
    )


def equipped(event: Event, controller: str, settings: Mapping[str, float]) -> Event:
    """The event with these settings of the controller."""
    found: Any = MpcSettings() if controller == MPC else event.onboard
    for path, value in settings.items():
        found = _changed(found, path, value)
    own = replace(event.onboard, hosted={MPC: found}) if controller == MPC else found
    return replace(event, onboard=own)


def runs(events: list[Event], controller: str, settings: Mapping[str, float]) -> pd.DataFrame:
    """Objective and costs of each event under the controller with these settings."""
    found = [
        evaluate(simulate(equipped(one, controller, settings), "alone", controller))
        for one in events
    ]
    return pd.DataFrame(found)[[OBJECTIVE, *COSTS]]


def tuned(events: list[Event], controller: str, generations: int) -> dict[str, float]:
    """The settings that an evolution strategy finds: of all candidates the best."""
    names = PARAMETERS[controller]
    owner = MpcSettings() if controller == MPC else events[0].onboard
    default = np.array([attrgetter(name)(owner) for name in names])
    bound = float(np.log(WIDEST))
    search = cma.CMAEvolutionStrategy(
        np.zeros(len(names)), STEP, {"popsize": TOGETHER, "seed": 1, "bounds": [-bound, bound], "verbose": -9},
    )  # fmt: skip

    def settings(x: np.ndarray) -> dict[str, float]:
        return dict(zip(names, (default * np.exp(x)).tolist(), strict=True))

    for _ in range(generations):
        asked = search.ask()
        search.tell(asked, [-runs(events, controller, settings(x))[OBJECTIVE].mean() for x in asked])  # fmt: skip
    return settings(search.result.xbest)


def measured(
    seed: int, events: int, fresh_seed: int, fresh_events: int, generations: int, controllers: Sequence[str],
) -> pd.DataFrame:  # fmt: skip
    """A row per controller and fresh event: what tuning changes there; and one per parameter."""
    seen, fresh = drawn(seed, events), drawn(fresh_seed, fresh_events)
    tables = []
    for controller in controllers:
        names = PARAMETERS[controller]
        found = tuned(seen, controller, generations)
        before, after = runs(fresh, controller, {}), runs(fresh, controller, found)
        less = (after - before).add_suffix(", change")
        tables.append(
            pd.concat([before, less], axis=1).assign(controller=controller, parameter="all")
        )
        values = [
            {"controller": controller, "parameter": name, "value": found[name]} for name in names
        ]
        tables.append(pd.DataFrame(values))
    return pd.concat(tables, ignore_index=True)
