"""One collection of readhesion controllers: nothing in the folder is forgotten, and names, colours, markers differ."""

import importlib
import pkgutil

import pytest

from alloc.errors import OnboardError
from alloc.onboard import controllers
from alloc.onboard.controllers.base import BuiltInController
from alloc.onboard.controllers.collection import BUILT_IN
from alloc.onboard.host import CONTROLLERS, HostedController, TorqueDecision, each_unit
from alloc.simulation import SimulationError, simulate


def test_every_controller_of_the_folder_is_built_in():
    for module in pkgutil.iter_modules(controllers.__path__):
        importlib.import_module(f"alloc.onboard.controllers.{module.name}")
    ours = {
        kind
        for kind in BuiltInController.__subclasses__()
        if kind.__module__.startswith("alloc.onboard.controllers")
    }
    assert ours == set(BUILT_IN.values())


@pytest.mark.parametrize("what", ["meaning", "colour", "marker"])
def test_controllers_differ(what):
    shown = [getattr(one, what) for one in CONTROLLERS.values()]
    assert len(set(shown)) == len(shown)


def test_a_controller_that_lacks_its_colour_is_refused():
    with pytest.raises(TypeError, match="Colourless: needs colour"):

        class Colourless(BuiltInController):
            name, meaning, marker, law = "colourless", "as its name", "o", None


class Gentle:
    """Passes half the target."""

    def decide(self, sense) -> TorqueDecision:
        return TorqueDecision(0.5 * sense.target, True, "ok", 0.0)


def test_a_registered_controller_runs_by_its_name(make_event, monkeypatch):
    monkeypatch.setattr(CONTROLLERS, "_parts", dict(CONTROLLERS._parts))
    monkeypatch.setattr(CONTROLLERS, "_origins", dict(CONTROLLERS._origins))
    gentle = HostedController("gentle", "half the target", each_unit(lambda context: Gentle()))
    CONTROLLERS.register("gentle", gentle)
    run = simulate(make_event(0.30, duration=2.0), "alone", "gentle")
    assert run.attrs["controller"] == "gentle"
    assert run["torque_command"].values == pytest.approx(0.5 * run["torque_target"].values)


def test_a_name_belongs_to_one_controller(monkeypatch):
    with pytest.raises(OnboardError, match="'none' exists already"):
        CONTROLLERS.register("none", HostedController("none", "another", each_unit(None)))


def test_an_unknown_controller_is_told_the_nearest_name(make_event):
    with pytest.raises(SimulationError, match="did you mean 'pi-creep'"):
        simulate(make_event(0.30), "alone", "pi-crep")
