"""Trains whose axles, cars, units and brakes fill no whole block are computed as any other."""

from itertools import pairwise

import numpy as np
import pytest

from alloc.plant import engine as compiled
from alloc.plant.adhesion import POLACH_WET, PiecewiseCurve, SlipRatioCurve
from alloc.plant.array_model import ArrayModel
from alloc.plant.model import Inputs, build
from alloc.plant.operations import WIDTH
from alloc.plant.rail import Line, Patch, Rail, Receptivity
from alloc.plant.sets import SETS
from alloc.plant.train import AirBrake, Coupler, Motors, Train
from tests.compiled_part import from_python
from tests.plant.conftest import FLAT, make_car
from tests.plant.numpy_plant import environment_at, right_side, runge_kutta_step

STEP, START = 1e-3, 0.3
COUNTS = (1, WIDTH - 1, WIDTH, WIDTH + 1, 2 * WIDTH + 1)
LINE = Line((0.0, 30.0), (0.0, 0.02), ((20.0, 60.0),), 2.0, curves=((0.0, 20.0, 400.0),))
BRAKE = AirBrake(400e3, 0.05, 0.4, 0.6, 0.0, (37.5, 75.0, 0.5))
"""Without dead time: the NumPy plant has none."""


def _car(axles):
    """A car of so many axles, one unit each, the last one without a motor where there are several."""
    return make_car(
        length=3.0 * axles,
        axle_positions=tuple(1.5 + 3.0 * k for k in range(axles)),
        bogie_of_axle=tuple(k // 2 for k in range(axles)),
        wheel_inertia=tuple(100.0 + 10.0 * k for k in range(axles)),
        driven=tuple(k < max(axles - 1, 1) for k in range(axles)),
        motors=Motors("1C1M", 7.0, FLAT, FLAT),
        air_brake=BRAKE,
    )


def _train(count, coupled):
    """A rigid car of `count` axles, or `count` coupled cars of one axle."""
    resistance = (3e3, 60.0, 8.0)
    if not coupled:
        return Train("one car", (_car(count),), resistance, load_transfer=True)
    gear = Coupler(stiffness=5e6, stiffening=1e9, damping=1e5, slack=0.01)
    return Train("cars", (_car(1),) * count, resistance, (gear,) * (count - 1), True)


def _plant(train, curve=POLACH_WET):
    rail = Rail(
        0.25, scatter=0.01, seed=4, curve=curve,
        increments=tuple(np.linspace(0.0, 0.02, train.axle_count)),
        patches=(Patch(0.5, start=-8.0, edge=3.0), Patch(0.9, begin=0.305, until=9.0, fade=0.01)),
    )  # fmt: skip
    return build(
        train, rail, LINE, Receptivity(0.8, 0.1, 0.5), {0: 0.312} if train.cars[0].motors else {}
    )


def _start(model, seed=0):
    """A state in which wheels slip and slide and couplers are stretched, and inputs."""
    n, rng = model.layout, np.random.default_rng(seed)
    state = model.initial_state(12.0, 25.0)
    state[n.position] += rng.uniform(-0.02, 0.02, n.bodies) * (n.bodies > 1)
    state[n.speed] += rng.uniform(-0.2, 0.2, n.bodies) * (n.bodies > 1)
    state[n.omega] *= rng.uniform(0.9, 1.1, n.axles)
    state[n.torque], state[n.pressure] = rng.uniform(-9e2, 9e2, n.units), 1e4
    inputs = Inputs(
        rng.uniform(-2e3, 2e3, n.units),
        rng.uniform(0.0, 5e4, n.groups),
        rng.integers(0, 3, n.groups).astype(float),
        np.zeros(n.sanders),
    )
    return state, inputs


def _close(actual, expected, layout, tolerance):
    for name in ("position", "speed", "omega", "torque", "pressure", "friction_work", "work"):
        part = getattr(layout, name)
        scale = np.abs(expected[part]).max(initial=0.0)
        np.testing.assert_allclose(
            actual[part], expected[part], rtol=0.0, atol=tolerance * scale, err_msg=name
        )


@pytest.mark.parametrize("coupled", [False, True], ids=["one car", "coupled cars"])
@pytest.mark.parametrize("count", COUNTS)
def test_a_train_of_any_length_runs_as_the_numpy_plant(count, coupled):
    model = _plant(_train(count, coupled))
    state, inputs = _start(model)
    expected, rate = state, right_side(model, inputs)
    steps = 20
    for k in range(steps):
        expected = runge_kutta_step(rate, START + k * STEP, STEP, expected)
    w = compiled.workspace(model, STEP)
    moved = np.abs(expected - state).max()
    assert compiled.advance(w, START, STEP, steps, state, inputs) == START + steps * STEP
    _close(state, expected, model.layout, 1e-11)
    assert moved > 1.0


@pytest.mark.parametrize("coupled", [False, True], ids=["one car", "coupled cars"])
@pytest.mark.parametrize("count", COUNTS)
def test_what_fills_a_block_up_stays_nothing(count, coupled):
    model = _plant(_train(count, coupled))
    state, inputs = _start(model)
    w = compiled.workspace(model, STEP)
    compiled.advance(w, START, STEP, 20, state, inputs)
    for values in (w.scratch.state, w.scratch.slope):
        np.testing.assert_array_equal(np.delete(values, w.place), 0.0)
    np.testing.assert_array_equal(w.scratch.state[w.place], state)


@pytest.mark.parametrize("name", SETS)
def test_what_was_noted_is_the_right_side_at_the_first_instant(name):
    model = _plant(SETS[name]())
    n, w, arrays = model.layout, compiled.workspace(model, STEP), ArrayModel.of(model)
    state, inputs = _start(model)
    inputs.pressure_target[:], inputs.valve[:] = 0.0, 1.0  # the rate of the pressures is not noted
    time, step = START, STEP / model.substeps(STEP)
    for steps in (3, 2):
        local = environment_at(model, time, state)
        rate = arrays.derivative(state, inputs, local)[n.speed]
        time = compiled.advance(w, time, step, steps, state, inputs)
        np.testing.assert_allclose(w.noted.peak, local.peak, rtol=1e-12)
        scale = np.abs(rate).max()
        np.testing.assert_allclose(w.noted.acceleration, rate, rtol=0.0, atol=1e-12 * scale)


@pytest.mark.parametrize("curve", [PiecewiseCurve(), POLACH_WET, SlipRatioCurve(0.03, 0.7)])
@pytest.mark.parametrize("row", ["speed", "omega", "position", "torque", "pressure"])
def test_not_a_number_stays_one_where_it_is(curve, row):
    """Tables are read at a place that no number names; what comes of it must not pass for a state."""
    model = _plant(_train(WIDTH + 1, False), curve)
    start, inputs = _start(model)
    last = getattr(model.layout, row).stop - 1
    for value in (np.nan, np.inf, 1e300):
        state = start.copy()
        state[last] = value
        w = compiled.workspace(model, STEP)
        compiled.advance(w, START, STEP, 2, state, inputs)
        if not np.isfinite(value):
            assert not np.isfinite(state[last])


def test_states_come_back_as_they_went():
    pack, unpack = map(from_python, (compiled.pack, compiled.unpack))
    for make in SETS.values():
        model = build(make(), Rail(0.2))
        w = compiled.workspace(model, STEP)
        assert len(set(w.place)) == model.layout.rows == w.place.size
        assert not np.any((w.row.nothing <= w.place) & (w.place < w.row.deflection))
        state = np.random.default_rng(1).normal(size=model.layout.rows)
        back, padded = np.full_like(state, np.nan), np.zeros(w.row.end)
        pack(w, state, padded)
        unpack(w, padded, back)
        np.testing.assert_array_equal(back, state)


def _arrays(record):
    for name in getattr(record, "_fields", ()):
        part = getattr(record, name)
        if isinstance(part, np.ndarray) and part.size:
            yield part
        else:
            yield from _arrays(part)


@pytest.mark.parametrize("name", SETS)
def test_every_array_has_cache_lines_of_its_own(name):
    found = list(_arrays(compiled.workspace(build(SETS[name](), Rail(0.2)), STEP)))
    spans = sorted((values.ctypes.data, values.nbytes) for values in found)
    assert all(start % (8 * WIDTH) == 0 for start, _ in spans)
    assert all(start + size <= after for (start, size), (after, _) in pairwise(spans))
