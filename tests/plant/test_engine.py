"""The compiled engine is the NumPy plant: back ends agree, order four, stiffness bounds the step, padding stays nothing."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise, product

import casadi
import numpy as np

from alloc.plant import engine as compiled
from alloc.plant.adhesion import (
    POLACH_DRY,
    POLACH_WET,
    PiecewiseCurve,
    PolachByFrictionCurve,
    RationalCurve,
    SlipRatioCurve,
)
from alloc.plant.array_model import ArrayModel, Local
from alloc.plant.model import STABLE_STEP, Inputs, Model, build
from alloc.plant.operations import WIDTH
from alloc.plant.rail import SPEED_LAWS, Line, Patch, Rail, Receptivity, logarithmic_increments
from alloc.plant.sets import SETS
from alloc.plant.train import AirBrake, Coupler, DraftGear, Motors, Sander, Train
from tests.cases import looped
from tests.compiled_part import from_python
from tests.plant.conftest import FLAT, make_car
from tests.plant.numpy_plant import compiled_rate, environment_at, right_side, runge_kutta_step

TIME = 1.7


Rails = dict[str, np.ndarray | None]


"""What lies on the rail under each axle."""


AGREEING = {
    "piecewise": PiecewiseCurve(),
    "polach-dry": POLACH_DRY,
    "polach-wet": POLACH_WET,
    "polach-by-friction": PolachByFrictionCurve(),
    "slip-ratio": SlipRatioCurve(0.04, 0.7),
    "rational": RationalCurve(0.05, 1.7),
}


WHOLE_LINE = Line(
    (0.0, 300.0, 420.0), (0.0, 0.02, -0.01), tunnels=((200.0, 380.0),), tunnel_factor=1.6,
    curves=((150.0, 310.0, 250.0), (330.0, 400.0, 600.0)), curve_law="roeckl",
)  # fmt: skip


def _agreeing_model(name: str, curve: str, law: str) -> Model:
    train = SETS[name]()
    if curve != "piecewise":  # a train without sanders takes another way
        car = replace(train.cars[0], sanders=(Sander(0, 0.03),))
        train = replace(train, cars=(car, *train.cars[1:]))
    rail = Rail(
        1.0 if law == "shinkansen" else 0.6,
        law,
        patches=(
            Patch(0.6, 250.0, 350.0, 20.0, 1.0, 3.0, 0.5),
            Patch(1.2, 300.0),
            Patch(0.5, 900.0),
        ),
        increments=tuple(logarithmic_increments(train.axle_count)),
        scatter=0.012,
        seed=2,
        conditioning=0.3,
        curve=AGREEING[curve],
    )
    failures = {} if train.cars[-1].motors is None else {0: 1.5}
    return build(train, rail, WHOLE_LINE, Receptivity(0.8, 0.3, 2.0, 0.4), failures)


def _random(model: Model, seed: int) -> tuple[np.ndarray, Inputs, Rails]:
    """States from standstill to speed, with slip, slide, locked and sticking wheels; any command, cleaning and sand."""
    rng = np.random.default_rng(seed)
    n, s = model.layout, model.structure
    state = np.zeros(n.rows)
    state[n.position] = rng.uniform(200, 450) + rng.uniform(-0.05, 0.05, n.bodies)
    state[n.speed] = rng.choice([0.0, 2.0, 30.0]) + rng.uniform(-0.5, 1.0, n.bodies)
    state[n.speed] *= rng.choice([1.0, 0.1])  # near rest contacts stick
    rolling = state[n.speed][s.axle_body] / s.radius
    slip = rng.normal(0.0, 1.0, rolling.shape) * 10.0 ** rng.uniform(-3, 1, rolling.shape)
    state[n.omega] = (rolling + slip) * (rng.random(rolling.shape) > 0.1)
    state[n.torque] = rng.uniform(-2000.0, 2000.0, n.units)
    state[n.pressure] = rng.uniform(0.0, 4e5, n.groups)
    state[n.gear_travel] = rng.uniform(-0.02, 0.02, n.draft_gears)
    state[n.deflection] = rng.uniform(-1.0, 1.0, n.axles) * model.rail.presliding
    if n.shafts:
        twists = s.axle_shaft[1] > 0.0
        state[n.rotor] = twists * (state[n.omega] + rng.normal(0.0, 1.0, n.axles))
        state[n.twist] = twists * rng.normal(0.0, 3e-3, n.axles)
    state[n.recovery] = rng.uniform(0.0, 1.0, n.recoveries)
    inputs = Inputs(
        rng.uniform(-4000.0, 4000.0, n.units),
        rng.uniform(0.0, 4e5, n.groups),
        rng.integers(0, 3, n.groups).astype(float),
        np.zeros(n.sanders),
    )
    sand = 0.02 * rng.random(n.axles) if n.sanders else None
    return state, inputs, {"cleaning": rng.random(n.axles), "sand": sand}


def _assert_agree(actual: np.ndarray, expected: np.ndarray, n, case: str = "") -> None:
    # a rate is a difference of larger terms: the scale is the largest of its kind
    first = 0
    for size in (
        n.bodies, n.bodies, n.axles, n.units, n.groups, n.draft_gears, n.shafts, n.shafts, n.recoveries,
        n.axles, 1, 1, 1, 1, n.axles,
    ):  # fmt: skip
        part = slice(first, first + size)
        scale = np.abs(expected[part]).max(initial=0.0)
        np.testing.assert_allclose(
            actual[part], expected[part], rtol=1e-12, atol=1e-12 * scale, err_msg=case
        )
        first += size


def assert_back_ends_agree(model: Model, speeds: Sequence[float], rail: Sequence[str] = ()) -> None:
    """Numba and CasADi against NumPy on random states, and `Model.stiffness` over the Jacobian at these speeds [m/s].

    `rail`: what of the rail under the train is drawn too, by its names in `environment_at`.
    """
    arrays, function = ArrayModel.of(model), _casadi_function(model)
    for seed in range(9):
        state, inputs, left = _random(model, seed)
        under = {name: left[name] for name in rail}
        local = environment_at(model, 0.0, state, arrays=arrays, **under)
        expected = arrays.derivative(state, inputs, local)
        slope, _ = compiled_rate(model, state, inputs, **under)
        _assert_agree(slope, expected, model.layout, f"numba, {seed}")
        symbolic = np.asarray(function(state, *inputs, *local)).ravel()
        _assert_agree(symbolic, expected, model.layout, f"casadi, {seed}")
    for speed in speeds:
        state = model.initial_state(speed)
        state[model.layout.torque] = 1000.0
        state[model.layout.recovery] = 0.5
        assert _spectral_radius(model, arrays, state) <= model.stiffness() * (1.0 + 1e-3)


@looped("name", SETS)
def test_numpy_and_numba_agree(name):
    for curve, law in product(AGREEING, SPEED_LAWS):
        model = _agreeing_model(name, curve, law)
        arrays = ArrayModel.of(model)
        for seed in range(9):
            state, inputs, left = _random(model, seed)
            local = environment_at(model, TIME, state, arrays=arrays, **left)
            slope, peak = compiled_rate(model, state, inputs, TIME, **left)
            case = f"{curve}, {law}, {seed}"
            np.testing.assert_allclose(peak, local.peak, rtol=1e-12, err_msg=case)
            _assert_agree(slope, arrays.derivative(state, inputs, local), model.layout, case)


def _casadi_function(model: Model) -> casadi.Function:
    """Derivative as an SX function of state, inputs and environment."""
    n = model.layout
    state = casadi.SX.sym("state", n.rows)
    sizes = (
        n.units,
        n.groups,
        n.groups,
        n.sanders,
        n.axles,
        n.cars,
        n.cars,
        *(n.units,) * 3,
        n.cars,
    )
    arguments = [casadi.SX.sym(f"a{k}", size) for k, size in enumerate(sizes)]
    slope = ArrayModel.of(model).derivative(state, Inputs(*arguments[:4]), Local(*arguments[4:]))
    return casadi.Function("derivative", [state, *arguments], [slope])


@looped("name", SETS)
def test_numpy_and_casadi_agree(name):
    for curve in AGREEING:
        model = _agreeing_model(name, curve, "none")
        arrays, function = ArrayModel.of(model), _casadi_function(model)
        for seed in range(9):
            state, inputs, left = _random(model, seed)
            local = environment_at(model, TIME, state, arrays=arrays, **left)
            symbolic = np.asarray(function(state, *inputs, *local)).ravel()
            expected = arrays.derivative(state, inputs, local)
            _assert_agree(symbolic, expected, model.layout, f"{curve}, {seed}")


def test_casadi_numbers_are_accepted_as_they_are():
    model = _agreeing_model("commuter-8car", "polach-wet", "none")
    arrays = ArrayModel.of(model)
    state, inputs, left = _random(model, 5)
    local = environment_at(model, TIME, state, arrays=arrays, **left)
    given, *rest = [casadi.DM(values) for values in (state, *inputs, *local)]
    numeric = arrays.derivative(given, Inputs(*rest[:4]), Local(*rest[4:]))
    expected = arrays.derivative(state, inputs, local)
    _assert_agree(np.asarray(numeric).ravel(), expected, model.layout)


ROLLING_RESISTANCE = (2e3, 50.0, 6.0)


def _orders(end_state, steps, reference) -> np.ndarray:
    """Observed orders between successive steps; `end_state(step)` is compared with that of `reference`."""
    exact = end_state(reference)
    error = np.array([np.abs(end_state(step) - exact).max() for step in steps])
    return np.log(error[:-1] / error[1:]) / np.log(np.array(steps[:-1]) / steps[1:])


def _slipping_end_state(run, model, duration, **inputs):
    """Rim speeds at the end, wheels slipping from the start (laws are smooth on either side of no slip)."""
    n, s = model.layout, model.structure

    def end(step):
        state = model.initial_state(20.0)
        state[n.omega] *= 1.05
        trace = run(model, duration, state=state, step=step, sample=duration, **inputs)
        return s.radius * trace.rows("omega")[-1]

    return end


@looped(("formation", "couplers"), [("M", None), ("MMM", (Coupler(damping=0.0),) * 2)])  # fmt: skip
def test_fourth_order_on_a_smooth_case(run, train, formation, couplers):
    made = train(formation, resistance=ROLLING_RESISTANCE, load_transfer=True, couplers=couplers)
    model = build(made, Rail(0.2, curve=POLACH_WET))
    end = _slipping_end_state(run, model, 0.48, command=1300.0)
    orders = _orders(end, [2e-3, 1e-3, 5e-4], 6.25e-5)
    assert np.all(np.abs(orders - 4.0) < 0.3), orders


def test_fourth_order_with_smooth_edges_of_the_environment(run, train):
    """A patch entered in space and in time, a speed law, and a receptivity that fluctuates."""
    rail = Rail(
        1.5, "shinkansen", curve=POLACH_WET,
        patches=(Patch(0.6, start=-3.0, edge=6.0), Patch(1.3, begin=0.2, until=9.0, fade=0.3)),
    )  # fmt: skip
    model = build(train("M"), rail, receptivity=Receptivity(0.7, 0.2, 1.0))
    n, s = model.layout, model.structure

    def end(step):
        state = model.initial_state(20.0)
        state[n.omega] *= 0.95
        trace = run(model, 0.48, state=state, step=step, sample=0.48, command=-9e3)
        return s.radius * trace.rows("omega")[-1]

    orders = _orders(end, [2e-3, 1e-3, 5e-4], 6.25e-5)
    assert np.all(np.abs(orders - 4.0) < 0.4), orders


SLIPPING = [PiecewiseCurve(), POLACH_WET, SlipRatioCurve(0.03, 0.7)]


@looped("curve", SLIPPING)
def test_halving_the_step_keeps_the_metrics_of_a_slip_event(run, train, curve):
    """Peak slip, damage and speed reached change by less than 0.1 %."""
    level = 0.3 if curve is POLACH_WET else 0.18
    rail = Rail(level, patches=(Patch(0.5, begin=1.0, until=2.0, fade=0.05),), curve=curve)
    model = build(train("TMT", resistance=ROLLING_RESISTANCE), rail)

    def metrics(step):
        def command(t):
            return 1900.0 if t < 1.6 else 300.0

        trace = run(model, 3.0, 10.0, command=command, step=step, sample=4e-3)
        speed = trace.rows("speed")[:, 0]
        slip = 0.43 * trace.rows("omega") - speed[:, None]
        return np.array([slip.max(), trace.rows("friction_work")[-1].sum(), speed[-1]])

    coarse, fine = metrics(1e-3), metrics(5e-4)
    assert coarse[0] > 0.3  # the wheels did slip
    np.testing.assert_allclose(coarse, fine, rtol=1e-3)


def test_results_do_not_depend_on_how_often_the_caller_asks(run, train):
    model = build(train("TMT"), Rail(0.12, scatter=0.01, conditioning=0.3))
    often = run(model, 0.5, 15.0, command=1500.0, sample=1e-3)
    seldom = run(model, 0.5, 15.0, command=1500.0, sample=0.1)
    np.testing.assert_allclose(often.state[-1], seldom.state[-1], rtol=1e-12, atol=1e-12)


def test_locking_wheels_do_not_chatter(run, train):
    """Stiff shoe friction at standstill of a wheel: twice the step gives the same end."""
    model = build(train("TT"), Rail(0.03))
    ends = [
        run(model, 4.0, 8.0, pressure=400e3, step=step, sample=1.0).state[-1]
        for step in (1e-3, 5e-4)
    ]
    np.testing.assert_allclose(ends[0][model.layout.speed], ends[1][model.layout.speed], rtol=1e-4)
    assert np.abs(ends[0][model.layout.omega]).max() < 1e-9


STIFF = [
    PiecewiseCurve(), POLACH_DRY, PolachByFrictionCurve(), SlipRatioCurve(0.03, 0.7), RationalCurve(),
]  # fmt: skip


DIFFERENCE = 1e-7


def _states(model, rng):
    """Rolling at several speeds; stretched couplers with slipping wheels; nearly locked wheels."""
    n = model.layout
    for speed in (0.0, 1.0, 20.0):
        yield model.initial_state(speed)
        state = model.initial_state(speed)
        state[n.position] += rng.uniform(-0.08, 0.08, n.bodies)
        state[n.speed] += rng.uniform(-0.3, 0.3, n.bodies)
        state[n.omega] += rng.uniform(-0.5, 0.5, n.axles)
        state[n.gear_travel] = rng.uniform(-0.1, 0.1, n.draft_gears)
        state[n.pressure] = 2e5
        yield state
        state = state.copy()
        state[n.omega] *= 1e-4
        yield state


def _spectral_radius(model, arrays, state) -> float:
    """Of the numerical Jacobian of positions to what the draft gears have travelled, and deflections."""
    n, inputs = model.layout, model.zero_inputs()
    moving = np.r_[: n.gear_travel.stop, n.deflection]

    def rate(x):
        local = environment_at(model, 0.0, x, arrays=arrays)
        return arrays.derivative(x, inputs, local)[moving]

    there = state + DIFFERENCE * np.eye(state.size)[moving]
    rows = (np.stack([rate(x) for x in there]) - rate(state)) / DIFFERENCE
    return np.abs(np.linalg.eigvals(rows)).max()  # those of the transpose


@looped("curve", STIFF)
@looped("name", ["one-axle", "jp4209318-3car", "commuter-8car", "freight-5", "draft gears"])
def test_stiffness_bounds_the_jacobian(name, curve):
    train = SETS["freight-5"]().coupled(DraftGear()) if name == "draft gears" else SETS[name]()
    model = build(train, Rail(0.3, curve=curve))
    arrays = ArrayModel.of(model)
    for state in _states(model, np.random.default_rng(4)):
        radius = _spectral_radius(model, arrays, state)
        # bounds of wheels and couplers are taken apart; together they exceed them by parts in 1e5
        assert radius <= model.stiffness() * (1.0 + 1e-3)


@looped("curve", STIFF)
def test_substeps_keep_the_step_stable(train, curve):
    model = build(train("TMT"), Rail(0.3, curve=curve))
    for step in (1e-4, 1e-3, 1e-2):
        count = model.substeps(step)
        assert model.stiffness() * step / count <= STABLE_STEP
        assert count == 1 or model.stiffness() * step / (count - 1) > STABLE_STEP


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


@looped("coupled", [False, True])
@looped("count", COUNTS)
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


@looped("coupled", [False, True])
@looped("count", COUNTS)
def test_what_fills_a_block_up_stays_nothing(count, coupled):
    model = _plant(_train(count, coupled))
    state, inputs = _start(model)
    w = compiled.workspace(model, STEP)
    compiled.advance(w, START, STEP, 20, state, inputs)
    for values in (w.scratch.state, w.scratch.slope):
        np.testing.assert_array_equal(np.delete(values, w.place), 0.0)
    np.testing.assert_array_equal(w.scratch.state[w.place], state)


@looped("name", SETS)
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


@looped("curve", [PiecewiseCurve(), POLACH_WET, SlipRatioCurve(0.03, 0.7)])
@looped("row", ["speed", "omega", "position", "torque", "pressure"])
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


@looped("name", SETS)
def test_every_array_has_cache_lines_of_its_own(name):
    found = list(_arrays(compiled.workspace(build(SETS[name](), Rail(0.2)), STEP)))
    spans = sorted((values.ctypes.data, values.nbytes) for values in found)
    assert all(start % (8 * WIDTH) == 0 for start, _ in spans)
    assert all(start + size <= after for (start, size), (after, _) in pairwise(spans))
