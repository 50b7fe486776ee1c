"""A simulated run exported as a log gives the simulator's own numbers back, within errors that are stated here.

The bounds are what was measured, rounded up; sampling and noise of the speeds are those of the logs that real trains have.
"""

from typing import NamedTuple

import numpy as np
import pytest
import xarray as xr

from alloc.estimation.series import spans
from alloc.estimation.slip_events import SlipCriterion
from alloc.metrics import METRICS
from alloc.metrics.registry import SLIP_FACTOR
from alloc.plant.sets import find_set
from alloc.plant.train import Coupler, Train
from studies.core.job import Job, simulate_job
from studies.logs.measured_log import check_log
from studies.logs.measured_run import Findings, MeasuredTrain, analyse_run
from studies.logs.simulated import log_table, rounded
from studies.scenario.loading import load_scenario
from tests.simulation.slides import CLEANED_RAIL, TRAIN, braked, driven, readhering


class Case(NamedTuple):
    run: xr.Dataset
    train: Train

    def log(self, every: int = 1, noise_kmh: float = 0.0, without: str = "-"):
        """The checked log with a CSV file's decimals, every so many records, with white noise of all speeds."""
        table = rounded(log_table(self.run, self.train, every))
        generator = np.random.default_rng(0)
        for name in table:
            if "speed" in name and noise_kmh > 0.0:
                table[name] += generator.normal(0.0, noise_kmh, len(table))
        table = table[[name for name in table if without not in name]]
        return check_log(table, MeasuredTrain.of(self.train), "exported")

    def found(self, *options, criterion: SlipCriterion | None = None) -> Findings:
        log = self.log(*options)
        return analyse_run(log.run, log.train, criterion)


@pytest.fixture(scope="module")
def cases() -> dict[str, Case]:
    """Cars that meet a wet patch under the patent's rule, a coupled train that slides and readheres, runaway wheels."""
    scenario = load_scenario("wet-patch")
    patch = simulate_job(Job(scenario, "greedy-literal", "cut-and-ramp", 0))
    coupled = TRAIN.coupled(Coupler())
    return {
        "patch": Case(patch, scenario.event(0).model.train),
        "braked": Case(braked(readhering, train=coupled, rail=CLEANED_RAIL), coupled),
        "driven": Case(driven(), find_set("commuter-8car")),
    }


# case, every so many records of 10 ms, noise [km/h]; bounds: coefficient (rms), at onset (largest), Q (relative)
ERRORS = [
    ("patch", 1, 0.0, 0.0012, 0.008, 1e-4),
    ("patch", 5, 0.0, 0.0014, 0.008, 5e-3),
    ("patch", 10, 0.0, 0.0015, 0.020, 2e-2),
    ("patch", 1, 0.02, 0.0014, 0.008, 1e-2),
    ("patch", 1, 0.1, 0.0040, 0.008, 4e-2),
    ("braked", 1, 0.0, 0.0003, 0.0002, 5e-5),
    ("braked", 5, 0.0, 0.0003, 0.0004, 5e-4),
    ("braked", 10, 0.0, 0.0010, 0.0010, 2e-3),
    ("braked", 1, 0.02, 0.0008, 0.0025, 1e-3),
    ("braked", 1, 0.1, 0.0040, 0.0300, 5e-3),
    ("driven", 1, 0.0, 0.0060, 0.005, 1e-3),
    ("driven", 5, 0.0, 0.0080, 0.005, 1e-2),
    ("driven", 10, 0.0, 0.0120, 0.005, 2e-2),
    ("driven", 1, 0.02, 0.0060, 0.008, 1e-3),
]


@pytest.mark.parametrize(
    ("name", "every", "noise", "mean_error", "onset_error", "damage_error"), ERRORS
)
def test_coefficients_and_damage_come_back(
    cases, name, every, noise, mean_error, onset_error, damage_error
):
    case = cases[name]
    found = case.found(every, noise)
    error = found.coefficient - case.run["coefficient"].values[::every]
    assert np.sqrt((error**2).mean()) < mean_error
    damage = METRICS["damage"].function(case.run)
    assert 1e-3 * found.total_damage == pytest.approx(damage, rel=damage_error)
    limit, time = case.run["adhesion_limit"].values, case.run["time"].values
    assert len(found.events) >= 2
    assert all(np.isfinite(event.onset_coefficient) for event in found.events)
    for event in found.events:
        truth = limit[np.argmin(np.abs(time - event.onset_time)), event.axle]
        assert event.onset_coefficient == pytest.approx(truth, abs=onset_error)


@pytest.mark.parametrize("name", ["patch", "braked", "driven"])
@pytest.mark.parametrize("every", [1, 5, 10])
def test_slips_found_are_those_of_the_simulators_own_measure(cases, name, every):
    """Its measure counts a slip beyond twice the slip of the true curve's maximum, which no log knows."""
    case, criterion = cases[name], SlipCriterion()
    run, found = case.run, case.found(every)
    slip = np.abs(run["slip_velocity"].values)
    relative, time = slip / run["peak_slip"].values, run["time"].values
    bound = criterion.bound(run["speed"].values[:, None], run["rim_speed"].values)

    def overlap(event, begin, end):
        return event.start <= time[end - 1] + 0.11 and event.end >= time[begin] - 0.11

    within_bound = 0
    for axle in range(run.sizes["axle"]):
        own = [event for event in found.events if event.axle == axle]
        past = [(b, e) for b, e in spans(relative[:, axle] > 0.8)]
        assert all(any(overlap(event, *stretch) for stretch in past) for event in own)
        for begin, end in spans(relative[:, axle] > SLIP_FACTOR):
            if np.any(slip[begin:end:every, axle] > 1.05 * bound[begin:end:every, axle]):
                assert any(overlap(event, begin, end) for event in own), (axle, time[begin])
            else:
                within_bound += 1
    assert all(event.kind == ("slide" if name == "braked" else "slip") for event in found.events)
    if name == "patch":  # the rear cars creep at less than the bound
        assert within_bound > 0


def test_with_the_curve_known_the_time_in_slips_is_the_simulators(cases):
    """The bound of a log can be put where the simulator has it, if the curve is known: 0.15 m/s on this rail."""
    case = cases["patch"]
    found = case.found(1, criterion=SlipCriterion(0.15, 1e-4))
    measured = METRICS["slip_time"].function(case.run)
    assert found.slipping_time.sum() == pytest.approx(
        measured, rel=0.25
    )  # from half of the bound on
    slipped = np.abs(case.run["slip_velocity"].values) > SLIP_FACTOR * case.run["peak_slip"].values
    more_than_a_moment = slipped.sum(axis=0) > 10
    assert set(np.flatnonzero(more_than_a_moment)) <= {event.axle for event in found.events}


@pytest.mark.parametrize(("name", "error"), [("patch", 0.08), ("braked", 0.03), ("driven", 0.25)])
def test_adhesion_used_in_slips_comes_back_as_far_as_the_rail_stays_what_it_was(cases, name, error):
    """The coefficient at the onset stands for all of a slip: wrong where the rail changes meanwhile, as in "driven"."""
    case, found = cases[name], cases[name].found(1)
    used = available = 0.0
    for event in found.events:
        time = case.run["time"].values
        inside = (time >= event.start) & (time <= event.end)
        used += np.abs(case.run["rail_force"].values[inside, event.axle]).sum()
        limit = case.run["adhesion_limit"] * case.run["axle_load"]
        available += limit.values[inside, event.axle].sum()
    assert found.utilisation == pytest.approx(used / available, abs=error)


@pytest.mark.parametrize(("every", "error"), [(1, 5.0), (5, 5.0), (10, 5.0)])
def test_brake_force_of_every_car_comes_back(cases, every, error):
    """Of 24 kN a car, while all slide, with each car's own acceleration [N]."""
    case = cases["braked"]
    car = case.run["axle_car"].values
    truth = -np.stack(
        [case.run["rail_force"].values[::every, car == k].sum(axis=1) for k in range(3)], 1
    )
    found = case.found(every).car_force
    np.testing.assert_allclose(found, truth, atol=error)


def test_without_the_cars_own_accelerations_their_forces_are_right_on_average(cases):
    """What the RTRI report found: the train's acceleration leaves the cars' relative motion in the forces."""
    case = cases["braked"]
    log = case.log(without="acceleration")
    assert log.run.car_acceleration is None
    error = analyse_run(log.run, log.train).car_force - case.found(1).car_force
    assert np.sqrt((error**2).mean()) == pytest.approx(316.0, rel=0.1)
    assert np.abs(error.mean(axis=0)).max() < 2.0


def test_a_log_without_noise_has_nothing_to_be_remarked_on(cases):
    for case in cases.values():
        assert case.log().remarks == ()
