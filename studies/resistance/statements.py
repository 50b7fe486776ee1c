"""What the sweep `resistance` says: claims and effects of JP H07-322414 against thresholds that are stated here."""

from collections.abc import Callable

import pandas as pd

from alloc.estimation.excitation import LARGEST_DEVIATION
from studies.core.statement import Interval, Statement, mean_interval, share_interval
from studies.core.verdict import Part, Test, judge
from studies.resistance.driven_cases import CARS, EXACT, FEEDBACK, FRONT, LEARNED, RIGHT, WRONGLY
from studies.resistance.events import FALSE_BY, ONE_CAR, column
from studies.resistance.learners import GRADIENT, NORMALISED, PRINTED, SQUARES

MOUTH, SLOPE = "tunnel mouth", "gradient change"
NEARLY_ZERO = 0.05
"""Root mean square of I_FB over that of the current, below which I_FB counts as nearly zero."""
CONVERGED = 0.05
"""Relative error of a weight below which it counts as converged."""
AS_GOOD = 1.25
"""Disturbance with learnt weights over that with the true ones, below which learning counts as having arrived."""
DRIFT = 1.0
"""Error of the speed [m/s] from which on nothing holds the speed."""
METHOD = (
    "one random run of each case per event (studies/resistance/events.py), common random numbers; means with "
    "Student's t, shares after Wilson, 95 %"
)
PARTS: dict[str, Part] = {
    "the commuter train": lambda e: e["route"] == "commuter",
    "the high-speed train": lambda e: e["route"] == "high-speed",
    "P control": lambda e: e["control"] == "P",
    "PI control": lambda e: e["control"] == "PI",
}

Quantity = Callable[[pd.DataFrame], "pd.Series[float]"]


def resistance_statements(table: pd.DataFrame) -> list[Statement]:
    """All statements on a table with one row per event."""
    found = []
    for kind, word in ((MOUTH, "mouth"), (SLOPE, "gradient")):
        for quantity, what in (
            ("speed_peak", "speed, peak"), ("acceleration_rms", "acceleration, rms"),
            ("acceleration_peak", "acceleration, peak"), ("jerk_peak", "jerk, peak"),
        ):  # fmt: skip
            found.append(_compensation(table, kind, word, quantity, what))
    for kind, word in ((MOUTH, "mouth"), (SLOPE, "gradient")):
        found.append(_wrong(table, kind, word))
        found.append(_learned(table, kind, word))
    return [
        *found,
        *_zero(table),
        *_weights(table),
        *_excitation(table),
        *_switch(table),
        *_load(table),
    ]


def _ratio(quantity: str, kind: str, over: str, under: str) -> Quantity:
    return lambda e: e[column(quantity, kind, over)] / e[column(quantity, kind, under)]


def _judged(
    name: str, claim: str, table: pd.DataFrame, test: Test, label: str, **numbers: Quantity
) -> Statement:
    """A statement whose verdict is that of `test`; `numbers` go along."""
    found = judge(table, test, PARTS, lambda i: f"{i.value:.3g} [{i.low:.3g}, {i.high:.3g}]")
    side = "<" if test.wanted < 0 else ">"
    others = {text.replace("_", " "): mean_interval(q(table)) for text, q in numbers.items()}
    return Statement(
        name, claim, found.verdict, {label: found.whole, **others}, found.conditions,
        f"{label} {side} {test.threshold:g}; {METHOD}",
    )  # fmt: skip


def _compensation(table: pd.DataFrame, kind: str, word: str, quantity: str, what: str) -> Statement:
    """Claims 1 and 2."""
    return _judged(
        f"1, 2: {what}, {word}",
        f"compensation by position lessens the disturbance ({what}) at a {kind}",
        table,
        Test(_ratio(quantity, kind, RIGHT, FEEDBACK), 1.0, -1),
        "disturbance, over that of the feedback alone",
        memory_read_at_the_front=_ratio(quantity, kind, FRONT, FEEDBACK),
        memory_read_car_by_car=_ratio(quantity, kind, CARS, FEEDBACK),
        of_a_single_car=_ratio(quantity, kind, ONE_CAR[RIGHT], ONE_CAR[FEEDBACK]),
    )


def _wrong(table: pd.DataFrame, kind: str, word: str) -> Statement:
    return _judged(
        f"wrong coefficients, {word}",
        f"compensation with coefficients wrong by 30 % disturbs the speed more at a {kind} than with true ones",
        table,
        Test(_ratio("speed_peak", kind, WRONGLY, RIGHT), 1.0, 1),
        "peak of speed, over that with true coefficients",
        over_that_of_the_feedback_alone=_ratio("speed_peak", kind, WRONGLY, FEEDBACK),
    )


def _learned(table: pd.DataFrame, kind: str, word: str) -> Statement:
    """Claims 3 and 4."""
    return _judged(
        f"3, 4: learned, {word}",
        f"after one run of learning from wrong coefficients the speed is as steady at a {kind} as with true ones",
        table,
        Test(_ratio("speed_peak", kind, LEARNED, RIGHT), AS_GOOD, -1),
        "peak of speed, over that with true coefficients",
        over_that_of_the_feedback_alone=_ratio("speed_peak", kind, LEARNED, FEEDBACK),
    )


def _zero(table: pd.DataFrame) -> list[Statement]:
    return [
        _judged(
            "true weights, no feedback",
            "with true weights the feedback current is nearly zero (five weights, memory car by car)",
            table,
            Test(lambda e: e[f"feedback_share@{EXACT}"], NEARLY_ZERO, -1),
            "rms of I_FB over rms of I",
            with_learned_weights=lambda e: e[f"feedback_share@{LEARNED}"],
            with_compensation_only=lambda e: e[f"feedback_share@{RIGHT}"],
        )
    ]


def _error(name: str) -> Quantity:
    return lambda e: (e[name] - 1.0).abs()


def _weights(table: pd.DataFrame) -> list[Statement]:
    statements = [
        _judged(
            f"W3 converges: {learner}",
            f"W3 converges to the train's mass ({learner}, stand-alone, one run, rotating mass known)",
            table,
            Test(_error(f"W3@{learner}, 3"), CONVERGED, -1),
            "relative error of W3",
            W1_over_air_resistance=lambda e, name=f"W1@{learner}, 3": e[name],  # type: ignore[misc]
        )
        for learner in (PRINTED, GRADIENT, NORMALISED, SQUARES)
    ]
    statements.append(
        _judged(
            "W3 converges while compensating",
            "W3 converges to the train's mass while it compensates (claims 3, 4; normalised gradient, two runs)",
            table,
            Test(_error(f"W3@{LEARNED}"), CONVERGED, -1),
            "relative error of W3",
        )
    )
    statements.append(
        _judged(
            "W1 is air resistance",
            "W1 converges to the air resistance C (least squares)",
            table,
            Test(_error(f"W1@{SQUARES}, 3"), CONVERGED, -1),
            "relative error of W1",
            that_of_C_with_A_and_B_put_into_it=lambda e: (
                e[f"W1@{SQUARES}, 3"] / e["equivalent W1"] - 1.0
            ).abs(),
            with_five_weights=_error(f"W1@{SQUARES}, 5"),
            W3_with_five_weights=_error(f"W3@{SQUARES}, 5"),
        )
    )
    return statements


def _excitation(table: pd.DataFrame) -> list[Statement]:
    return [
        _judged(
            "excitation detected",
            f"no weight of five is called learned that is wrong by {100 * FALSE_BY:.0f} %",
            table,
            Test(lambda e: e["falsely learned@5"], 0.05, -1),
            "weights falsely called learned per run",
            weights_called_learned_per_run=lambda e: e["learned@5"],
            of_three_falsely=lambda e: e["falsely learned@3"],
            of_three_called_learned=lambda e: e["learned@3"],
        )
    ]


def _switch(table: pd.DataFrame) -> list[Statement]:
    drifts = share_interval(table["use as printed speed error"].dropna() > DRIFT)
    arrives = _judged(
        "5: learn, then use",
        "the switch comes to use what was learnt, for most of the run",
        table,
        Test(lambda e: e["use share"], 0.5, 1),
        "share of the run in which it is used",
        changes_of_the_switch=lambda e: e["use changes"],
        speed_error_in_use_in_m_per_s=lambda e: e["use speed error"],
    )
    holds = _judged(
        "5 as printed holds the speed",
        "the feedforward alone, as printed, keeps the speed to 1 m/s while it is used",
        table,
        Test(lambda e: e["use as printed speed error"], DRIFT, -1),
        "largest error of speed in use [m/s]",
    )
    holds.numbers["share of runs beyond 1 m/s"] = drifts
    return [arrives, holds]


def _load(table: pd.DataFrame) -> list[Statement]:
    def off(rail: str, belief: str) -> Quantity:
        return lambda e: (
            e[f"acceleration@{rail}@{belief}"] / e[f"acceleration@{rail}@true loads"] - 1.0
        ).abs()

    def slip(belief: str) -> Quantity:
        return lambda e: e[f"slip_time@slippery@{belief}"]

    mass = {
        f"with {name}": (lambda e, key=f"mass@{name}": e[key].abs())
        for name in ("three weights", "three weights, rotating mass not known")
    }
    learned = _judged(
        "mass after boarding",
        "the mass after boarding is learnt on the first departure (least squares, five weights)",
        table,
        Test(lambda e: e["mass@five weights"].abs(), LARGEST_DEVIATION, -1),
        "relative error of the mass",
        before_learning=lambda e: e["mass@not learned"].abs(),
    )
    learned.numbers.update({text: mean_interval(q(table)) for text, q in mass.items()})
    dry = _judged(
        "load compensation, dry rail",
        "the learnt mass as load signal of (6') gives the planned acceleration where load sensors are wrong by 30 %",
        table,
        Test(lambda e: off("dry", "mass learned")(e) / off("dry", "sensors wrong")(e), 0.5, -1),
        "error of acceleration, over that with wrong sensors",
        error_with_wrong_sensors=off("dry", "sensors wrong"),
        error_with_the_learnt_mass=off("dry", "mass learned"),
    )
    wet = _judged(
        "load compensation, slippery rail",
        "on a slippery rail the learnt mass, spread evenly, gives at least the acceleration of wrong sensors",
        table,
        Test(
            lambda e: e["acceleration@slippery@mass learned"] / e["acceleration@slippery@sensors wrong"],
            1.0, 1,
        ),
        "acceleration, over that with wrong sensors",
        sensors_scaled_to_the_learnt_mass=lambda e: (
            e["acceleration@slippery@sensors scaled to the mass learned"]
            / e["acceleration@slippery@sensors wrong"]
        ),
        slip_time_with_wrong_sensors_in_s=slip("sensors wrong"),
        slip_time_with_the_learnt_mass_in_s=slip("mass learned"),
        slip_time_with_sensors_scaled_in_s=slip("sensors scaled to the mass learned"),
    )  # fmt: skip
    return [learned, dry, wet]


__all__ = ["Interval", "resistance_statements"]
