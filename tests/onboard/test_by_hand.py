"""Single steps of the computers on board, as plain Python on records made by hand, against numbers computed by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from alloc.onboard import sensing
from alloc.onboard.controllers.simple import CUT, FOLLOW, CutAndRamp, cut_and_ramp_unit


def plain(part):
    """The Python function of a compiled part."""
    return getattr(part, "py_func", part)


@pytest.mark.parametrize(
    ("rim", "seen"),
    [(1.0, 1.0), (1.04, 1.0), (1.06, 1.1), (1.09, 1.1), (-0.06, -0.1), (-0.04, 0.0)],
)
def test_a_quantised_speed_is_the_nearest_step(rim, seen):
    """Not the one below, which would make every train slower by half a step."""
    equipment = SimpleNamespace(
        axles=np.ones(1), unit_body=np.zeros(1, int), axle_body=np.zeros(1, int),
        axle_radius=np.array([0.5]), axle_unit=np.zeros(1, int),
    )  # fmt: skip
    settings = SimpleNamespace(sensors=SimpleNamespace(speed_quantum=0.1, pole=0.0), period=0.01)
    memory = SimpleNamespace(
        unit=SimpleNamespace(axles_seen=np.ones(1)), mean_speed=np.zeros(1), speed=np.zeros(1),
        reference=np.zeros(1), axle_omega=np.zeros(1), axle_seen=np.ones(1, bool),
        estimate=SimpleNamespace(radii=SimpleNamespace(factor=np.ones(1))),
    )  # fmt: skip
    omega, noise = np.array([(rim - 0.02) / 0.5]), np.array([0.02])
    plain(sensing._read_speeds)(equipment, settings, memory, omega, noise)
    assert memory.speed[0] == pytest.approx(seen, abs=1e-12)
    assert memory.axle_omega[0] == pytest.approx(seen / 0.5, abs=1e-12)


@pytest.mark.parametrize(("sign", "air"), [(1.0, 0.0), (-1.0, 2000.0)])
def test_cut_and_ramp_leaves_the_air_brake_its_part_of_the_rail(sign, air):
    """The rail carries 0.1 x 80 kN = 8 kN at each axle; at radius / gear = 0.5 m / 5 that is 800 N m at the motor.

    The shoes take 2 kN of it, 200 N m. The motors may have what is left, 600 N m, and are cut to 40 % of that.
    """
    equipment = SimpleNamespace(
        axle_load=np.array([1.0, 80e3]), radius=np.array([1.0, 0.5]), gear=np.array([1.0, 5.0])
    )
    unit = {
        "torque_command": sign * 900.0, "torque_target": sign * 900.0, "slipping": 1.0,
        "coefficient_estimate": 0.1,
    }  # fmt: skip
    memory = SimpleNamespace(
        unit=SimpleNamespace(**{name: np.array([0.0, value]) for name, value in unit.items()}),
        train=SimpleNamespace(expected=np.array([0.15])),
        air_force=np.array([0.0, air]),
    )
    kept = SimpleNamespace(phase=np.array([FOLLOW, FOLLOW]), clock=np.zeros(2), base=np.zeros(2))
    law = CutAndRamp(cut=0.4, recover=0.9)
    share = cut_and_ramp_unit(
        equipment, SimpleNamespace(period=0.01), memory, law, kept, 1, sign * 0.7
    )
    left = 800.0 - air / 10.0
    assert kept.phase.tolist() == [FOLLOW, CUT]
    assert kept.base[1] == pytest.approx(left, rel=1e-12)
    assert memory.unit.torque_command[1] == pytest.approx(sign * 0.4 * left, rel=1e-12)
    assert share == pytest.approx(0.4 * left / 900.0, rel=1e-12)
