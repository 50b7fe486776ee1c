"""The controllers that this package offers as `readhesion.controllers`; what they need is imported when they are built."""

from collections.abc import Sequence

from alloc.onboard.host import HostedController, TrainController, UnitContext, each_unit
from mpc.settings import MpcSettings


def _units(contexts: Sequence[UnitContext]) -> TrainController:
    from mpc.unit_controller import MpcController

    return each_unit(lambda context: MpcController(context, context.settings))(contexts)


def _cars(contexts: Sequence[UnitContext]) -> TrainController:
    from mpc.group_controller import CarControllers

    return CarControllers(contexts, contexts[0].settings)


def _train(contexts: Sequence[UnitContext]) -> TrainController:
    from mpc.train_controller import TrainMpc

    return TrainMpc(contexts, contexts[0].settings)


def _ideal_train(contexts: Sequence[UnitContext]) -> TrainController:
    from mpc.group_controller import GroupController

    return GroupController(contexts, contexts[0].settings)


MPC = HostedController(
    "mpc", "model predictive control of each unit (CasADi)", _units, "#0072b2", "P", MpcSettings
)
MPC_CAR = HostedController(
    "mpc-car",
    "MPC, the units of a car as one problem with load transfer",
    _cars,
    "#7b3294",
    "<",
    MpcSettings,
)
MPC_TRAIN = HostedController(
    "mpc-train",
    "MPC, allocation and readhesion as one problem over all units, by telegrams",
    _train,
    "#cc79a7",
    ">",
    MpcSettings,
)
MPC_TRAIN_IDEAL = HostedController(
    "mpc-train-ideal",
    "as mpc-train every control period and without delay: what no train has",
    _ideal_train,
    "#000000",
    "*",
    MpcSettings,
)
