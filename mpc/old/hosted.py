"""The controllers that this package offers as `readhesion.controllers`; their modules are imported when they are built."""

from collections.abc import Sequence
from typing import Any

from alloc.old.onboard.host import (
    CompiledControllers,
    HostedController,
    TrainController,
    UnitContext,
    each_compiled,
    each_unit,
)
from mpc.old.settings import MpcSettings


def _hosted(name: str, meaning: str, colour: str, marker: str) -> HostedController:
    def build(contexts: Sequence[UnitContext]) -> TrainController | CompiledControllers:
        from mpc.old.group import CarControllers, GroupController
        from mpc.old.train import TrainMpc
        from mpc.old.unit import MpcController, OptiIteration, compiled_unit

        if name == "mpc":
            return each_compiled(lambda one: compiled_unit(one, one.settings))(contexts)
        if name == "mpc-opti":
            return each_unit(lambda one: MpcController(one, one.settings, OptiIteration))(contexts)
        joint: Any = {
            "mpc-car": CarControllers,
            "mpc-train": TrainMpc,
            "mpc-train-ideal": GroupController,
        }
        return joint[name](contexts, contexts[0].settings)

    return HostedController(name, meaning, build, colour, marker, MpcSettings)


MPC = _hosted("mpc", "model predictive control of each unit (CasADi)", "#aa39ff", "P")
MPC_CAR = _hosted(
    "mpc-car", "MPC, the units of a car as one problem with load transfer", "#713971", "<"
)
MPC_OPTI = _hosted(
    "mpc-opti", "as mpc, solved to convergence by CasADi: readable reference, slow", "#854bb8", "."
)
MPC_TRAIN = _hosted(
    "mpc-train", "MPC, allocation and readhesion as one problem over all units, by telegrams", "#8e8ee3", ">"
)  # fmt: skip
MPC_TRAIN_IDEAL = _hosted(
    "mpc-train-ideal", "as mpc-train every control period and without delay: what no train has", "#c6aae3", "*"
)  # fmt: skip
