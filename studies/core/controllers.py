"""Readhesion controllers by name: those built into the simulation, and those hosted in Python."""

from collections.abc import Callable

import numpy as np

from alloc.onboard.host import TrainControllerFactory, UnitContext, UnitSense
from alloc.plant import compiled
from alloc.plant.adhesion import PiecewiseCurve
from alloc.plant.equations import GRAVITY
from alloc.simulation import CONTROLLERS
from studies.core.study_error import StudyError, unknown
from studies.scenario.scenario import Scenario


def _mpc() -> TrainControllerFactory:
    from mpc.factories import unit_factory

    return unit_factory


def _mpc_car() -> TrainControllerFactory:
    from mpc.factories import car_factory

    return car_factory


def _mpc_train() -> TrainControllerFactory:
    from mpc.factories import train_factory

    return train_factory


def _mpc_train_ideal() -> TrainControllerFactory:
    from mpc.factories import ideal_train_factory

    return ideal_train_factory


HOSTED: dict[str, Callable[[], TrainControllerFactory]] = {
    "mpc": _mpc,
    "mpc-car": _mpc_car,
    "mpc-train": _mpc_train,
    "mpc-train-ideal": _mpc_train_ideal,
}
"""Name -> function that imports the controller's package and gives its factory; imported when it is asked for."""


def controller_names() -> list[str]:
    """All controllers, built-in ones first."""
    return [*CONTROLLERS, *HOSTED]


def host_factories(controller: str) -> dict[str, TrainControllerFactory]:
    """Factory of a hosted controller under its name; empty for a built-in one. Raises `StudyError` if it cannot be had."""
    if controller in CONTROLLERS:
        return {}
    if controller not in HOSTED:
        raise unknown("controller", controller, controller_names())
    try:
        return {controller: HOSTED[controller]()}
    except (ImportError, AttributeError) as error:
        raise StudyError(
            f"controller {controller!r} needs something that is not installed ({error}); "
            "run `make setup`, or leave it out with --controllers"
        ) from None


def rehearse_plant(scenario: Scenario) -> None:
    """Take one step of the scenario's train, so that the compiled integrator lies in the cache."""
    event = scenario.event(0)
    model = event.model
    compiled.advance(
        model.structure, model.environment, compiled.rows(model.layout), 0.0, event.step, 1,
        model.initial_state(), model.zero_inputs(), compiled.workspace(model, event.step),
    )  # fmt: skip


def rehearse(controller: str) -> None:
    """Build a hosted controller for some unit and ask it a few times, so that what it compiles lies in the cache."""
    axles, radius, speed, period = 4, 0.43, 5.0, 0.01
    context = UnitContext(
        unit=0,
        axles=axles,
        radius=radius,
        inertia=155.0,
        gear_ratio=7.0,
        axle_load=8e3 * GRAVITY,
        mass=60e3,
        torque_lag=5e-3,
        curve=PiecewiseCurve(),
        period=period,
    )
    for factory in host_factories(controller).values():
        host = factory([context])
        for k in range(3):
            sense = UnitSense(
                time=k * period,
                speed=speed,
                omega=np.full(axles, speed / radius),
                torque=400.0,
                target=500.0,
                drive_limit=1e3,
                brake_limit=1e3,
                coefficient=0.1,
                slipping=False,
            )
            host.decide([sense])
