"""Impossible settings are refused with a message that names them."""

import math

import pytest

from mpc.settings import CurveBelief, MpcError, MpcSettings, PeakBelief, Weights


@pytest.mark.parametrize(
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
        (MpcSettings, "slip_limit", 0.0),
        (MpcSettings, "code", "fortran"),
        (MpcSettings, "weights", {"slip": 2.0}),
        (MpcSettings, "belief", None),
        (Weights, "tracking", 0.0),
        (Weights, "slip", -1.0),
        (Weights, "slip_scale", math.nan),
        (PeakBelief, "initial", 0.6),
        (PeakBelief, "floor", 0.3),
        (PeakBelief, "gain", 0.0),
        (PeakBelief, "pole", None),
        (MpcSettings, "curve", None),
        (MpcSettings, "group", None),
        (CurveBelief, "estimate", 1),
        (CurveBelief, "memory", 0.0),
        (CurveBelief, "smallest", 1.1),
        (CurveBelief, "largest", 0.9),
        (CurveBelief, "tested_share", 1.0),
    ],
)
def test_bad_value_is_named(kind, field, value):
    with pytest.raises(MpcError, match=field) as caught:
        kind(**{field: value})
    assert repr(value) in str(caught.value)


def test_edges_are_allowed():
    MpcSettings(horizon=2, headroom=0.0, tolerance=0.0)
    Weights(slip=0.0, rate=0.0)
    PeakBelief(probe=0.0, slip_error=0.0, noise_margin=0.0)
