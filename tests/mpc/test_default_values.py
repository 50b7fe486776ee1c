"""What a scenario means that leaves keys of the on-board computers or the MPC out: results of every study rest on these."""

import math
from dataclasses import fields, is_dataclass

import pytest

from alloc.onboard.parameters import Onboard
from mpc.settings import MpcSettings

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
        "deviation": 0.010, "drift": 0.0,
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


@pytest.mark.parametrize(("record", "expected"), [(Onboard(), ONBOARD), (MpcSettings(), MPC)])
def test_defaults_are_those_of_the_documents_and_trials_named_beside_them(record, expected):
    assert defaults(record) == expected


def test_what_no_file_sets_has_its_default_too():
    onboard = Onboard()
    assert onboard.sensors.seed == 0
    assert (onboard.belief.increments, onboard.belief.loads, onboard.hosted) == (None, None, {})
