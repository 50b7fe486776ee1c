"""Lanes of one model advanced on several threads: groups of lanes, each with its own state and workspace."""

import itertools
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from alloc.errors import PlantError
from alloc.plant.compiled import advance, workspace
from alloc.plant.model import Floats, Inputs, Model


class Batch:
    """Lanes of a model, advanced together; results do not depend on the number of threads."""

    def __init__(self, model: Model, state: Floats, step: float, threads: int = 2) -> None:
        """Split `model` into as many groups of lanes as `threads`, starting from `state` (rows, lanes).

        `step` [s] is the integration step. Raises `PlantError` for a state of the wrong shape or without threads.
        """
        if state.shape != (model.layout.rows, model.lanes):
            raise PlantError(
                f"batch: state has shape {state.shape}, the model needs {(model.layout.rows, model.lanes)}"
            )
        if threads < 1:
            raise PlantError(f"batch: threads = {threads} must be 1 or greater")
        self.step, self.threads = step, min(threads, model.lanes)
        bounds = np.linspace(0, model.lanes, self.threads + 1).round().astype(int)
        self._slices = [slice(int(a), int(b)) for a, b in itertools.pairwise(bounds)]
        self._models = [model.select_lanes(part) for part in self._slices]
        self._states = [np.ascontiguousarray(state[:, part]) for part in self._slices]
        self._workspaces = [workspace(part, step) for part in self._models]

    @property
    def state(self) -> Floats:
        """State of all lanes, (rows, lanes); a copy."""
        return np.concatenate(self._states, axis=1)

    def advance(self, time: float, steps: int, inputs: Inputs) -> float:
        """Advance all lanes from `time` [s] by `steps` steps with constant `inputs`; return the new time."""

        def one(k: int) -> float:
            model, part = self._models[k], self._slices[k]
            own = Inputs(*(np.ascontiguousarray(values[:, part]) for values in inputs))
            end: float = advance(
                model.structure, model.environment, model.layout,
                time, self.step, steps, self._states[k], own, self._workspaces[k],
            )  # fmt: skip
            return end

        with ThreadPoolExecutor(self.threads) as pool:
            return max(pool.map(one, range(self.threads)))
