"""The controllers with default settings, as a simulation takes them: `TrainControllerFactory`, but for `factory`."""

from collections.abc import Sequence

from alloc.onboard.host import TrainControllerFactory, UnitContext, each_unit
from mpc.group_controller import CarControllers, GroupController
from mpc.train_controller import TrainMpc
from mpc.unit_controller import MpcController


def factory(context: UnitContext) -> MpcController:
    """Controller of a unit; a `HostControllerFactory`."""
    return MpcController(context)


unit_factory: TrainControllerFactory = each_unit(factory)
"""Every unit for itself."""


def car_factory(contexts: Sequence[UnitContext]) -> CarControllers:
    """All units of a car as one problem."""
    return CarControllers(contexts)


def train_factory(contexts: Sequence[UnitContext]) -> TrainMpc:
    """All units of the train as one problem, over telegrams."""
    return TrainMpc(contexts)


def ideal_train_factory(contexts: Sequence[UnitContext]) -> GroupController:
    """All units of the train as one problem every control period, as if telegrams took no time.

    What no train has: the joint optimum against which distributed control is measured.
    """
    return GroupController(contexts)
