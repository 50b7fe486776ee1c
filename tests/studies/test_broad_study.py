"""The broad events span what they say, are other studies' events on other rails, and their statements count right."""

import numpy as np
import pandas as pd
import pytest

from alloc.plant.model import offered_by
from studies.core.drawn_events import START_SPEED
from studies.core.statement import CONDITIONS, FAILS, HOLDS
from studies.ladder.broad_study import (
    BROAD,
    EVENTS,
    FASTEST,
    FEW,
    FULL_EFFORT,
    GAINED,
    KINDS,
    RULES,
    STOP,
    scenario,
    statements,
)
from studies.stops.blended_events import CURVES

TURN = len(KINDS) * len(CURVES)
"""Events in which every kind meets every curve."""


def broad_table(gain=0.01, over=0.0, controller="perturb-observe", events=TURN):
    """Every rule but alone uses `gain` more of the bound, and delivers `over` beyond the plan; a little noise."""
    noise, rows = np.random.default_rng(4), []
    for k in range(events):
        base = 0.95 + 0.01 * noise.standard_normal()
        for rule in RULES:
            more = 0.0 if rule == "alone" else gain + 0.0005 * noise.standard_normal()
            rows.append({
                "scenario": EVENTS.event_name(0, k), "rule": rule, "controller": controller, "status": "ok",
                "bound_use": base + more, "over_delivery": 0.0 if rule == "alone" else over, "headroom": 0.02 * (k % 2),
                "slip_time": 1.0, "damage": 100.0, "excess_damage": 0.1, "jerk_rms": 0.3,
            })  # fmt: skip
    return EVENTS.joined(pd.DataFrame(rows), 0, events)


def test_a_turn_has_every_kind_on_every_curve_and_spans_speeds_trains_and_signals():
    cars, speeds, lags, noises, losses, pairs = [], [], [], [], [], set()
    for k in range(TURN):
        d, one = EVENTS.draw(7, k), scenario(7, k)
        event = one.event(k)
        cars.append(len(event.model.train.cars))
        speeds.append(one.initial_speed_kmh)
        lags.append(one.motors.torque_lag_s)
        noises.append(one.onboard.sensors.speed_noise_kmh)
        losses.append(one.onboard.telegrams.loss)
        pairs.add((d["kind"], one.rail.curve.kind))
        assert (one.command[0].acceleration_kmhs < 0.0) == (d["kind"] == STOP)
    assert len(pairs - {pair for pair in pairs if pair[0] == STOP}) == TURN - len(CURVES)
    assert len({curve for kind, curve in pairs if kind == STOP}) > 2
    assert min(cars) == 1  # a railcar of two sections
    assert max(cars) >= 8
    assert min(speeds) == 0.0
    assert 100.0 < max(speeds) <= FASTEST
    for values, low, high in ((lags, 0.005, 0.1), (noises, 0.0, 0.1), (losses, 0.0, 0.1)):
        assert low <= min(values) < low + 0.2 * (high - low)
        assert high >= max(values) > high - 0.2 * (high - low)


def test_another_curve_offers_what_the_own_one_does_and_at_speed_as_much_less_as_is_asked_for():
    checked = 0
    for k in range(TURN):
        d = EVENTS.draw(7, k)
        one, base = scenario(7, k), KINDS[d["kind"]](7, k)
        if d["kind"] == STOP or d["short"] == "yes" or base.rail.law_factor is not None:
            continue
        share = one.command[0].acceleration_kmhs / base.command[0].acceleration_kmhs
        assert share * (d["speed_kmh"] + share * GAINED) <= FULL_EFFORT * (1.0 + 1e-9)
        before, after = base.event(k).model, one.event(k).model
        own = offered_by(before.rail.curve, base.rail.level, START_SPEED, before.structure)
        speed = max(START_SPEED, d["speed_kmh"] / 3.6)
        found = offered_by(after.rail.curve, one.rail.level, speed, after.structure)
        assert found == pytest.approx(share * own, rel=1e-3)
        checked += 1
    assert checked >= len(CURVES)


def test_a_rule_must_use_more_than_alone_and_deliver_no_more_than_the_plan():
    def verdicts(**made):
        return {one.verdict for one in statements(broad_table(**made))}

    assert verdicts() == {HOLDS}
    assert verdicts(gain=-0.01) == {FAILS}
    assert verdicts(over=0.02) == {CONDITIONS}
    (own,) = (one for one in statements(broad_table(gain=-0.01)) if one.name.startswith("erp"))
    assert own.numbers["share of events that are worse"].value == 1.0


def test_all_rules_meet_the_same_event_and_few_of_them_a_controller_in_python(tmp_path):
    swept = BROAD.run(tmp_path, 1, controllers=["cut-and-ramp"])
    assert (swept["status"] == "ok").all(), swept["reason"].tolist()
    assert swept["rule"].tolist() == list(RULES)
    assert swept["scenario_hash"].nunique() == 1
    assert [job.rule for job in BROAD.cells(0, 1, controllers=["mpc"])] == list(FEW)
