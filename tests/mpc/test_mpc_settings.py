"""Impossible settings are refused with a message that names them."""

import math

import pytest

from mpc.settings import MpcError, MpcSettings, PeakBelief, SlipSearch, Weights


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
