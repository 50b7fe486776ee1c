"""Trains small enough to reason about, and a plain run of the compiled plant, shared by the plant's tests."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from alloc.plant import engine as compiled
from alloc.plant.model import Inputs, Layout, Model
from alloc.plant.train import AirBrake, Car, Motors, TorqueLimit, Train

AXLES = (2.5, 5.0, 15.0, 17.5)
RADIUS = 0.43
FLAT = TorqueLimit(4000.0, 0.0, table=(4000.0,))
"""The same limit at every speed, so that answers are known in closed form."""


@dataclass(frozen=True)
class Trace:
    """States (samples, rows) of a run, the rail's cleaning and sand (samples, axles), and the layout."""

    time: np.ndarray
    state: np.ndarray
    cleaning: np.ndarray
    sand: np.ndarray
    layout: Layout

    def rows(self, name: str) -> np.ndarray:
        """Rows of the state by the name they have in `Layout`, (samples, rows of that name)."""
        return self.state[:, getattr(self.layout, name)]


def make_car(is_driven=True, group="1C4M", mass=30e3, brake=True, **changes) -> Car:
    """A four-axle car; `changes` replace any of its fields."""
    fields = {
        "name": "motor car" if is_driven else "trailer",
        "length": 20.0,
        "empty_mass": mass,
        "load": 0.0,
        "axle_positions": AXLES,
        "bogie_of_axle": (0, 0, 1, 1),
        "wheel_radius": RADIUS,
        "wheel_inertia": ((150.0 if is_driven else 60.0),) * 4,
        "driven": (is_driven,) * 4,
        "motors": Motors(group, 7.0, FLAT, FLAT) if is_driven else None,
        "air_brake": AirBrake(400e3, 0.05, 0.4, 0.6, 0.1) if brake else None,
    }
    return Car(**(fields | changes))


@pytest.fixture(scope="session")
def car():
    """Factory of four-axle cars."""
    return make_car


@pytest.fixture(scope="session")
def train():
    """Factory of a train from a formation like "TMT"; further arguments as in `Train`."""

    def make(formation: str = "TMT", group="1C4M", brake=True, **options) -> Train:
        cars = tuple(make_car(kind == "M", group, brake=brake) for kind in formation)
        return Train(formation, cars, **options)

    return make


def _filled(shape, value, time) -> np.ndarray:
    values = np.asarray(value(time) if callable(value) else value, dtype=float)
    return np.broadcast_to(values, shape).copy()


@pytest.fixture(scope="session")
def run() -> Callable[..., Trace]:
    """Run the compiled plant; `command`, `pressure`, `valve` are values, arrays (rows,) or functions of time."""

    def advance(
        model: Model, duration, speed=0.0, *, command=0.0, pressure=0.0, valve=0.0, sand_rate=0.0, step=1e-3,
        sample=None, position=0.0, state=None,
    ) -> Trace:  # fmt: skip
        n = model.layout
        steps = 1 if sample is None else round(sample / step)
        state = model.initial_state(speed, position) if state is None else state.copy()
        w = compiled.workspace(model, step)
        time, states = [0.0], [state.copy()]
        cleaning, sand = [np.zeros(n.axles)], [np.zeros(n.axles)]
        for k in range(round(duration / (step * steps))):
            now = k * steps * step
            inputs = Inputs(
                _filled(n.units, command, now),
                _filled(n.groups, pressure, now),
                _filled(n.groups, valve, now),
                _filled(n.sanders, sand_rate, now),
            )
            end = compiled.advance(w, now, step, steps, state, inputs)
            time.append(end)
            states.append(state.copy())
            cleaning.append(w.scratch.cleaning.under[: n.axles].copy())
            sand.append(w.scratch.sand.under[: n.axles].copy())
        return Trace(*map(np.stack, (time, states, cleaning, sand)), n)

    return advance
