"""Readhesion model predictive control of a traction unit, a car or a train, on the plant's own equations.

`mpc.hosted` offers the controllers by name: "mpc", every unit for itself; "mpc-car", the units of a car as one problem;
"mpc-train", the train over telegrams; "mpc-train-ideal", the train without delay. Classes take other settings::

    simulate(event, "greedy", "mpc")
    simulate(event, "alone", HostedController("mine", "", lambda contexts: TrainMpc(contexts, settings)))

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
