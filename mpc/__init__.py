"""Readhesion model predictive control of a traction unit, a car or a train, on the plant's own equations.

What `alloc.simulation.simulate` takes as host controllers: `each_unit(factory)`, every unit for itself; `car_factory`, the
units of a car as one problem; `train_factory`, the train over telegrams; `ideal_train_factory`, the train without delay.
Classes take other settings::

    simulate(event, "greedy", "mpc", {"mpc": each_unit(factory)})
    simulate(event, "alone", "mpc-train", {"mpc-train": lambda contexts: TrainMpc(contexts, settings)})

`MpcError` is raised for settings that cannot be.
"""

from mpc.controller import MpcController, factory
from mpc.group_controller import (
    CarControllers,
    GroupController,
    car_factory,
    ideal_train_factory,
)
from mpc.group_settings import GroupSettings
from mpc.settings import CurveBelief, MpcError, MpcSettings, PeakBelief, Weights
from mpc.train_controller import TrainMpc, train_factory

__all__ = [
    "CarControllers",
    "CurveBelief",
    "GroupController",
    "GroupSettings",
    "MpcController",
    "MpcError",
    "MpcSettings",
    "PeakBelief",
    "TrainMpc",
    "Weights",
    "car_factory",
    "factory",
    "ideal_train_factory",
    "train_factory",
]
