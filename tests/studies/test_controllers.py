"""Controllers by name: built-in ones need nothing, hosted ones bring their factory, and a rehearsal asks each of them."""

import pytest

from alloc.onboard.host import TorqueDecision, each_unit
from alloc.plant import compiled
from alloc.simulation import CONTROLLERS
from studies.core.controllers import (
    HOSTED,
    controller_names,
    host_factories,
    rehearse,
    rehearse_plant,
)
from studies.core.study_error import StudyError
from studies.scenario.loading import load_scenario


class Recorder:
    """Host controller that remembers what it was asked."""

    asked: list = []  # noqa: RUF012 (one list for all units, read by the test)

    def __init__(self, context) -> None:
        self.context = context

    def decide(self, sense) -> TorqueDecision:
        self.asked.append((self.context, sense))
        return TorqueDecision(0.0, True, "ok", 0.0)


def test_built_in_controllers_need_no_factory():
    assert controller_names() == [*CONTROLLERS, "mpc", "mpc-car", "mpc-train", "mpc-train-ideal"]
    assert host_factories("none") == {}
    rehearse("cut-and-ramp")


def test_the_mpc_brings_its_factory():
    assert list(host_factories("mpc")) == ["mpc"]


def test_an_unknown_controller_is_refused():
    with pytest.raises(StudyError, match="did you mean 'cut-and-ramp'"):
        host_factories("cut-and-rampp")


def test_a_rehearsal_asks_what_a_unit_could_ask(monkeypatch):
    monkeypatch.setitem(HOSTED, "recorder", lambda: each_unit(Recorder))
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
