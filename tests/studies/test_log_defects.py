"""A log with a logger's defect tells what the same log without it tells: Q within 2 %, and the slides but for two."""

from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest

from alloc.estimation.slip_events import SMALL
from alloc.plant.sets import find_set
from studies.core.job import Job, simulate_job
from studies.files.study_error import StudyError
from studies.log_accuracy import defects as spoil
from studies.logs.export import log_table, rounded
from studies.logs.known_train import MeasuredTrain
from studies.logs.mapping import Mapping
from studies.logs.measured_log import MeasuredLog, check_log
from studies.logs.measured_run import Findings, analyse_run
from studies.logs.open_questions import delay_remarks
from studies.scenario.loading import load_scenario
from tests.simulation.slides import CLEANED_RAIL, TRAIN, braked, driven, readhering

SHARE, SLIPS = 0.02, 2


class Clean(NamedTuple):
    table: pd.DataFrame
    train: MeasuredTrain
    damage: float
    slips: int

    def found(self, table: pd.DataFrame) -> tuple[MeasuredLog, Findings]:
        log = check_log(table, self.train, "log")
        return log, analyse_run(log.run, log.train)


def clean(run, train) -> Clean:
    measured, table = MeasuredTrain.of(train), rounded(log_table(run, train))
    log = check_log(table, measured, "clean")
    found = analyse_run(log.run, measured)
    assert log.remarks == ()
    return Clean(table, measured, found.total_damage, len(found.events))


@pytest.fixture(scope="module")
def logs() -> dict[str, Clean]:
    """Three cars whose wheels slide and readhere, eight cars that stop on wet rail, and eight whose wheels run away."""
    scenario = load_scenario("wet-stop")
    stop = simulate_job(Job(scenario, "greedy", "cut-and-ramp", 0))
    return {
        "braked": clean(braked(readhering, rail=CLEANED_RAIL), TRAIN),
        "stop": clean(stop, scenario.event(0).model.train),
        "driven": clean(driven(), find_set("commuter-8car")),
    }


DEFECTS = [
    "late by a period",
    "lost",
    *spoil.defects(np.ones(1)), "epoch", "backwards", "repeated", "late and noisy", "held, counted"
]  # fmt: skip


def spoilt(clean: Clean, defect: str) -> pd.DataFrame:
    others = {
        "late by a period": lambda t: spoil.speed_late(t, 0.01),
        "lost": lambda t: t.assign(speed_kmh=t["speed_kmh"].where(abs(t["time_s"] - 3.0) > 1.5)),
        "epoch": spoil.single_epoch,
        "backwards": spoil.reversed_signs,
        "repeated": spoil.repeated_row,
        "late and noisy": lambda t: spoil.speed_late(spoil.noisy(t, 0.02)),
        "held, counted": lambda t: spoil.counted(spoil.speed_held(t), clean.train.radius, 0.02),
    }
    return (spoil.defects(clean.train.radius) | others)[defect](clean.table)


@pytest.mark.parametrize("name", ["braked", "stop", "driven"])
@pytest.mark.parametrize("defect", DEFECTS)
def test_damage_and_slides_are_those_of_the_clean_log(logs, name, defect):
    log, found = logs[name].found(spoilt(logs[name], defect))
    assert found.total_damage == pytest.approx(logs[name].damage, rel=SHARE)
    more = SLIPS if name != "braked" else 3  # 5 of its slides are within 0.1 % of the bound
    assert abs(len(found.events) - logs[name].slips) <= more
    assert np.isfinite([found.errors.total, log.run.rim_deviation.max()]).all()


@pytest.mark.parametrize(
    "defect", [spoil.speed_held, spoil.speed_interpolated, spoil.speed_with_gaps]
)
@pytest.mark.parametrize(("late", "period"), [(0.5, 1.0), (0.23, 0.5), (1.1, 1.0), (0.0, 1.0)])
def test_the_delay_of_a_rare_speed_is_found(logs, defect, late, period):
    log, found = logs["braked"].found(defect(logs["braked"].table, late, period))
    delay = log.run.speed_delay
    assert delay.value == pytest.approx(late, abs=max(0.003, 4.0 * delay.deviation))
    assert found.total_damage == pytest.approx(logs["braked"].damage, rel=SHARE)
    # 0.5 s at 0.75 m/s2 is more than Q allows, and no delay moves nothing
    assert bool(delay_remarks(log, found)) == (late > 0.0)


def test_the_stated_error_of_damage_covers_what_noise_does(logs):
    beyond = 0
    for seed in range(8):
        table = spoil.speed_held(spoil.noisy(logs["braked"].table, 0.1, seed))
        _, found = logs["braked"].found(table)
        beyond += abs(found.total_damage - logs["braked"].damage) > 2.0 * found.errors.total
    assert beyond <= 2


def test_without_forces_the_wheels_tell_the_speed_between(logs):
    table = spoil.speed_held(logs["driven"].table)
    log, found = logs["driven"].found(table[[n for n in table if "force" not in n]])
    assert log.run.speed_source == "followed"
    assert len(found.events) == logs["driven"].slips


def test_small_slips_are_found_where_noise_allows(logs):
    _, quiet = logs["braked"].found(logs["braked"].table)
    _, loud = logs["braked"].found(spoil.noisy(logs["braked"].table, 0.4))
    assert quiet.least_slip.max() == SMALL.velocity
    assert loud.least_slip.min() > SMALL.velocity
    assert quiet.small_events
    assert all(event.slip_ratio < 0.051 for event in quiet.small_events)
    # wheels that roll have none, however loud
    rolling = logs["braked"].table.assign(speed_kmh=60.0)
    for name in [name for name in rolling if "axle" in name]:
        rolling[name] = 60.0 if "speed" in name else 0.0
    _, nothing = logs["braked"].found(spoil.noisy(rolling, 0.4))
    assert (nothing.events, nothing.small_events) == ([], ())


def test_a_climb_is_no_fault_of_the_wheels(logs):
    train = logs["driven"].train
    time = 0.01 * np.arange(3000)
    speed = 8.0 + 0.1 * time
    pull = train.car_mass.sum() * (0.1 + 9.81 * 0.03) / train.driven.sum()
    table = pd.DataFrame({"time_s": time, "speed_kmh": 3.6 * speed})
    for i, driven_axle in enumerate(train.driven, 1):
        table[f"axle{i}_speed_kmh"] = 3.6 * speed * (1.004 if driven_axle else 1.0)
        table[f"axle{i}_force_kn"] = 1e-3 * pull if driven_axle else 0.0
    log = check_log(table, train, "climb")
    assert not [remark for remark in log.remarks if remark.kind == "radius"]
    (balance,) = (remark for remark in log.remarks if remark.kind == "balance")
    assert "a gradient of +29 per mille" in balance.text
    told = check_log(table.assign(gradient_permille=30.0), train, "climb")
    assert not [remark for remark in told.remarks if remark.kind == "balance"]


def counter(axle, total):
    """Of so many bits, since the row before, of three digits, set back in the middle, in turn."""
    middle = total.size // 2
    return (
        total % 4096,
        np.diff(total, prepend=0.0),
        total % 1000,
        np.where(np.arange(total.size) < middle, total, total - total[middle]),
    )[axle % 4]


def test_counts_since_the_start_or_the_row_before_are_speeds(logs):
    clean = logs["braked"]
    speeds = [name for name in clean.table if name.endswith("_speed_kmh")]
    counts = clean.table.drop(columns=speeds)
    time = clean.table["time_s"].to_numpy()
    names = {"time_s": {"is": "time", "unit": "s"}, "speed_kmh": {"is": "speed", "unit": "km/h"}}
    for i, radius in enumerate(clean.train.radius, 1):
        rim = clean.table[f"axle{i}_speed_kmh"].to_numpy() / 3.6
        way = np.concatenate([[0.0], np.cumsum(0.5 * (rim[1:] + rim[:-1]) * np.diff(time))])
        total = np.floor(way / (2.0 * np.pi * radius) * 80.0)
        counts[f"imp{i}"] = counter(i, total)
        names[f"imp{i}"] = {"is": f"axle{i}_pulses", "pulses_per_turn": 80}
        names[f"axle{i}_force_kn"] = {"is": f"axle{i}_force", "unit": "kN"}
    log = check_log(counts, clean.train, "log", Mapping.model_validate({"columns": names}))
    found = analyse_run(log.run, log.train)
    assert found.total_damage == pytest.approx(clean.damage, rel=SHARE)


def test_a_time_of_day_goes_on_past_midnight(logs):
    clean = logs["driven"]
    first = 86400.0 - 0.5 * clean.table["time_s"].iloc[-1]
    of_day = (first + clean.table["time_s"]) % 86400.0
    words = pd.to_timedelta(of_day, unit="s").astype(str).str.removeprefix("0 days ")
    for time in (of_day, words):
        _, found = clean.found(clean.table.assign(time_s=time))
        assert found.total_damage == pytest.approx(clean.damage, rel=1e-3)


def test_a_clock_that_is_set_back_is_refused(logs):
    table = logs["driven"].table
    with pytest.raises(StudyError, match=r"time goes back: 0 s after 6 s; if these are two logs"):
        logs["driven"].found(pd.concat([table, table]))
