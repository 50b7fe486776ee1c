"""Settings of the MPC and of the computers on board: defaults, keys of files, and what is refused."""

import math
from dataclasses import dataclass, fields, is_dataclass

import numpy as np
import pytest

from alloc.onboard.host import CONTROLLERS, HostedController, TorqueDecision, each_unit
from alloc.onboard.parameters import Onboard
from alloc.records import quantity
from alloc.simulation import simulate
from mpc.settings import MpcError, MpcSettings, PeakBelief, SlipSearch, Weights
from studies.core import StudyError
from studies.scenario import Scenario
from studies.scenario import load as load_scenario
from tests.cases import looped

KMH = 1.0 / 3.6


ONBOARD = {
    "none": {},
    "table": {"margin": 0.4 * KMH, "width": 0.2 * KMH, "rise": 1.8, "fall": 0.25, "time_constant": 0.18},
    "cut_and_ramp": {"cut": 0.5, "recover": 0.9, "hold": 0.1, "ramp": 3.0},
    "creep": {"reference": 0.085, "proportional": 0.4, "integral": 8.0},
    "perturb_observe": {"interval": 0.2, "step": 0.01, "lowest": 0.02, "highest": 0.5},
    "steepest_gradient": {
        "interval": 0.3, "gain": 0.15, "least": 0.01, "largest": 0.06, "lowest": 0.02, "highest": 0.5,
    },
    "fuzzy_creep": {"reference": 0.085, "rate": 1.7, "pole": 40.0},
    "fuzzy_tracking": {"least": 0.01, "largest": 0.04},
    "swarm_tracking": {"spread": 0.04, "seed": 1.0},
    "swarm_slip": {"largest": 0.02, "seed": 1.0},
    "cubature_seeking": {
        "cycle": 0.3, "amplitude": 0.015, "gain": 0.2, "largest": 0.03, "lag": 0.3, "lowest": 0.02, "highest": 0.5,
        "noise": 0.005,
    },
    "detector": {"on": 1.8, "off": 0.9, "pole": 40.0, "speed_on": 0.6},
    "observer": {"pole": 25.0},
    "telegrams": {"period": 0.1, "latency": 0.05, "jitter": 0.0, "loss": 0.0, "silence": 1.0},
    "sensors": {
        "speed_noise": 0.0, "speed_quantum": 0.0, "load_error": 0.0, "radius_error": 0.0, "sensorless_pole": None,
        "dropouts": (), "blind_share": 0.5,
    },
    "braking": {
        "blended": True, "blend_time": 4.0, "inertia_in_estimate": True, "release_speed": 0.5,
        "air_force": "pressure", "car_shares": None,
        "slide_protection": {
            "law": "threshold", "threshold": {"release": 0.15, "hold": 0.08},
            "fuzzy": {
                "sensitivity": 1.0, "slip": (0.0, 0.077716, 0.17027), "rate": (-3.5912, 0.0, 3.5912), "pole": 6.6789,
            },
            "period": 0.01, "cut_out_speed": 5.0 * KMH,
            "time_out": 10.0, "refill": 0.5,
        },
    },
    "reference": {
        "source": "estimate", "sensor": 0.005, "creep": 0.01, "creep_speed": 5.0, "repeat": 100.0,
        "radius_deviation": 0.01, "radii_compared": True,
        "relief": {
            "doubt": 0.05, "doubt_ratio": 0.004, "share": 0.4, "time": 0.06, "longest": 0.2, "return_time": 0.06,
            "pause": 0.3, "air_doubt": 0.06,
        },
    },
    "sanding": {
        "on_slide": True, "delay": 1.0, "hold": 5.0, "begin": math.inf, "until": math.inf, "least_speed": 16.0 * KMH,
    },
    # N_min, N_arg and N_z are assumed, as is the deviation; noise: JP5484215 par. 0055
    "learning": {
        "kind": "none", "reference": "received", "first": 10, "further": 5, "stored": 10.0, "noise": 0.012,
        "deviation": 0.010, "drift": 0.0, "update": "run", "weight": "all",
    },
    "trigger": "limited", "hold_time": 5.0, "rise_time": 1.0, "period": 0.01, "limit_rate": None, "inertia_in_limit": True,
}  # fmt: skip


MPC = {
    "horizon": 20, "step": 0.01, "headroom": 0.1, "iterations": 5, "tolerance": 0.01,
    "step_time": 1e-3, "deadline": 0.01, "computing_delay": 0, "compensated": True,
    "weights": {"slip": 2.0, "rate": 0.3},
    "belief": {"initial": 0.2, "pole": 25.0, "floor": 0.01, "ceiling": 0.5},
    "search": {
        "first": 0.08, "lowest": 0.02, "highest": 1.6, "noise_margin": 4.0, "friction_price": 0.15, "swing": 0.1,
        "swing_time": 0.2, "seek": True, "given_share": 1.0,
    },
    "group": {"steps": 3},
}  # fmt: skip


def defaults(record):
    """Values of a record by name, records in it likewise; not those that no file sets."""
    return {
        item.name: defaults(value) if is_dataclass(value := getattr(record, item.name)) else value
        for item in fields(record)
        if item.metadata.get("unit", "any")
    }


@looped(("record", "expected"), [(Onboard(), ONBOARD), (MpcSettings(), MPC)])
def test_defaults_are_those_of_the_documents_and_trials_named_beside_them(record, expected):
    assert defaults(record) == expected


def test_what_no_file_sets_has_its_default_too():
    onboard = Onboard()
    assert onboard.sensors.seed == 0
    assert (onboard.belief.increments, onboard.belief.loads, onboard.hosted) == (None, None, {})


@looped(
    ("kind", "field", "value"),
    [
        (MpcSettings, "horizon", 1),
        (MpcSettings, "horizon", 20.0),
        (MpcSettings, "horizon", True),
        (MpcSettings, "iterations", 0),
        (MpcSettings, "step", 0.0),
        (MpcSettings, "step", math.inf),
        (MpcSettings, "step", "10 ms"),
        (MpcSettings, "deadline", -1.0),
        (MpcSettings, "deadline", math.inf),
        (MpcSettings, "step_time", 0.0),
        (MpcSettings, "computing_delay", 2),
        (MpcSettings, "computing_delay", True),
        (MpcSettings, "headroom", -0.1),
        (MpcSettings, "weights", {"slip": 2.0}),
        (MpcSettings, "belief", None),
        (Weights, "slip", -1.0),
        (PeakBelief, "initial", 0.6),
        (PeakBelief, "floor", 0.3),
        (PeakBelief, "pole", None),
        (MpcSettings, "search", None),
        (MpcSettings, "group", None),
        (SlipSearch, "seek", 1),
        (SlipSearch, "swing", 1.0),
        (SlipSearch, "swing", 0.0),
        (SlipSearch, "swing_time", -0.2),
        (SlipSearch, "friction_price", -0.1),
        (SlipSearch, "noise_margin", math.inf),
        (SlipSearch, "lowest", 0.9),
        (SlipSearch, "first", 5.0),
        (SlipSearch, "highest", 0.001),
        (SlipSearch, "given_share", 0.0),
    ],
)
def test_bad_value_is_named(kind, field, value):
    with pytest.raises(MpcError, match=field) as caught:
        kind(**{field: value})
    assert repr(value) in str(caught.value)


def test_edges_are_allowed():
    MpcSettings(horizon=2, headroom=0.0, tolerance=0.0)
    Weights(slip=0.0, rate=0.0)
    SlipSearch(friction_price=0.0, noise_margin=0.0, lowest=0.1, first=0.1, highest=0.1)


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


@looped("table", TABLES)
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


@looped("controller", ["mpc", "mpc-car", "mpc-train", "mpc-train-ideal"])
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


@looped(("keys", "words"), [
        ("[onboard.mpc]\nhorizn = 5\n", "unknown key 'onboard.mpc.horizn'; did you mean 'horizon'?"),
        ("[onboard.mpc_car.weights]\nslp = 1.0\n", "unknown key 'onboard.mpc_car.weights.slp'; did you mean 'slip'?"),
        ("[onboard.mpc_trian]\nhorizon = 5\n", "unknown key 'onboard.mpc_trian'; did you mean 'mpc_train'?"),
        ("[onboard]\nhold_time = 5\n", "unknown key 'onboard.hold_time'; did you mean 'hold_time_s'?"),
        ("[onboard.mpc]\nhorizon = 1\n", "onboard.mpc.horizon = 1 must be at least 2 steps"),
        ("[onboard.mpc]\nhorizon = 'long'\n", "key 'onboard.mpc.horizon' = 'long': must be a number, without quotes"),
        ("[onboard]\nmpc = 3\n", "key 'onboard.mpc' = 3: must be a table"),
    ])  # fmt: skip
def test_what_cannot_be_is_refused_with_its_path(load, keys, words):
    with pytest.raises(StudyError) as error:
        load(keys)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_settings_are_part_of_the_scenario_and_survive_a_change(load):
    given = load("[onboard.mpc]\nhorizon = 12\n")
    assert len({load().text, given.text, load("[onboard.mpc]\nhorizon = 13\n").text}) == 3
    changed = given.changed(duration_s=2.0)
    assert changed.event(0).onboard.hosted == given.event(0).onboard.hosted
    assert given.changed(duration_s=1.0).text == given.text


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
