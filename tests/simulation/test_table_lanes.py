"""Runs under the torque table in lanes are those of the simulation, and what does not fit into lanes is refused."""

import numpy as np
import pytest

from alloc.event import DriverCommand, Event, SimulationError
from alloc.onboard.controllers.simple import TorqueTable
from alloc.onboard.parameters import Onboard, ReferenceSpeed
from alloc.plant.adhesion import PiecewiseCurve
from alloc.plant.model import build
from alloc.plant.operations import WIDTH
from alloc.plant.rail import Patch, Rail
from alloc.plant.sets import find_set
from alloc.simulation import simulate
from studies.readhesion_paper.lanes import simulate_tables

COMMAND = DriverCommand((0.5,), (3.0 / 3.6,))
PERIOD, END = 2e-4, 6.0
TABLES = (TorqueTable(), TorqueTable(width=0.8 / 3.6), TorqueTable(margin=0.0, rise=1.0, fall=0.1))


def rail(low: float) -> Rail:
    """Adhesion falls in the third second, when the torque is half up."""
    return Rail(0.18, patches=(Patch(low / 0.18, begin=2.0, fade=0.02),))


@pytest.fixture(scope="module")
def train():
    return find_set("one-axle")


@pytest.fixture(scope="module")
def rails():
    return [rail(low) for low in (0.08, 0.06, 0.07)]


@pytest.fixture(scope="module")
def lanes(train, rails):
    return simulate_tables(train, rails, TABLES, COMMAND, 0.0, END, PERIOD)


@pytest.mark.parametrize("lane", range(len(TABLES)))
def test_a_lane_is_a_run(train, rails, lanes, lane):
    # who knows the speed takes no torque to learn it
    known = ReferenceSpeed(source="truth")
    onboard = Onboard(period=PERIOD, rise_time=PERIOD, table=TABLES[lane], reference=known)
    event = Event(
        "lane", build(train, rails[lane]), COMMAND, onboard, END, step=PERIOD, record_period=1e-3
    )
    run = simulate(event, "alone", "table")
    assert run["slip_velocity"].values.max() > 2.0 * run["peak_slip"].values.min(), "must slip"
    for name, values, scale in (
        ("slip_velocity", lanes.slip, 1.0),
        ("coefficient", lanes.coefficient, 0.1),
        ("motor_torque", lanes.torque, lanes.plan),
        ("torque_command", lanes.command, lanes.plan),
        ("torque_factor", lanes.factor, 1.0),
        ("adhesion_limit", lanes.peak, 0.1),
        ("peak_slip", lanes.peak_slip, 0.1),
    ):
        np.testing.assert_allclose(
            values[:, lane], run[name].values[:, 0], rtol=0.0, atol=1e-9 * scale, err_msg=name
        )
    np.testing.assert_allclose(lanes.speed[:, lane], run["speed"].values, atol=1e-9)
    np.testing.assert_allclose(lanes.time, run["time"].values, atol=1e-9)


def test_a_lane_does_not_depend_on_its_company(train, rails, lanes):
    many = WIDTH + 2
    crowd = simulate_tables(train, [rails[0]] * many, [TABLES[0]] * many, COMMAND, 0.0, 3.0, PERIOD)
    alone = lanes.slip[: crowd.time.size, 0]
    for lane in (0, WIDTH - 1, many - 1):
        np.testing.assert_allclose(crowd.slip[:, lane], alone, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "rails", "tables", "command", "said"),
    [
        ("one-axle", 2, 1, COMMAND, "2 rails and 1 tables"),
        ("one-axle", 0, 0, COMMAND, "at least one"),
        ("commuter-8car", 1, 1, COMMAND, "only one unit of one axle"),
        ("one-axle", 1, 1, DriverCommand((0.0,), (-0.5,)), "drive only"),
    ],
)
def test_what_does_not_fit_is_refused(name, rails, tables, command, said):
    with pytest.raises(SimulationError, match=said):
        simulate_tables(
            find_set(name), [rail(0.1)] * rails, [TABLES[0]] * tables, command, 0.0, 0.1, PERIOD
        )


def test_lanes_share_one_curve(train):
    others = [rail(0.1), Rail(0.18, curve=PiecewiseCurve(residual_ratio=0.5))]
    with pytest.raises(SimulationError, match="same adhesion curve"):
        simulate_tables(train, others, TABLES[:2], COMMAND, 0.0, 0.1, PERIOD)
