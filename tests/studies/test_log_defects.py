"""What recorders do to a log is made up for and said: Q is right within 2 %, and the number of slips but for two."""

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest

from alloc.estimation.slip_events import SMALL
from studies.log_accuracy import defects as spoil
from studies.logs.channels import forwards
from studies.logs.mapping import Mapping
from studies.logs.report import fit_remarks
from tests.studies.logged_runs import Logged, at_contact, clean, logged, misread, said

Change = Callable[[Logged], pd.DataFrame]


def turned(table: pd.DataFrame, names: list[str]) -> pd.DataFrame:
    return table.assign(**{name: -table[name] for name in names})


def put(table: pd.DataFrame, *places: tuple[int, int, float]) -> pd.DataFrame:
    """Other values in rows of axles' speeds."""
    table = table.copy()
    for row, axle, value in places:
        table.loc[table.index[row], f"axle{axle}_speed_kmh"] = value
    return table


def free(one: Logged) -> list[int]:
    return [
        i for i in spoil.axles_of(one.table) if one.table[f"axle{i}_force_kn"].abs().max() < 0.1
    ]


def dropped(table: pd.DataFrame) -> pd.DataFrame:
    """A receiver that says 0 where it has no fix, and jumps now and then."""
    time, speed = table["time_s"], table["speed_kmh"].copy()
    speed[(time > 8.0) & (time < 11.5)] = 0.0
    speed[(time > 20.0) & (time < 20.4)] = 0.0
    speed[::211] += 20.0
    return table.assign(speed_kmh=speed)


def forces(late: float) -> Change:
    return lambda c: spoil.shifted(c.table, spoil.forces_of(c.table), late)


def counts(period: float) -> Change:
    return lambda c: spoil.counted(c.table, c.train.radius, period)


def plain(change: Callable[[pd.DataFrame], pd.DataFrame]) -> Change:
    return lambda c: change(c.table)


STOP, LATE = "wet-stop 0", "s late: made up for"
DEFECTS: dict[str, tuple[Change, str, str, dict[str, float]]] = {
    # the speed's channel
    "late": (plain(spoil.speed_late), "driven, wet-stop 0", LATE, {}),
    "late by a period": (plain(lambda t: spoil.speed_late(t, 0.01)), STOP, "", {}),
    "noisy, late": (plain(lambda t: spoil.speed_late(spoil.noisy(t, 0.02))), STOP, LATE, {"share": 0.03}),
    "held": (plain(spoil.speed_held), "driven, wet-stop 0", LATE, {}),
    "interpolated": (plain(spoil.speed_interpolated), "driven", LATE, {}),
    "gaps": (plain(spoil.speed_with_gaps), STOP, LATE, {}),
    "lost": (plain(lambda t: t.assign(speed_kmh=t["speed_kmh"].where(abs(t["time_s"] - 3.0) > 1.5))), "driven", "", {}),
    "dropouts": (plain(dropped), "braked", "stuck while the wheels", {}),
    "scale": (plain(lambda t: t.assign(speed_kmh=1.01 * t["speed_kmh"])), STOP, "the train's speed is +1.0", {}),
    # forces
    "slow forces": (plain(spoil.forces_at), "braked", "", {}),
    "slow forces, held": (plain(lambda t: spoil.forces_at(t, held=True)), "driven", "", {}),
    "interleaved": (plain(spoil.interleaved), STOP, "", {}),
    "forces late": (forces(0.3), "braked", "s later than the wheels", {}),
    "forces a little late": (forces(0.15), "driven", "all forces are recorded 0.15", {}),
    "forces early": (forces(-0.2), "braked", "s earlier than the wheels", {}),
    "one force reversed": (plain(lambda t: turned(t, ["axle2_force_kn"])), STOP, "its wheel says so: turned", {}),
    "all forces reversed": (plain(lambda t: turned(t, spoil.forces_of(t))), STOP, "all forces drive what brakes", {}),
    "forces at the contact": (at_contact, "braked", "those between wheel and rail", {}),
    # wheels
    "wheels late": (plain(lambda t: spoil.shifted(t, spoil.wheels_of(t), 0.2)), "braked", "s earlier than the wheels", {}),
    "counts 5 ms": (counts(0.005), STOP, "pulses", {"slips": 9}),
    "counts 10 ms": (counts(0.01), STOP, "pulses", {"slips": 4}),
    "counts 20 ms": (counts(0.02), "driven", "pulses", {"slips": 3}),
    "held, counted": (
        lambda c: spoil.counted(spoil.speed_held(c.table), c.train.radius, 0.02), STOP, "pulses", {"slips": 3},
    ),
    "rounded": (plain(lambda t: spoil.rounded_to(t, spoil.speeds_of(t), 0.1)), STOP, "", {}),
    "every seventh missing": (plain(spoil.values_missing), "braked", "", {}),
    "values that no wheel reaches": (
        plain(lambda t: put(t, (400, 3, 90.0), (0, 4, 90.0), (-1, 5, 130.0), (400, 6, -9999.0))), STOP,
        "to which no speed jumps", {},
    ),
    "radii": (lambda c: spoil.by_radius(c.table, {free(c)[0]: 0.98, free(c)[5]: 1.01}), "driven", "off by a radius", {}),
    "a radius of a wheel that pulls": (
        lambda c: spoil.by_radius(c.table, {(set(spoil.axles_of(c.table)) - set(free(c))).pop(): 1.03}), "driven",
        "off by a radius", {"share": 0.05},
    ),
    "backwards": (plain(spoil.reversed_signs), STOP, "the direction is turned round", {}),
    # recorders and clocks; where all wheels slide no one tells that half of them are late
    "half of the axles late": (
        plain(lambda t: spoil.rear_late(t, 0.3)), "driven", "axles 17 to 32 are recorded 0.3", {"share": 0.08},
    ),
    "half of the axles late in a slide": (plain(lambda t: spoil.rear_late(t, 0.15)), "long stop", "", {"slips": 14}),
    "past midnight": (plain(lambda t: t.assign(time_s=(86397.0 + t["time_s"]) % 86400.0)), "driven", "", {}),
    "a row twice": (plain(spoil.repeated_row), "driven", "", {}),
    "clock set back": (
        plain(lambda t: t.assign(time_s=t["time_s"] - 0.3 * (t["time_s"] >= 5.0))), STOP, "set back by 0.", {},
    ),
}  # fmt: skip
"""By name: the change, the runs that it spoils, what is said, and bounds that are not the usual ones."""


def test_defects_are_made_up_for_and_said():
    """And clean logs need no word."""
    wrong = {}
    for name in ("braked", "driven", STOP):
        log, found = clean(name)
        if said(log, found) or abs(found.total_damage / logged(name).damage - 1.0) > 1e-3:
            wrong[name] = (said(log, found), found.total_damage, logged(name).damage)
    for name, (change, runs, words, bounds) in DEFECTS.items():
        for run in runs.split(", "):
            if found := misread(run, change(logged(run)), words, **bounds):
                wrong[f"{name}, {run}"] = found
    assert not wrong, "\n" + "\n".join(f"{key}: {value}" for key, value in wrong.items())


def test_the_delay_of_a_rare_speed_is_found():
    braked, wrong = logged("braked"), {}
    for spoilt, late, period in (
        (spoil.speed_held, 0.5, 1.0), (spoil.speed_interpolated, 0.23, 0.5), (spoil.speed_with_gaps, 1.1, 1.0),
        (spoil.speed_held, 0.0, 1.0),
    ):  # fmt: skip
        log, found = braked.found(spoilt(braked.table, late, period))
        delay, q = log.run.speed_delay, found.total_damage / braked.damage - 1.0
        # 0.5 s at 0.75 m/s2 is more than Q allows, and no delay moves nothing
        flagged = any(one.kind == "delay" for one in fit_remarks(log, found))
        near = abs(delay.value - late) < max(0.003, 4.0 * delay.deviation)
        if not (near and abs(q) < 0.02 and flagged == (late > 0.0)):
            wrong[spoilt.__name__, late] = (delay, q, flagged)
    assert not wrong


def test_the_stated_error_of_damage_covers_what_noise_does():
    braked, errors = logged("braked"), []
    for seed in range(4):
        _, found = braked.found(spoil.speed_held(spoil.noisy(braked.table, 0.1, seed)))
        errors.append(abs(found.total_damage - braked.damage) / found.errors.total)
    assert sorted(errors)[2] < 2.0, errors


def test_small_slips_are_found_where_noise_allows():
    table, quiet = logged("braked").table, clean("braked")[1]
    _, loud = logged("braked").found(spoil.noisy(table, 0.4))
    assert quiet.least_slip.max() == SMALL.velocity
    assert loud.least_slip.min() > SMALL.velocity
    assert quiet.small_events
    assert all(event.slip_ratio < 0.051 for event in quiet.small_events)
    # wheels that roll have none, however loud
    rolling = table.assign(speed_kmh=60.0)
    for name in [name for name in rolling if "axle" in name]:
        rolling[name] = 60.0 if "speed" in name else 0.0
    _, nothing = logged("braked").found(spoil.noisy(rolling, 0.4))
    assert (nothing.events, nothing.small_events) == ([], ())


def test_a_climb_is_no_fault_of_the_wheels():
    train = logged("driven").train
    time = 0.01 * np.arange(3000)
    speed = 8.0 + 0.1 * time
    pull = train.car_mass.sum() * (0.1 + 9.81 * 0.03) / train.driven.sum()
    table = pd.DataFrame({"time_s": time, "speed_kmh": 3.6 * speed})
    for i, driven_axle in enumerate(train.driven, 1):
        table[f"axle{i}_speed_kmh"] = 3.6 * speed * (1.004 if driven_axle else 1.0)
        table[f"axle{i}_force_kn"] = 1e-3 * pull if driven_axle else 0.0
    for told in (table, table.assign(gradient_permille=30.0)):
        log, found = logged("driven").found(told)
        assert not [one for one in said(log, found) if one.startswith(("radius", "balance"))]


def counter(axle: int, total: np.ndarray) -> np.ndarray:
    """Of so many bits, since the row before, of three digits, set back in the middle, in turn."""
    again = np.where(np.arange(total.size) < total.size // 2, total, total - total[total.size // 2])
    return (total % 4096, np.diff(total, prepend=0.0), total % 1000, again)[axle % 4]


def mapped() -> dict[str, dict[str, object]]:
    columns: dict[str, dict[str, object]] = {"time_s": {"is": "time", "unit": "s"}}
    columns["speed_kmh"] = {"is": "speed", "unit": "km/h"}
    for i in range(1, 13):
        columns[f"axle{i}_force_kn"] = {"is": f"axle{i}_force", "unit": "kN"}
        columns[f"axle{i}_speed_kmh"] = {"is": f"axle{i}_speed", "unit": "km/h"}
    return columns


def test_a_mapping_says_what_names_do_not():
    """Counters of four kinds; motors behind a gear; forces at the contact."""
    one = logged("braked")
    time, radius = one.table["time_s"].to_numpy(), one.train.radius
    wheels = spoil.wheels_of(one.table)
    pulses, motors, gear = (
        one.table.drop(columns=wheels),
        one.table[["time_s", "speed_kmh"]].copy(),
        5.83,
    )
    of_pulses, of_motors = mapped(), {name: mapped()[name] for name in motors}
    for i, name in enumerate(wheels, 1):
        rim = one.table[name].to_numpy() / 3.6
        way = np.concatenate([[0.0], np.cumsum(0.5 * (rim[1:] + rim[:-1]) * np.diff(time))])
        counted = counter(i, np.floor(way / (2.0 * np.pi * radius[i - 1]) * 80.0))
        torque = 1e3 * one.table[f"axle{i}_force_kn"] * radius[i - 1] / gear
        pulses[f"imp{i}"] = counted
        del of_pulses[name]
        of_pulses[f"imp{i}"] = {"is": f"axle{i}_pulses", "pulses_per_turn": 80}
        motors[f"n{i}"], motors[f"M{i}"] = rim / radius[i - 1] * gear * 30.0 / np.pi, torque
        of_motors[f"n{i}"] = {"is": f"axle{i}_speed", "unit": "rpm", "gear_ratio": gear}
        of_motors[f"M{i}"] = {"is": f"axle{i}_torque", "unit": "N m", "gear_ratio": gear}
    contact = {"columns": mapped(), "forces": {"at": "contact"}}
    for table, told in (
        (pulses, {"columns": of_pulses}), (motors, {"columns": of_motors}), (at_contact(one), contact)
    ):  # fmt: skip
        log, found = one.found(table, Mapping.model_validate(told))
        assert found.total_damage == pytest.approx(one.damage, rel=0.02)
        assert not [remark for remark in said(log, found) if remark.startswith("guess")]


def test_a_pulse_back_is_no_fault_and_a_speed_far_below_0_is():
    counted = np.tile([1.0, 0.0], 200)
    counted[300:] *= -1.0
    speed, remarks = forwards("axle1_speed", 3.4 * counted, "log")
    assert (np.isfinite(speed).all(), remarks) == (True, [])
    smooth = np.linspace(20.0, 0.0, 400)
    smooth[100:103] = -3.4
    speed, remarks = forwards("axle1_speed", smooth, "log")
    assert np.isnan(speed[100:103]).all()
    assert "3 values that no train has" in remarks[0].text
