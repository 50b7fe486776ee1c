"""Rails that do not change, and what counts as torque that moves there."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from mpc.settings import SlipSearch
from studies.core.statement import FAILS, HOLDS
from studies.ladder.constant_rail_study import (
    CONTROLLERS,
    CYCLE,
    EVENTS,
    SETTLED,
    SHAPES,
    SLIP,
    STARTS,
    cells,
    constant_rail_statements,
    measure,
    scenario,
)

TIME = np.arange(0.0, 7.0, 0.01)
SWING = 1.0 / SlipSearch().swing_time


def run(relative, factor=0.5, slip=0.1):
    """A run of two units of an axle each whose commands are 1000 N m times 1 plus `relative` of time."""
    command = 1000.0 * (1.0 + np.asarray(relative)[:, None] * np.ones(2))
    return xr.Dataset(
        {
            "torque_command": (("time", "unit"), command),
            "torque_factor": (("time", "unit"), np.full(command.shape, factor)),
            "slip_velocity": (("time", "axle"), np.full(command.shape, slip)),
            "axle_unit": (("axle",), np.array([0, 1])),
        },
        coords={"time": TIME},
        attrs={"record_period": 0.01},
    )


def sine(frequency, amplitude=0.04):
    return amplitude * np.sin(2.0 * np.pi * frequency * TIME + 0.3)


def test_a_torque_that_only_swings_rests_beside_its_swing_whatever_its_shape():
    swing = sine(SWING, 0.1) + sine(2 * SWING, 0.05) + sine(9 * SWING, 0.02)
    found = measure(run(swing * (1.0 + 0.1 * TIME) + 0.01 * TIME))
    assert found["beside_swing"] < 1e-3
    assert found["greatest_line"] < 1e-3
    plain = measure(run(sine(SWING, 0.1)))
    assert plain["swinging"] == pytest.approx(0.1, rel=0.01)


@pytest.mark.parametrize("frequency", [1.0, 2.0, 3.4, 7.0, 12.0, 33.0])
def test_a_cycle_at_another_frequency_is_found_with_its_amplitude(frequency):
    found = measure(run(sine(frequency) + sine(SWING, 0.2)))
    assert found["beside_swing"] == pytest.approx(0.04, rel=0.2)
    assert found["greatest_line"] == pytest.approx(0.04, rel=0.25)


def test_a_trend_is_no_cycle():
    assert measure(run(0.02 * TIME + 0.003 * TIME**2))["swinging"] < 1e-3


def test_a_unit_without_torque_does_not_move_it():
    one = run(sine(3.0))
    one["torque_command"][:, 0] = 0.0
    assert measure(one)["beside_swing"] == pytest.approx(0.04, rel=0.2)
    one["torque_command"][:] = 0.0
    assert measure(one)["swinging"] == 0.0


def test_what_is_over_before_the_end_does_not_count():
    early = np.where(TIME[-1] - SETTLED - 0.1 > TIME, sine(3.0), 0.0)
    assert measure(run(early))["swinging"] < 1e-9


def test_units_that_are_not_limited_do_not_count():
    found = measure(run(sine(3.0), factor=1.0, slip=-2.5))
    assert found["limited_units"] == 0
    assert np.isnan(found["beside_swing"])
    assert found["greatest_slip"] == 2.5


@pytest.mark.parametrize("k", range(len(SHAPES)))
def test_a_rail_stays_as_it_is_and_offers_less_than_is_asked(k):
    event = scenario(5, k).event(k)
    rail = event.model.rail
    assert (rail.scatter, rail.increments, rail.patches) == (0.0, None, ())
    assert event.onboard.sensors.speed_noise == 0.0
    drawn = EVENTS.draw(5, k)
    offered = rail.curve.limit(rail.level, drawn["speed_kmh"] / 3.6)[0]
    wanted = drawn["share"] * STARTS[drawn["train"]].planned
    assert float(offered) == pytest.approx(wanted, rel=0.03)


def test_the_long_trains_come_as_often_as_is_said():
    trains = pd.Series([EVENTS.draw(5, k)["train"] for k in range(80)]).value_counts()
    assert trains.to_dict() == {
        "one inverter per car": 70, "one inverter per axle": 5, "sixteen cars": 5,
    }  # fmt: skip


def test_a_rail_is_measured_under_every_controller():
    jobs = cells(5, 0, duration=3.5)
    assert [job.controller for job in jobs] == list(CONTROLLERS)
    row = jobs[1].work({}).rows[0]
    assert {"greatest_slip", "beside_swing", "swinging", "greatest_line"} <= set(row)


def table(**changed):
    row = {
        "curve": "rational",
        "greatest_slip": 0.5,
        "swinging": 0.1,
        "beside_swing": 0.001,
        "greatest_line": 5e-4,
    }
    rows = [row | {"controller": one} for one in CONTROLLERS for _ in range(12)]
    rows[3] |= changed
    return pd.DataFrame(rows)


def test_one_rail_that_cycles_or_slips_breaks_the_statement():
    assert {one.verdict for one in constant_rail_statements(table())} == {HOLDS}
    for change, name in (
        ({"beside_swing": 2 * CYCLE}, "rest"),
        ({"greatest_slip": 1.1 * SLIP}, "slip"),
    ):
        found = {one.name: one for one in constant_rail_statements(table(**change))}
        assert {k for k, one in found.items() if one.verdict == FAILS} == {
            f"{name}: {CONTROLLERS[0]}"
        }
        assert found[f"{name}: {CONTROLLERS[0]}"].conditions == ("not on 1 of 12 rails",)
