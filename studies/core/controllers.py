"""What a study asks of readhesion controllers: whether they can be had, and that they lie compiled in the cache."""

import numpy as np

from alloc.errors import OnboardError
from alloc.onboard.controllers.registry import CONTROLLERS
from alloc.onboard.host import HostedController, UnitContext, UnitSense
from alloc.plant import compiled
from alloc.plant.adhesion import PiecewiseCurve
from alloc.plant.equations import GRAVITY
from studies.files.study_error import StudyError
from studies.scenario.scenario import Scenario


def check_controller(name: str) -> None:
    """Raise `StudyError` where there is no controller of this name, or it needs what is not installed."""
    try:
        CONTROLLERS.find(name)
    except OnboardError as error:
        raise StudyError(str(error)) from None
    except (ImportError, AttributeError) as error:
        raise StudyError(
            f"controller {name!r} needs something that is not installed ({error}); "
            "run `make setup`, or leave it out with --controllers"
        ) from None


def is_hosted(name: str) -> bool:
    """Whether a controller runs in Python, which is slow."""
    return isinstance(CONTROLLERS.get(name), HostedController)


def rehearse_plant(scenario: Scenario) -> None:
    """Take one step of the scenario's train, so that the compiled integrator lies in the cache."""
    event = scenario.event(0)
    model = event.model
    w = compiled.workspace(model, event.longest_step)
    compiled.advance(w, 0.0, event.longest_step, 1, model.initial_state(), model.zero_inputs())


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
    hosted = CONTROLLERS.find(controller)
    if isinstance(hosted, HostedController):
        host = hosted.factory([context])
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
