"""Files speak km/h, t and per mille, the code SI; the ending of a key is the only place where that is decided."""

import pytest

from alloc.units import UNITS
from studies.files.strict import Strict
from studies.files.units import si


class Everything(Strict):
    speed_kmh: float = 36.0
    rate_kmhs: float = 3.6
    load_t: tuple[float, ...] = (1.0, 2.5)
    grade_permille: float = 20.0
    slack_mm: float = 5.0
    start_m: float = 7.0
    time_s: float = 0.5
    pole_per_s: float = 25.0
    stiffness_n_per_m: float = 3e6
    stiffening_n_per_m3: float = 1e9
    damping_ns_per_m: float = 1e5
    factor: float = 0.6
    absent_m: float | None = None
    inner: Strict = Strict()


def test_every_ending_becomes_si_under_a_name_without_it():
    assert si(Everything()) == {
        "speed": pytest.approx(10.0),
        "rate": pytest.approx(1.0),
        "load": pytest.approx((1000.0, 2500.0)),
        "grade": pytest.approx(0.020),
        "slack": pytest.approx(0.005),
        "start": 7.0,
        "time": 0.5,
        "pole": 25.0,
        "stiffness": 3e6,
        "stiffening": 1e9,
        "damping": 1e5,
        "factor": 0.6,
    }


def test_no_ending_hides_a_longer_one():
    endings = [unit.ending for unit in UNITS]
    for k, ending in enumerate(endings):
        assert not any(longer.endswith(ending) for longer in endings[k + 1 :])
