"""Controllers by name: built-in and hosted ones stand in one collection, and a rehearsal asks each that is hosted."""

import pytest

from alloc.onboard.controllers.collection import BUILT_IN
from alloc.onboard.controllers.registry import CONTROLLERS
from alloc.onboard.host import HostedController, TorqueDecision, each_unit
from alloc.plant import compiled
from studies.core.controllers import check_controller, is_hosted, rehearse, rehearse_plant
from studies.files.study_error import StudyError
from studies.scenario.loading import load_scenario


class Recorder:
    """Host controller that remembers what it was asked."""

    asked: list = []  # noqa: RUF012 (one list for all units, read by the test)

    def __init__(self, context) -> None:
        self.context = context

    def decide(self, sense) -> TorqueDecision:
        self.asked.append((self.context, sense))
        return TorqueDecision(0.0, True, "ok", 0.0)


def test_built_in_controllers_are_not_hosted():
    assert list(CONTROLLERS) == [*BUILT_IN, "mpc", "mpc-car", "mpc-train", "mpc-train-ideal"]
    assert not any(is_hosted(name) for name in BUILT_IN)
    rehearse("cut-and-ramp")


@pytest.mark.parametrize("name", ["mpc", "mpc-car", "mpc-train", "mpc-train-ideal"])
def test_the_mpc_is_found_by_its_name(name):
    assert is_hosted(name)
    assert CONTROLLERS[name].name == name
    assert CONTROLLERS.origin(name) == "mpc.hosted"
    check_controller(name)


def test_an_unknown_controller_is_refused():
    with pytest.raises(StudyError, match="did you mean 'cut-and-ramp'"):
        check_controller("cut-and-rampp")


def test_a_controller_whose_package_lacks_something_is_refused(monkeypatch):
    class Missing(dict):
        def __getitem__(self, name):
            raise ModuleNotFoundError("No module named 'solver'")

    monkeypatch.setattr(CONTROLLERS, "_parts", Missing(lacking=None))
    with pytest.raises(StudyError, match=r"'lacking' needs .* not installed \(No module named"):
        check_controller("lacking")


def test_a_rehearsal_asks_what_a_unit_could_ask(monkeypatch):
    recorder = HostedController("recorder", "remembers what it was asked", each_unit(Recorder))
    monkeypatch.setitem(CONTROLLERS._parts, "recorder", recorder)
    rehearse("recorder")
    times = [sense.time for _, sense in Recorder.asked]
    assert times == sorted(set(times))
    for context, sense in Recorder.asked:
        assert sense.omega.shape == (context.axles,)
        assert sense.omega * context.radius == pytest.approx(sense.speed)


def test_one_step_of_the_plant_is_all_that_is_rehearsed():
    # the integrator is compiled, or found compiled; the scenario itself is left as it was
    scenario = load_scenario("wet-start").changed(duration_s=0.2)
    before = scenario.hash()
    rehearse_plant(scenario)
    assert compiled.advance.signatures
    assert scenario.hash() == before
