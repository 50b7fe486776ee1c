"""Laws of readhesion control, over all controllers; a new one is tested by being registered."""

import math

import numpy as np
import pytest

from alloc.onboard.controllers import CONTROLLERS, register
from alloc.onboard.controllers import plain as controllers
from alloc.onboard.controllers.creep import lag_share
from alloc.onboard.controllers.plain import asymmetric_lag, torque_factor
from alloc.onboard.signatures import are_compiled, control
from alloc.schema.errors import InputError
from tests.cases import looped
from tests.wheel import SCALE, course, drive, plain, rows

ALL = list(CONTROLLERS.values())
SEARCHES = [one for one in ALL if "first" in one.settings]


def commands(controller, *args, **options):
    memory = controller.rows(1)[0]
    for unit, axles, run in course(*args, **options):
        controller.control(unit, axles, memory, run)
        yield unit.torque_command, unit.torque_target


@looped("controller", ALL)
def test_a_command_is_never_above_the_target_nor_below_zero(controller):
    for sign in (1.0, -1.0):
        told = np.array(list(commands(controller, 1, 600, sign)))
        assert (told[:, 0] >= 0.0).all()
        assert (told[:, 0] <= told[:, 1]).all()


@looped("controller", [one for one in ALL if are_compiled(one.control)])
def test_compiled_and_plain_are_equal_to_the_last_bit(controller):
    if "horizon" in controller.settings:
        controller = controller.tuned(horizon=4)  # plain Python is slow
    fast, slow = controller.rows(1)[0], controller.rows(1)[0]
    served = plain(controller.control)
    for one, other in zip(course(2, 150, -1.0), course(2, 150, -1.0), strict=True):
        controller.control(one[0], one[1], fast, one[2])
        with np.errstate(all="ignore"):  # as compiled code has it
            served(other[0], other[1], slow, other[2])
        assert one[0].tobytes() == other[0].tobytes()
        assert fast.tobytes() == slow.tobytes()


@looped("controller", ALL)
def test_the_other_way_round_it_is_the_same(controller):
    for sign in (1.0, -1.0):
        ahead = np.array(list(commands(controller, 3, 400, sign)))
        back = np.array(list(commands(controller, 3, 400, sign, backwards=True)))
        assert ahead == pytest.approx(back)


@looped("controller", ALL)
def test_on_a_dry_rail_the_command_follows_the_target(controller):
    slip, _, command, _ = drive(controller, lambda t: 0.4, 0.08, seconds=12.0)
    assert slip.max() < 0.05
    assert command[-100:] == pytest.approx(0.15, rel=0.01)


@looped("controller", ALL)
def test_after_a_slippery_patch_the_torque_returns(controller):
    _, _, command, _ = drive(controller, lambda t: 0.06 if 2.0 < t < 4.0 else 0.4, 0.15, 14.0)
    if controller.name != "none":
        assert command[200:400].min() < 0.09
    assert command[-50:] == pytest.approx(0.15, rel=0.02)


@looped("controller", [one for one in ALL if one.name != "none"])
def test_wheels_come_back_on_a_rail_that_stays_slippery(controller):
    slip, mu, _, _ = drive(controller, lambda t: 0.4 if t < 2.0 else 0.06, 0.15)
    assert slip[200:].max() < 12.0
    assert np.median(slip[-300:]) < 0.3
    assert 0.6 * 0.06 < np.mean(mu[-300:]) <= 0.06


@looped("controller", ALL)
def test_standing_without_a_demand_everything_stays_a_number(controller):
    unit, axles, run = rows()
    memory = controller.rows(1)[0]
    run.driver_command = run.plan = unit.motor_torque = 0.0
    for target in (0.0,) * 40 + (0.1 * SCALE,) * 5:
        unit.torque_target = target
        controller.control(unit, axles, memory, run)
        assert 0.0 <= unit.torque_command <= target
    assert unit.faults == 0


# searches


@looped(("controller", "best"), [(one, best) for one in SEARCHES for best in (0.06, 0.15)])
def test_a_search_climbs_to_the_peak_of_a_curve(controller, best):
    _, mu, _, _ = drive(controller, lambda t: 0.08, best, seconds=15.0)
    assert mu[-500:].mean() > 0.89 * 0.08  # held at 0.085 m/s, the slip gives 0.86 at the wide one


@looped("controller", SEARCHES)
def test_a_search_finds_a_wide_peak_with_noisy_sensors_too(controller):
    for best, noise in ((0.25, 0.0), (0.2, 0.01)):
        _, mu, _, _ = drive(controller, lambda t: 0.08, best, 15.0, noise)
        assert mu[-500:].mean() > 0.98 * 0.08


def test_steps_grow_with_the_slip_so_a_wide_peak_is_reached_within_seconds():
    """With steps of one size from 0.085 m/s to 0.5 m/s it would take 7 s."""
    slip, mu, *_ = drive(CONTROLLERS["perturb-observe"], lambda t: 0.08, 0.4, seconds=6.0)
    assert mu[300:400].mean() > 0.98 * 0.08
    assert slip[-100:].mean() < 0.55


@looped("period", (0.01, 0.02, 0.005, 0.03))
def test_an_interval_is_a_number_of_control_periods(period):
    one = CONTROLLERS["perturb-observe"]
    memory, (unit, axles, run) = one.rows(1)[0], rows(period=period)
    unit.torque_target, unit.worst_slip = 0.1 * SCALE, 0.5  # limited from the second period on
    references = []
    for _ in range(200):
        one.control(unit, axles, memory, run)
        references.append(memory.view(one.memory.dtype)[0].reference)
    moved = np.flatnonzero(np.diff(references))
    assert set(np.diff(moved)) == {math.ceil(0.2 / period - 1e-9)}


# cut-and-ramp, the paper's table


def cut(period=0.01, **settings):
    """Phases and commands of cut-and-ramp: slip for three periods, with a coefficient of 0.08."""
    one = CONTROLLERS["cut-and-ramp"].tuned(**settings)
    unit, axles, run = rows(period=period)
    memory, told = one.rows(1)[0], []
    unit.coefficient_estimate, unit.air, unit.torque_target = 0.08, 0.01 * unit.load, 0.1 * SCALE
    for k in range(1500):
        unit.slipping = int(10 <= k < 13)
        one.control(unit, axles, memory, run)
        told.append((memory.view(one.memory.dtype)[0].phase, unit.torque_command / SCALE))
    return np.array(told).T


@looped("period", (0.01, 0.02, 0.005, 0.03, 0.1 / 7))
def test_a_hold_is_a_number_of_control_periods(period):
    phases, _ = cut(period, hold=0.1)
    assert (phases == controllers.HOLD).sum() == math.ceil(0.1 / period - 1e-9)


def test_a_cut_is_of_what_the_rail_carries_beside_the_air_brake():
    phases, command = cut(cut=0.4, recover=0.8, ramp=2.0)
    assert command[phases == controllers.CUT] == pytest.approx(0.4 * 0.07)
    assert command[phases == controllers.HOLD] == pytest.approx(0.8 * 0.07)
    rising = command[(phases == controllers.RAMP) & (command < 0.0999)]
    assert np.diff(rising) == pytest.approx(0.15 / 2.0 * 0.01)  # by the plan in `ramp`
    assert command[-1] == pytest.approx(0.1)


def test_a_cut_that_does_not_help_ends_without_torque():
    one = CONTROLLERS["cut-and-ramp"]
    unit, axles, run = rows()
    unit.slipping, unit.coefficient_estimate, unit.torque_target = 1, 0.08, 0.1 * SCALE
    memory, told = one.rows(1)[0], []
    for _ in range(400):
        one.control(unit, axles, memory, run)
        told.append(unit.torque_command > 0.0)
    assert sum(told) == 300


def test_the_torque_factor_is_that_of_fig_5():
    found = [torque_factor(one, 0.1, 0.2) for one in (-1.0, 0.1, 0.15, 0.2, 0.3, 2.0)]
    assert found == pytest.approx([1.0, 1.0, 0.75, 0.5, 0.0, 0.0])


def test_the_lag_behind_the_table_has_two_time_constants():
    value, other, shares = 0.0, 1.0, (lag_share(1.8, 0.01), lag_share(0.25, 0.01))
    for _ in range(50):
        value, other = asymmetric_lag(value, 1.0, *shares), asymmetric_lag(other, 0.0, *shares)
    up, down = 1.0 - math.exp(-0.5 / 1.8), math.exp(-0.5 / 0.25)
    assert (value, other) == pytest.approx((up, down))


# parts


@looped("controller", ALL)
def test_tuned_changes_what_it_says_and_nothing_else(controller):
    for key in controller.settings:
        before = controller.memory.columns[key].default
        value = before + 1 if isinstance(before, int) else before * 0.9
        other = controller.tuned(**{key: value})
        assert other.control is controller.control
        assert other.settings == controller.settings
        rows, changed = controller.memory.rows(1), other.memory.rows(1)
        assert [one for one in rows.dtype.names if repr(rows[one]) != repr(changed[one])] == [key]
        assert controller.memory.columns[key].default == before


@looped("controller", [one for one in ALL if one.settings])
def test_a_parameter_that_cannot_be_is_named(controller):
    key = controller.settings[0]
    for value in (-1.0, math.nan, math.inf):
        with pytest.raises(InputError, match=f"{controller.name}: {key} = "):
            controller.tuned(**{key: value})
    with pytest.raises(InputError, match=f"did you mean '{key}'"):
        controller.tuned(**{key + "s": 1.0})


def test_bounds_that_cross_and_fractions_of_whole_numbers_are_refused():
    with pytest.raises(InputError, match="lowest must not exceed highest"):
        CONTROLLERS["perturb-observe"].tuned(lowest=0.6)
    with pytest.raises(InputError, match="a whole number"):
        CONTROLLERS["mpc"].tuned(horizon=4.5)
    with pytest.raises(InputError, match="from 1 to 30"):
        CONTROLLERS["mpc"].tuned(horizon=31)


@looped("controller", ALL)
def test_every_number_of_a_controller_has_a_unit_and_a_meaning(controller):
    assert controller.meaning
    for column in controller.memory.columns.values():
        assert column.unit
        assert column.meaning
    assert controller.rows(3).shape == (3, controller.memory.dtype.itemsize // 8)


def test_names_colours_and_markers_are_each_controllers_own():
    for about in ("name", "colour", "marker", "meaning", "control"):
        assert len({getattr(one, about) for one in ALL}) == len(ALL)


@looped("decorate", (control, lambda function: function))
def test_a_controller_of_ones_own_takes_three_lines(decorate):
    @decorate
    def cautious(unit, axles, memory, run):
        unit.torque_command = 0.9 * unit.torque_target

    controller = register("cautious", cautious, "a tenth less than asked for")
    assert CONTROLLERS.find("cautious") is controller
    torque = np.array(list(commands(controller, 4, 5)))
    assert torque[:, 0] == pytest.approx(0.9 * torque[:, 1])


@looped("controller", ALL)
def test_a_controller_writes_its_command_and_nothing_else(controller):
    memory = controller.rows(1)[0]
    for unit, axles, run in course(5, 50):
        before = unit.copy(), axles.tobytes(), run.tobytes()
        controller.control(unit, axles, memory, run)
        assert (axles.tobytes(), run.tobytes()) == before[1:]
        before[0].torque_command, before[0].faults = unit.torque_command, unit.faults
        assert unit.tobytes() == before[0].tobytes()
