"""RTRI report (Hijikata, Nishimura): brake force of each car from coupler forces and accelerations, in running tests.

A locomotive and 5 or 17 wagons, masses joined by stiffening buffers (1), brake on the plant. A measuring system with the
errors of real sensors records them, and what (2) to (9) make of the records is compared with the truth. Cylinders fill as
the brake pipe's wave reaches them. A day draws the friction of each car's shoes, which wagons are cut out, and the sensors'
errors. Two things are put in and not found: the locomotive's 60 kN, and the formulas of friction, running resistance and
rigging, which plant and estimate share.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt, sosfilt_zi

from alloc.evaluation.brake_force import (
    BrakeRigging,
    CalibrationErrors,
    braking_window,
    car_brake_forces,
    coupler_force_between,
    group_brake_force,
    rolling_mass,
    smooth_brake_forces,
)
from alloc.evaluation.measured_series import spans
from alloc.laws import resistance, speed_law
from alloc.plant.rail import Rail
from alloc.plant.rows import rows_of_train
from alloc.plant.train import Train
from alloc.plant.trains import find_train
from alloc.run.driving import NO_COMMAND, TrainSense, drive
from alloc.run.event import Event
from alloc.schema.tables import Rows
from studies.runner.rows import BOOKKEEPING
from studies.runner.study import Cell, Row, Study
from studies.statistics import Claim, Statement, judge

Floats = NDArray[np.float64]


# the running tests

BRAKED_AT, STOP_SPEED, LONGEST = 2.0, 0.3, 90.0
"""Time of the driver's command, which is the report's time 0 [s]; speed that ends a test [m/s]; its longest time [s]."""
DRY = 0.3
"""Coefficient of adhesion: dry rails, on which no wheel slides."""
SHOE_SCATTER = 0.05
"""Relative standard deviation of shoe friction between cars. Assumed; the report speaks of scatter (3.2.2)."""
BRAKE = find_train("freight-5").cars[-1].air_brake
assert BRAKE is not None
STEP, EMERGENCY, FRICTION = 350e3, BRAKE.pressure, BRAKE.friction
"""Pressures of the cylinders in the third service step and in emergency [Pa]; law of the shoes' friction. Assumed."""
RECORD, PERIOD, CUT_OFF = 0.01, 0.02, 15.0
"""Periods of the record and of the samples [s]; anti-aliasing filter of fourth order, alike on all channels [Hz]."""


class RunningTest(NamedTuple):
    """A running test of the report."""

    wagons: int
    speed: float
    """Where it is braked [km/h]."""
    pressure: float
    """Of the cylinders [Pa]."""
    braked: float
    """Wagons whose brakes work; a half is one bogie of every wagon cut out."""
    locomotive_only: bool = False


TESTS = {
    "locomotive": RunningTest(5, 25.0, STEP, 5.0, locomotive_only=True),
    "all": RunningTest(5, 25.0, STEP, 5.0),
    "4 wagons": RunningTest(5, 25.0, STEP, 4.0),
    "3 wagons": RunningTest(5, 25.0, STEP, 3.0),
    "2.5 wagons": RunningTest(5, 25.0, STEP, 2.5),
    "emergency": RunningTest(17, 75.0, EMERGENCY, 17.0),
}
"""3.2.1, 3.2.2, 3.2.3 (Table 2, of which "all" is the first line), and 3.3."""
CUT_OUT = ("all", "4 wagons", "3 wagons", "2.5 wagons")


def prepare_train(test: RunningTest, day: int) -> Train:
    """The train of a test; the same day has the same wagons in every test of the same length."""
    draw = np.random.default_rng([day, 40])
    train = find_train(f"freight-{test.wagons}")
    factors = 1.0 + SHOE_SCATTER * draw.standard_normal(len(train.cars))
    order = 1 + draw.permutation(test.wagons)
    halves = test.braked % 1.0 > 0.0
    out = () if halves else order[: test.wagons - int(test.braked)]
    cars = []
    for k, (car, factor) in enumerate(zip(train.cars, factors, strict=True)):
        assert car.air_brake is not None
        cut = (0,) if halves and k > 0 else (0, 1) if k in out else ()
        brake = replace(car.air_brake, friction_factor=factor, cut_out=cut)
        cars.append(replace(car, air_brake=brake))
    return replace(train, cars=tuple(cars))


def drive_test(test: RunningTest, train: Train) -> xr.Dataset:
    """The recorded run of a test on level, dry track."""
    braked = train.cars[0].brake_groups if test.locomotive_only else None

    def driver(sense: TrainSense, units: Rows, brakes: Rows) -> bool:
        brakes.pressure_target[:braked] = test.pressure * (sense.time >= BRAKED_AT - 1e-9)
        return sense.speed > STOP_SPEED

    course: Row = {"duration": LONGEST, "initial_speed": test.speed / 3.6, "record_period": RECORD}
    return drive(Event("test", train, Rail(DRY), NO_COMMAND, **course), driver)


# what is measured

ACCELERATION_NOISE, COUPLER_NOISE, PRESSURE_NOISE, SPEED_NOISE = 0.02, 1e3, 2e3, 0.02
"""White noise of a sample [m/s2, N, Pa, m/s]. All errors are assumed: good strain gauges and servo accelerometers."""
CONSTANT = CalibrationErrors(
    acceleration_offset=0.005, coupler_offset=300.0, coupler_gain=0.005, mass=0.005
)
"""Errors that are constant over a run; offsets are what zeroing leaves while the train coasts."""


class Measured(NamedTuple):
    """A test as it is recorded; all (time,) or (time, cars), of couplers (time, cars - 1)."""

    time: Floats
    speed: Floats
    """Of the foremost car [m/s]."""
    acceleration: Floats
    coupler: Floats
    """[N], tension positive."""
    pressure: Floats
    """Of the foremost cylinder of each car [Pa]."""
    mass: Floats
    """With what the wheelsets add [kg], (cars,)."""
    resistance: Floats
    """Running resistance by its formula [N]."""
    truth: Floats
    """True force of the brakes, at the rims of wheels that roll [N]."""

    def wagons(self) -> Floats:
        """True force of all wagons [N]."""
        return np.asarray(self.truth[:, 1:].sum(axis=1))


def record_test(test: RunningTest, train: Train, day: int | None) -> Measured:
    """Drive and record a test; `day` draws the errors of the sensors, None: they have none."""
    run, every = drive_test(test, train), round(PERIOD / RECORD)

    def sample_channel(values: Floats) -> Floats:
        sections = butter(4, CUT_OFF * 2.0 * RECORD, output="sos")
        start = np.multiply.outer(sosfilt_zi(sections), values[0])
        return np.asarray(sosfilt(sections, values, axis=0, zi=start)[0][::every])

    foremost = np.cumsum([0, *(car.brake_groups for car in train.cars[:-1])])
    inertia, radius = np.array([[car.inertia, car.wheel_radius] for car in train.cars]).T
    of_car = run["axle_car"].values[:, None] == np.arange(run.sizes["car"])
    turning = inertia / radius**2 * run["car_acceleration"].values
    truth, bare = -run["rail_force"].values @ of_car - turning, run["car_mass"].values
    speed = sample_channel(run["car_speed"].values[:, 0])
    acceleration = sample_channel(run["car_acceleration"].values)
    coupler = sample_channel(run["coupler_force"].values)
    pressure = sample_channel(run["cylinder_pressure"].values[:, foremost])
    if day is not None:
        draw = np.random.default_rng([day, 41]).standard_normal
        bare = bare * (1.0 + CONSTANT.mass * draw(bare.size))
        offsets = CONSTANT.acceleration_offset * draw(acceleration.shape[1])
        gains = 1.0 + CONSTANT.coupler_gain * draw(coupler.shape[1])
        zeros = CONSTANT.coupler_offset * draw(coupler.shape[1])
        # noise after what is constant, which must not depend on how long the run is
        speed = np.abs(speed + SPEED_NOISE * draw(speed.shape))
        acceleration = acceleration + offsets + ACCELERATION_NOISE * draw(acceleration.shape)
        coupler = gains * coupler + zeros + COUPLER_NOISE * draw(coupler.shape)
        pressure = pressure + PRESSURE_NOISE * draw(pressure.shape)
    mass = rolling_mass(bare, inertia, radius)
    c = rows_of_train(train).cars
    drag = resistance(speed[:, None], c.resistance, c.resistance_linear, c.resistance_quadratic)
    time, true = run["time"].values[::every], sample_channel(truth)
    return Measured(time, speed, acceleration, coupler, pressure, mass, drag, true)


# what the report makes of it

CYLINDERS, EFFICIENCY, PISTON_AREA, STANDSTILL_FRICTION = 2, 0.9, math.pi / 4.0 * 0.254**2, 0.25
"""Of a wagon: a cylinder of 10 inches per bogie, since bogies are cut out one by one. All assumed."""
LEVERS = (
    4 * BRAKE.force / BRAKE.pressure / (CYLINDERS * EFFICIENCY * PISTON_AREA * STANDSTILL_FRICTION)
)
"""5.0; it follows from the force of the four axles."""
RIGGING = BrakeRigging(CYLINDERS, LEVERS, EFFICIENCY, PISTON_AREA)


class Estimated(NamedTuple):
    """Brake forces after the report [N], (time,) each, and its window."""

    locomotive: Floats
    """(3), from its own acceleration."""
    wagons: Floats
    """(5), all wagons; the acceleration of the first stands for all."""
    wagon: Floats
    """(9), the first wagon alone."""
    separate: Floats
    """Sum of (4), each wagon by its own acceleration: the first remedy of section 4."""
    theory: Floats
    """(7), one wagon, from the pressure measured on the first."""
    window: slice
    """3.2.3: from 63.2 % of the steady cylinder pressure to standstill."""


def estimate_forces(test: RunningTest, m: Measured) -> Estimated:
    """What the report computes; forces are those at the brakes, the running resistance is subtracted (section 2)."""
    a, drag = m.acceleration, m.resistance
    first, second = m.coupler[:, 0], m.coupler[:, 1]
    fall = 1.0 - speed_law(m.speed, *FRICTION)
    return Estimated(
        group_brake_force(a[:, 0], m.mass[0], None, first, drag[:, 0]),
        group_brake_force(a[:, 1], m.mass[1:].sum(), first, None, drag[:, 1:].sum(axis=1)),
        group_brake_force(a[:, 1], m.mass[1], first, second, drag[:, 1]),
        car_brake_forces(a, m.coupler, m.mass, drag)[:, 1:].sum(axis=1),
        RIGGING.force(m.pressure[:, 1], STANDSTILL_FRICTION * (1.0 - fall)),
        braking_window(m.pressure[:, 0 if test.locomotive_only else 1], m.speed),
    )


def measure_test(name: str, day: int) -> tuple[Measured, Estimated]:
    """A test of that day, and what the report computes of it."""
    test = TESTS[name]
    m = record_test(test, prepare_train(test, day), day)
    return m, estimate_forces(test, m)


def run(name: str, day: int) -> Row:
    """Numbers of a test, forces in kN: those that its findings need."""
    m, e = measure_test(name, day)
    further = {"locomotive": [find_settling, find_shock], "all": [find_settling, find_spikes]}
    further["emergency"] = [compare_theory]
    rows = [part(m, e) for part in (find_errors, *further.get(name, ()))]
    return {key: float(value) for row in rows for key, value in row.items()}


SECOND = round(1.0 / PERIOD)
"""Samples."""


def rms(values: Floats) -> float:
    """Root mean square; nan of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else math.nan


def find_errors(m: Measured, e: Estimated) -> Row:
    """Error of the wagons' sum in the window: at an instant and of the mean, by the report's rule and with the remedies."""
    w, true, records = e.window, m.wagons(), (m.acceleration, m.coupler, m.mass)
    smooth = smooth_brake_forces(*records, ACCELERATION_NOISE, COUPLER_NOISE, m.resistance)
    smoothed = smooth[:, 1:].sum(axis=1)
    row: Row = {"mean": e.wagons[w].mean() / 1e3, "force": true[w].mean() / 1e3}
    for key, estimate in (("first", e.wagons), ("own", e.separate), ("smooth", smoothed)):
        error = (estimate - true)[w] / 1e3
        row |= {f"error_{key}": rms(error), f"mean_error_{key}": abs(error.mean())}
    return row


AGREEMENT = 0.05
"""Difference of accelerations [m/s2], over a second, below which relative motion counts as died out; noise gives 0.028."""


def find_settling(m: Measured, e: Estimated) -> Row:
    """The locomotive's steady estimate, and errors before and after relative motion has died out."""
    end, start = e.window.stop, int(np.searchsorted(m.time, BRAKED_AT))
    pressure = m.pressure[:end, 0]
    steady = int(np.argmax(pressure >= 0.95 * np.median(pressure[(3 * end) // 4 :])))
    apart = np.square(m.acceleration[:end, 0] - m.acceleration[:end, 1])
    apart = np.sqrt(np.convolve(apart, np.ones(SECOND) / SECOND, "valid"))
    above = np.flatnonzero(apart > AGREEMENT)
    at = max(int(above[-1]) + SECOND if above.size else 0, start + 1)
    locomotive = (e.locomotive - m.truth[:, 0]) / 1e3
    wagons = (e.wagons - m.wagons()) / 1e3
    row: Row = {"locomotive": e.locomotive[steady:end].mean() / 1e3}
    for who, error in (("locomotive", locomotive), ("wagons", wagons)):
        row |= {f"{who}_before": rms(error[start:at]), f"{who}_after": rms(error[at:end])}
    return row | {"wagons_mean_after": e.wagons[at:end].mean() / 1e3 if at < end else math.nan}


CONTACT = 5e3
"""Coupler force [N] beyond which two cars press or pull: five times the sensor's noise."""


def find_shock(m: Measured, e: Estimated) -> Row:
    """The wagons run up: the first coupler's peak against (6), and how its oscillation about (6) decays."""
    end, first, true = e.window.stop, m.coupler[:, 0], m.truth + m.resistance
    steady = coupler_force_between(true[:, 0], m.mass[0], true[:, 1:].sum(axis=1), m.mass[1:].sum())
    contact = int(np.argmax(first < -CONTACT))
    peak = contact + int(np.argmin(first[contact : contact + 2 * SECOND]))

    def find_swing(part: slice) -> float:
        """Standard deviation without the sensor's noise [kN]."""
        return math.sqrt(max(float(np.var((first - steady)[part])) - COUPLER_NOISE**2, 0.0)) / 1e3

    late = slice(end - 10 * SECOND, end)
    return {
        "shock_ratio": first[peak] / steady[peak],
        "swing_early": find_swing(slice(contact, contact + 4 * SECOND)),
        "swing_late": find_swing(late),
        "compression": -first[late].mean() / 1e3,
    }


def find_spikes(m: Measured, e: Estimated) -> Row:
    """The first coupler while all brake; in its spikes and between them the wagons' error, and whether the cars beside it
    accelerate in opposite directions, relative to the train's mean."""
    w, a = e.window, m.acceleration[e.window]
    first, error = m.coupler[w, 0], (e.wagons - m.wagons())[w] / 1e3
    pressed = np.abs(first) > CONTACT
    beside = a[:, :2] - (a @ m.mass / m.mass.sum())[:, None]
    opposite = beside[:, 0] * beside[:, 1] < 0.0
    peaks = [start + int(np.argmax(np.abs(first[start:end]))) for start, end in spans(pressed)]
    return {
        "coupler_median": np.median(np.abs(first)) / 1e3,
        "coupler_peak": np.abs(m.coupler[: w.stop, 0]).max() / 1e3,
        "error_in_spikes": rms(error[pressed]),
        "error_between": rms(error[~pressed]),
        "opposite_at_spikes": opposite[peaks].mean() if peaks else math.nan,
        "opposite_between": opposite[~pressed].mean(),
    }


def compare_theory(m: Measured, e: Estimated) -> Row:
    """Wagons' sum against (8) and first wagon against (7): over the window, and the worst of its thirds."""
    begin, _, end = np.array_split(e.theory[e.window], 3)
    row = {"theory_growth": end.mean() / begin.mean()}
    for key, estimated, wagons in (("sum", e.wagons, m.mass.size - 1), ("wagon", e.wagon, 1)):
        force, believed = estimated[e.window], wagons * e.theory[e.window]
        thirds = zip(np.array_split(force, 3), np.array_split(believed, 3), strict=True)
        row[f"{key}_over_theory"] = force.mean() / believed.mean()
        row[f"{key}_off"] = max(abs(third.mean() / theory.mean() - 1.0) for third, theory in thirds)
    return row


# what was found


def tabulate_days(rows: pd.DataFrame) -> pd.DataFrame:
    """One row per day, columns (number, test); and of each day the line through the means of `CUT_OUT`, test "line".

    The line's intercept is no error, the true forces have it too: with fewer wagons braked a stop lasts longer, and the mean
    over the window is nearer to full pressure (89 % of it with all braked, 93 % with half).
    """
    good = rows[rows["status"] == "ok"]
    names = good.columns.difference([*BOOKKEEPING, "test", "day"])
    numbers = good.pivot(index="day", columns="test", values=list(names)).astype(float)
    braked = np.array([TESTS[name].braked for name in CUT_OUT])
    design = np.stack([braked, np.ones(braked.size)], axis=1)
    means = np.array([numbers["mean", name] for name in CUT_OUT])
    (slope, intercept), squares, *_ = np.linalg.lstsq(design, means)
    numbers["slope", "line"], numbers["intercept", "line"] = slope, intercept
    # two tests differ where their means do by 1.96 sqrt(2) deviations about the line
    deviation = np.sqrt(squares / (braked.size - 2))
    numbers["resolution", "line"] = 1.96 * math.sqrt(2.0) * deviation / slope
    return numbers


def statements(rows: pd.DataFrame) -> list[Statement]:
    """The report's findings, by section. 5 % are equal, since the report gives two digits.

    Bounds were set before any day was drawn; that of "proportional", the report's word, when the intercept was known.
    """
    d, inf = tabulate_days(rows), np.inf
    alone, both = d.xs("locomotive", axis=1, level=1), d.xs("all", axis=1, level=1)
    line, emergency = d.xs("line", axis=1, level=1), d.xs("emergency", axis=1, level=1)
    force, error = alone["locomotive"], both["error_first"]
    apart = 2.0 * (both["locomotive"] - force) / (both["locomotive"] + force)
    opposite = both["opposite_at_spikes"]
    return judge([
        Claim("3.2.1 shock", "first coupler: peak over the force of (6)", alone["shock_ratio"], 1.2),
        Claim("3.2.1 decay", "its oscillation: late over early", alone["swing_late"] / alone["swing_early"], -inf, 0.1),
        Claim("3.2.1 steady", "locomotive at once: error over force", alone["locomotive_before"] / force, -inf, 0.05),
        Claim("3.2.1 steady", "its error before over that after relative motion",
              alone["locomotive_before"] / alone["locomotive_after"], -inf, 1.2),
        Claim("3.2.1 zero", "wagons after relative motion: mean over the locomotive",
              alone["wagons_mean_after"] / force, -0.05, 0.05),
        Claim("3.2.1 zero", "their error before over that after", alone["wagons_before"] / alone["wagons_after"], 2.0),
        Claim("3.2.2 free", "coupler's median over the compression of 3.2.1",
              both["coupler_median"] / alone["compression"], -inf, 0.1),
        Claim("3.2.2 spikes", "its greatest force over that median", both["coupler_peak"] / both["coupler_median"], 5.0),
        Claim("3.2.2 equal", "locomotive here and in 3.2.1: difference over mean", apart, -0.05, 0.05),
        Claim("3.2.2 equal", "about 60 kN", both["locomotive"], 54.0, 66.0, digits=1),
        Claim("3.2.2 varies", "wagons' error over that of 3.2.1", error / alone["error_first"], 1.0),
        Claim("3.2.2 varies", "wagons' error in spikes over that between",
              both["error_in_spikes"] / both["error_between"], 1.0),
        Claim("3.2.2 opposite", "share of spikes with opposite accelerations", opposite, 0.75),
        Claim("3.2.2 opposite", "that share less the share between spikes", opposite - both["opposite_between"], 0.0),
        Claim("3.2.3 linear", "difference that two tests tell apart [wagons]", line["resolution"], -inf, 0.5),
        Claim("3.2.3 linear", "intercept over the force of all", line["intercept"] / both["mean"], -0.1, 0.1),
        Claim("3.2.3 proportional", "intercept [kN] within 1 % of the force of all", line["intercept"], -1.6, 1.6, digits=1),
        Claim("3.3.1 theory", "18 cars: sum over theory", emergency["sum_over_theory"], 0.95, 1.05),
        Claim("3.3.1 theory", "greatest deviation of a third of the stop", emergency["sum_off"], -inf, 0.1),
        Claim("3.3.1 rises", "theory at the end over the beginning", emergency["theory_growth"], 1.0),
        Claim("3.3.1 swing", "error over that of 3.2.2", emergency["error_first"] / error, 1.0),
        Claim("3.3.2 one wagon", "first wagon over theory", emergency["wagon_over_theory"], 0.95, 1.05),
        Claim("3.3.2 one wagon", "greatest deviation of a third of the stop", emergency["wagon_off"], -inf, 0.1),
        Claim("4 remedies", "own accelerations: error over the report's", both["error_own"] / error, -inf, 0.5),
        Claim("4 remedies", "mean over the stop", both["mean_error_first"] / error, -inf, 0.5),
        Claim("4 remedies", "own accelerations, smoothed", both["error_smooth"] / error, -inf, 0.25),
    ], family=False)  # fmt: skip


REMEDIES = {
    "error_first": "report's rule",
    "mean_error_first": "its mean",
    "error_own": "own accelerations",
    "mean_error_own": "their mean",
    "error_smooth": "smoothed",
}
"""Error of the wagons' sum in the window, of an instant or of the mean, by what is done about it (section 4)."""


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Each test: wagons' sum by the report's rule, the truth, and errors without and with remedies; means over days."""
    means = tabulate_days(rows).mean().unstack("test").T.loc[list(TESTS)]
    tests = pd.DataFrame([test[:2] for test in TESTS.values()], columns=["wagons", "from [km/h]"])
    tests.insert(0, "test", list(TESTS))
    headings = {"mean": "estimate [kN]", "force": "truth [kN]"}
    headings |= {key: f"error, {remedy} [kN]" for key, remedy in REMEDIES.items()}
    return tests.join(means[list(headings)].rename(columns=headings).reset_index(drop=True))


def cells(events: int, seed: int) -> list[Cell]:
    """Every test on each of `events` days."""
    return [
        Cell(f"{day}/{name}", (name, day), {"test": name, "day": day})
        for day in range(10_000 * seed, 10_000 * seed + events)
        for name in TESTS
    ]


QUESTION = "Does the brake force of each car follow from coupler forces and accelerations, as the RTRI report found?"
STUDY = Study("rtri", QUESTION, cells, run, table, statements=statements, events=60)
