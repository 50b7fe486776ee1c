"""Statements of the sweep `resistance`: claims and effects of JP H07-322414 against thresholds that are stated here."""

from collections.abc import Callable, Mapping
from typing import Literal

import pandas as pd

from alloc.estimation.running_resistance import LARGEST_DEVIATION
from studies.core.family import Claim, Part, Test, compared
from studies.core.statement import INTERVALS_OF_MEANS, Statement, in_words
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
"""Error of the speed [m/s] above which nothing holds the speed."""
METHOD = (
    "one random run of each case per event (studies/resistance/events.py), common random numbers; "
    f"{INTERVALS_OF_MEANS}; shares after Wilson, 95 %; after Holm over all claims"
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
    kinds = ((MOUTH, "mouth"), (SLOPE, "gradient"))
    quantities = ("speed_peak", "acceleration_rms", "acceleration_peak", "jerk_peak")
    claims = [
        *(_compensation(table, kind, word, quantity) for kind, word in kinds for quantity in quantities),
        *(one for kind, word in kinds for one in _coefficients(table, kind, word)),
        *_weights(table),
        *_switch(table),
        *_load(table),
    ]  # fmt: skip
    return compared(claims)


def _values(name: str) -> Quantity:
    return lambda e: e[name]


def _ratio(over: str, under: str) -> Quantity:
    return lambda e: e[over] / e[under]


def _off(quantity: Quantity) -> Quantity:
    """By how much it is away from 1."""
    return lambda e: (quantity(e) - 1.0).abs()


def _judged(
    table: pd.DataFrame, name: str, claim: str, quantity: Quantity, side: Literal["<", ">"],
    threshold: float, label: str, **numbers: Quantity,
) -> Claim:  # fmt: skip
    named = {text.replace("_", " "): q for text, q in numbers.items()}
    return mean_claim(table, name, claim, quantity, side, threshold, label, named)


def mean_claim(
    table: pd.DataFrame, name: str, claim: str, quantity: Quantity, side: Literal["<", ">"],
    threshold: float, label: str, numbers: Mapping[str, Quantity], method: str = METHOD,
) -> Claim:  # fmt: skip
    """Whether the mean of a quantity is on its side of the threshold; `numbers` are added to the statement."""
    test = Test(quantity, threshold, 1 if side == ">" else -1)
    quantities = {label: quantity} | dict(numbers)
    return Claim(
        name, claim, table, test, PARTS, in_words("{:.3g} [{:.3g}, {:.3g}]"),
        {text: q(table) for text, q in quantities.items()},
        f"{label} {side} {threshold:g}; {method}",
    )  # fmt: skip


def _compensation(table: pd.DataFrame, kind: str, word: str, quantity: str) -> Claim:
    """Claims 1 and 2."""
    what = quantity.replace("_", ", ")

    def over_feedback(case: str, feedback: str = FEEDBACK) -> Quantity:
        return _ratio(column(quantity, kind, case), column(quantity, kind, feedback))

    return _judged(
        table, f"1, 2: {what}, {word}",
        f"compensation by position lessens the disturbance ({what}) at a {kind}",
        over_feedback(RIGHT), "<", 1.0, "disturbance, over that of the feedback alone",
        memory_read_at_the_front=over_feedback(FRONT),
        memory_read_car_by_car=over_feedback(CARS),
        of_a_single_car=over_feedback(ONE_CAR[RIGHT], ONE_CAR[FEEDBACK]),
    )  # fmt: skip


def _coefficients(table: pd.DataFrame, kind: str, word: str) -> list[Claim]:
    """Wrong ones, and claims 3 and 4."""

    def peak(case: str, other: str) -> Quantity:
        return _ratio(column("speed_peak", kind, case), column("speed_peak", kind, other))

    label = "peak of speed, over that with true coefficients"
    return [
        _judged(
            table, f"wrong coefficients, {word}",
            f"compensation with coefficients wrong by 30 % disturbs the speed more at a {kind} than with true ones",
            peak(WRONGLY, RIGHT), ">", 1.0, label,
            over_that_of_the_feedback_alone=peak(WRONGLY, FEEDBACK),
        ),
        _judged(
            table, f"3, 4: learned, {word}",
            f"after one run of learning from wrong coefficients the speed is as steady at a {kind} as with true ones",
            peak(LEARNED, RIGHT), "<", AS_GOOD, label,
            over_that_of_the_feedback_alone=peak(LEARNED, FEEDBACK),
        ),
    ]  # fmt: skip


def _weights(table: pd.DataFrame) -> list[Claim]:
    def error(name: str) -> Quantity:
        return _off(_values(name))

    return [
        _judged(
            table, "true weights, no feedback",
            "with true weights the feedback current is nearly zero (five weights, memory car by car)",
            _values(f"feedback_share@{EXACT}"), "<", NEARLY_ZERO, "rms of I_FB over rms of I",
            with_learned_weights=_values(f"feedback_share@{LEARNED}"),
            with_compensation_only=_values(f"feedback_share@{RIGHT}"),
        ),
        *(
            _judged(
                table, f"W3 converges: {learner}",
                f"W3 converges to the train's mass ({learner}, stand-alone, one run, rotating mass known)",
                error(f"W3@{learner}, 3"), "<", CONVERGED, "relative error of W3",
                W1_over_air_resistance=_values(f"W1@{learner}, 3"),
            )
            for learner in (PRINTED, GRADIENT, NORMALISED, SQUARES)
        ),
        _judged(
            table, "W3 converges while compensating",
            "W3 converges to the train's mass while it compensates (claims 3, 4; normalised gradient, two runs)",
            error(f"W3@{LEARNED}"), "<", CONVERGED, "relative error of W3",
        ),
        _judged(
            table, "W1 is air resistance", "W1 converges to the air resistance C (least squares)",
            error(f"W1@{SQUARES}, 3"), "<", CONVERGED, "relative error of W1",
            that_of_C_with_A_and_B_put_into_it=_off(_ratio(f"W1@{SQUARES}, 3", "equivalent W1")),
            with_five_weights=error(f"W1@{SQUARES}, 5"),
            W3_with_five_weights=error(f"W3@{SQUARES}, 5"),
        ),
        _judged(
            table, "excitation detected",
            f"no weight of five is called learned that is wrong by {100 * FALSE_BY:.0f} %",
            _values("falsely learned@5"), "<", 0.05, "weights falsely called learned per run",
            weights_called_learned_per_run=_values("learned@5"),
            of_three_falsely=_values("falsely learned@3"),
            of_three_called_learned=_values("learned@3"),
        ),
    ]  # fmt: skip


def _switch(table: pd.DataFrame) -> list[Claim]:
    error = "use as printed speed error"
    return [
        _judged(
            table, "5: learn, then use", "the switch comes to use what was learnt, for most of the run",
            _values("use share"), ">", 0.5, "share of the run in which it is used",
            changes_of_the_switch=_values("use changes"),
            speed_error_in_use_in_m_per_s=_values("use speed error"),
        ),
        _judged(
            table, "5 as printed holds the speed",
            "the feedforward alone, as printed, keeps the speed to 1 m/s while it is used",
            _values(error), "<", DRIFT, "largest error of speed in use [m/s]",
            **{"share of runs beyond 1 m/s": lambda e: e[error].dropna() > DRIFT},
        ),
    ]  # fmt: skip


def _load(table: pd.DataFrame) -> list[Claim]:
    def size(name: str) -> Quantity:
        return lambda e: e[f"mass@{name}"].abs()

    def off(belief: str) -> Quantity:
        return _off(_ratio(f"acceleration@dry@{belief}", "acceleration@dry@true loads"))

    def gained(belief: str) -> Quantity:
        return _ratio(f"acceleration@slippery@{belief}", "acceleration@slippery@sensors wrong")

    three = {
        f"with {k}": size(k) for k in ("three weights", "three weights, rotating mass not known")
    }
    scaled = "sensors scaled to the mass learned"
    return [
        _judged(
            table, "mass after boarding",
            "the mass after boarding is learnt on the first departure (least squares, five weights)",
            size("five weights"), "<", LARGEST_DEVIATION, "relative error of the mass",
            before_learning=size("not learned"), **three,
        ),
        _judged(
            table, "load compensation, dry rail",
            "the learnt mass as load signal of (6') gives the planned acceleration where load sensors are wrong by 30 %",
            lambda e: off("mass learned")(e) / off("sensors wrong")(e), "<", 0.5,
            "error of acceleration, over that with wrong sensors",
            error_with_wrong_sensors=off("sensors wrong"),
            error_with_the_learnt_mass=off("mass learned"),
        ),
        _judged(
            table, "load compensation, slippery rail",
            "on a slippery rail the learnt mass, spread evenly, gives at least the acceleration of wrong sensors",
            gained("mass learned"), ">", 1.0, "acceleration, over that with wrong sensors",
            sensors_scaled_to_the_learnt_mass=gained(scaled),
            slip_time_with_wrong_sensors_in_s=_values("slip_time@slippery@sensors wrong"),
            slip_time_with_the_learnt_mass_in_s=_values("slip_time@slippery@mass learned"),
            slip_time_with_sensors_scaled_in_s=_values(f"slip_time@slippery@{scaled}"),
        ),
    ]  # fmt: skip
