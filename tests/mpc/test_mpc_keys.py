"""Settings of hosted controllers come from scenario files, reach the controller, and are read as strictly as the rest."""

from dataclasses import dataclass

import numpy as np
import pytest

from alloc.onboard.host import CONTROLLERS, HostedController, TorqueDecision, each_unit
from alloc.records import quantity
from alloc.simulation import simulate
from mpc.settings import MpcSettings, PeakBelief, SlipSearch, Weights
from studies.files.study_error import StudyError
from studies.scenario.loading import load_scenario
from studies.scenario.scenario import Scenario

EVENT = """
title = "one slippery second"
train = "commuter-8car"
duration_s = 1.0
record_period_s = 0.02
[[command]]
time_s = 0.0
acceleration_kmhs = 3.0
[rail]
level = 0.05
increments = { law = "logarithmic" }
"""
TABLES = ("mpc", "mpc_car", "mpc_train", "mpc_train_ideal")


@pytest.fixture
def load(tmp_path):
    """Scenario of `EVENT` with more keys."""

    def load(text: str = "") -> Scenario:
        path = tmp_path / "own.toml"
        path.write_text(EVENT + text)
        return load_scenario(path)

    return load


@pytest.mark.parametrize("table", TABLES)
def test_keys_give_the_settings_in_si(load, table):
    keys = f"""
[onboard.{table}]
horizon = 12
step_s = 0.02
[onboard.{table}.weights]
slip = 3.0
[onboard.{table}.belief]
pole_per_s = 20.0
[onboard.{table}.search]
seek = false
swing_time_s = 0.4
first_kmh = 0.72
friction_price_s_per_m = 0.4
"""
    assert load(keys).event(0).onboard.hosted == {
        table.replace("_", "-"): MpcSettings(
            horizon=12,
            step=0.02,
            weights=Weights(slip=3.0),
            belief=PeakBelief(pole=20.0),
            search=SlipSearch(
                seek=False, swing_time=0.4, first=0.72 * (1.0 / 3.6), friction_price=0.4
            ),
        )
    }


def test_each_controller_takes_its_own_settings_and_defaults_where_nothing_is_given(load):
    assert load().event(0).onboard.hosted == {}
    assert load("[onboard.mpc]\n").event(0).onboard.hosted == {"mpc": MpcSettings()}
    hosted = load("[onboard.mpc_car]\nheadroom = 0.3\n").event(0).onboard.hosted
    assert hosted == {"mpc-car": MpcSettings(headroom=0.3)}


@pytest.mark.parametrize("controller", ["mpc", "mpc-car", "mpc-train", "mpc-train-ideal"])
def test_settings_reach_the_controller(load, controller):
    event = load(f"[onboard.{controller.replace('-', '_')}]\nhorizon = 5\n").event(0)
    other = "mpc_car" if controller == "mpc" else "mpc"
    untouched = load(f"[onboard.{other}]\nhorizon = 5\n").event(0)
    short, usual, same = (
        simulate(one, "alone", controller)["torque_command"].values
        for one in (event, load().event(0), untouched)
    )
    assert not np.array_equal(short, usual)
    assert np.array_equal(same, usual)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("[onboard.mpc]\nhorizn = 5\n", "unknown key 'onboard.mpc.horizn'; did you mean 'horizon'?"),
        ("[onboard.mpc_car.weights]\nslp = 1.0\n", "unknown key 'onboard.mpc_car.weights.slp'; did you mean 'slip'?"),
        ("[onboard.mpc_trian]\nhorizon = 5\n", "unknown key 'onboard.mpc_trian'; did you mean 'mpc_train'?"),
        ("[onboard]\nhold_time = 5\n", "unknown key 'onboard.hold_time'; did you mean 'hold_time_s'?"),
        ("[onboard.mpc]\nhorizon = 1\n", "key 'onboard': mpc.horizon = 1 must be at least 2 steps"),
        ("[onboard.mpc]\nhorizon = 'long'\n", "key 'onboard.mpc.horizon' = 'long': input should be a valid integer"),
        ("[onboard]\nmpc = 3\n", "key 'onboard.mpc' = 3: input should be a valid dictionary"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_with_its_path(load, keys, words):
    with pytest.raises(StudyError) as error:
        load(keys)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_settings_are_part_of_the_scenario_and_survive_a_change(load):
    given = load("[onboard.mpc]\nhorizon = 12\n")
    assert len({load().hash(), given.hash(), load("[onboard.mpc]\nhorizon = 13\n").hash()}) == 3
    changed = given.changed(duration_s=2.0)
    assert changed.event(0).onboard.hosted == given.event(0).onboard.hosted
    assert given.changed(duration_s=1.0).hash() == given.hash()


def test_controllers_of_plugins_have_tables_too(load, monkeypatch):
    @dataclass(frozen=True)
    class GentleSettings:
        """How gentle it is."""

        share: float = quantity(0.5, "1")
        pause: float = quantity(1.0, "s")

    class Gentle:
        def __init__(self, context):
            self.settings = context.settings or GentleSettings()

        def decide(self, sense):
            return TorqueDecision(self.settings.share * sense.target, True, "ok", 0.0)

    monkeypatch.setattr(CONTROLLERS, "_parts", dict(CONTROLLERS._parts))
    monkeypatch.setattr(CONTROLLERS, "_origins", dict(CONTROLLERS._origins))
    gentle = HostedController(
        "gentle-one", "a share of the target", each_unit(Gentle), settings=GentleSettings
    )
    CONTROLLERS.register("gentle-one", gentle)
    event = load("[onboard.gentle_one]\nshare = 0.25\npause_s = 2\n").event(0)
    assert event.onboard.hosted == {"gentle-one": GentleSettings(0.25, 2.0)}
    for one, share in ((event, 0.25), (load().event(0), 0.5)):
        run = simulate(one, "alone", "gentle-one")
        assert run["torque_command"].values == pytest.approx(share * run["torque_target"].values)
    with pytest.raises(StudyError, match=r"'onboard\.gentle_one\.pause'; did you mean 'pause_s'"):
        load("[onboard.gentle_one]\npause = 2\n")
