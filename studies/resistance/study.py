"""Running resistance (JP H07-322414): does compensation steady the train, do the weights converge, does the mass help?"""

from collections.abc import Mapping

import pandas as pd

from alloc.estimation.running_resistance import LARGEST_DEVIATION
from studies.core.cell import Task
from studies.core.claims import AT_LEAST, AT_MOST, Claim, Side, family
from studies.core.statement import INTERVALS_OF_MEANS, Statement, in_words
from studies.core.study import EachEvent, Study
from studies.resistance.driven_cases import (
    CARS,
    EXACT,
    FEEDBACK,
    FRONT,
    GRADIENT,
    LEARNED,
    NORMALISED,
    PRINTED,
    RIGHT,
    SQUARES,
    WRONGLY,
)
from studies.resistance.events import FALSE_BY, ONE_CAR, column, event_row

# Claims of the sweep `resistance`: claims and effects of JP H07-322414 against thresholds that are stated here.

MOUTH, SLOPE = "tunnel mouth", "gradient change"
KINDS = {MOUTH: "mouth", SLOPE: "gradient"}
"""Places where the train is disturbed, and how names of statements call them."""
NEARLY_ZERO = 0.05
"""Root mean square of I_FB over that of the current, below which I_FB counts as nearly zero."""
CONVERGED = 0.05
"""Relative error of a weight below which it counts as converged."""
AS_GOOD = 1.25
"""Disturbance with learnt weights over that with the true ones, below which learning counts as having arrived."""
DRIFT = 1.0
"""Error of the speed [m/s] above which nothing holds the speed."""
PATENT = "JP H07-322414"
METHOD = (
    "one random run of each case per event (studies/resistance/events.py), common random numbers; "
    f"{INTERVALS_OF_MEANS}; shares after Wilson, 95 %; after Holm over all claims"
)
PARTS = {
    "the commuter train": "route == commuter",
    "the high-speed train": "route == high-speed",
    "P control": "control == P",
    "PI control": "control == PI",
}


def mean_claim(
    name: str, claim: str, mean: str, side: Side, value: float, label: str, numbers: Mapping[str, str], reason: str,
    source: str = PATENT, method: str = METHOD,
) -> Claim:  # fmt: skip
    """That the mean of a quantity, called `label`, is on its side of the value; `numbers` stand beside it."""
    return Claim(
        name, claim, mean, side, value, reason=reason, source=source, parts=PARTS, show=in_words("{:.3g} [{:.3g}, {:.3g}]"),
        numbers={label: mean, **numbers}, method=f"{label} {'>' if side == AT_LEAST else '<'} {value:g}; {method}",
    )  # fmt: skip


def _over(quantity: str, kind: str, case: str, other: str = FEEDBACK) -> str:
    """A disturbance in one case over that in another."""
    return f"{column(quantity, kind, case)} / {column(quantity, kind, other)}"


def _places(kind: str, word: str) -> list[Claim]:
    """Claims 3 and 4, and what wrong coefficients do."""
    label, beside = (
        "peak of speed, over that with true coefficients",
        "over that of the feedback alone",
    )
    return [
        mean_claim(
            f"wrong coefficients, {word}",
            f"compensation with coefficients wrong by 30 % disturbs the speed more at a {kind} than with true ones",
            _over("speed_peak", kind, WRONGLY, RIGHT), AT_LEAST, 1.0, label,
            {beside: _over("speed_peak", kind, WRONGLY)}, "wrong coefficients are worse",
        ),
        mean_claim(
            f"3, 4: learned, {word}",
            f"after one run of learning from wrong coefficients the speed is as steady at a {kind} as with true ones",
            _over("speed_peak", kind, LEARNED, RIGHT), AT_MOST, AS_GOOD, label,
            {beside: _over("speed_peak", kind, LEARNED)}, "learning has arrived where a quarter is left to be gained",
        ),
    ]  # fmt: skip


WEIGHT = "relative error of W3"
THREE = ("three weights", "three weights, rotating mass not known")
SCALED = "sensors scaled to the mass learned"


def _dry(belief: str) -> str:
    return f"|acceleration@dry@{belief} / acceleration@dry@true loads - 1|"


def _slippery(belief: str) -> str:
    return f"acceleration@slippery@{belief} / acceleration@slippery@sensors wrong"


CLAIMS = (
    *(
        mean_claim(
            f"1, 2: {what}, {word}", f"compensation by position lessens the disturbance ({what}) at a {kind}",
            _over(quantity, kind, RIGHT), AT_MOST, 1.0, "disturbance, over that of the feedback alone",
            {
                "memory read at the front": _over(quantity, kind, FRONT),
                "memory read car by car": _over(quantity, kind, CARS),
                "of a single car": _over(quantity, kind, ONE_CAR[RIGHT], ONE_CAR[FEEDBACK]),
            },
            "compensation lessens the disturbance",
        )
        for kind, word in KINDS.items()
        for quantity in ("speed_peak", "acceleration_rms", "acceleration_peak", "jerk_peak")
        for what in [quantity.replace("_", ", ")]
    ),
    *(one for kind, word in KINDS.items() for one in _places(kind, word)),
    mean_claim(
        "true weights, no feedback",
        "with true weights the feedback current is nearly zero (five weights, memory car by car)",
        f"feedback_share@{EXACT}", AT_MOST, NEARLY_ZERO, "rms of I_FB over rms of I",
        {"with learned weights": f"feedback_share@{LEARNED}", "with compensation only": f"feedback_share@{RIGHT}"},
        "a twentieth is nearly zero",
    ),
    *(
        mean_claim(
            f"W3 converges: {learner}",
            f"W3 converges to the train's mass ({learner}, stand-alone, one run, rotating mass known)",
            f"|W3@{learner}, 3 - 1|", AT_MOST, CONVERGED, WEIGHT, {"W1 over air resistance": f"W1@{learner}, 3"},
            "a twentieth off is converged",
        )
        for learner in (PRINTED, GRADIENT, NORMALISED, SQUARES)
    ),
    mean_claim(
        "W3 converges while compensating",
        "W3 converges to the train's mass while it compensates (claims 3, 4; normalised gradient, two runs)",
        f"|W3@{LEARNED} - 1|", AT_MOST, CONVERGED, WEIGHT, {}, "a twentieth off is converged",
    ),
    mean_claim(
        "W1 is air resistance", "W1 converges to the air resistance C (least squares)", f"|W1@{SQUARES}, 3 - 1|", AT_MOST,
        CONVERGED, "relative error of W1",
        {
            "that of C with A and B put into it": f"|W1@{SQUARES}, 3 / 'equivalent W1' - 1|",
            "with five weights": f"|W1@{SQUARES}, 5 - 1|",
            "W3 with five weights": f"|W3@{SQUARES}, 5 - 1|",
        },
        "a twentieth off is converged",
    ),
    mean_claim(
        "excitation detected", f"no weight of five is called learned that is wrong by {100 * FALSE_BY:.0f} %",
        "falsely learned@5", AT_MOST, 0.05, "weights falsely called learned per run",
        {
            "weights called learned per run": "learned@5", "of three falsely": "falsely learned@3",
            "of three called learned": "learned@3",
        },
        "one in twenty runs", "",
    ),
    mean_claim(
        "5: learn, then use", "the switch comes to use what was learnt, for most of the run", "use share", AT_LEAST, 0.5,
        "share of the run in which it is used",
        {"changes of the switch": "use changes", "speed error in use in m per s": "use speed error"}, "most is half",
    ),
    mean_claim(
        "5 as printed holds the speed", "the feedforward alone, as printed, keeps the speed to 1 m/s while it is used",
        "use as printed speed error", AT_MOST, DRIFT, "largest error of speed in use [m/s]",
        {"share of runs beyond 1 m/s": f"'use as printed speed error' > {DRIFT:g} if 'use as printed speed error' >= 0"},
        "beyond it nothing holds the speed", "",
    ),
    mean_claim(
        "mass after boarding", "the mass after boarding is learnt on the first departure (least squares, five weights)",
        "|mass@five weights|", AT_MOST, LARGEST_DEVIATION, "relative error of the mass",
        {"before learning": "|mass@not learned|", **{f"with {k}": f"|mass@{k}|" for k in THREE}},
        "the error up to which a weight is called learned", "",
    ),
    mean_claim(
        "load compensation, dry rail",
        "the learnt mass as load signal of (6') gives the planned acceleration where load sensors are wrong by 30 %",
        f"{_dry('mass learned')} / {_dry('sensors wrong')}", AT_MOST, 0.5,
        "error of acceleration, over that with wrong sensors",
        {"error with wrong sensors": _dry("sensors wrong"), "error with the learnt mass": _dry("mass learned")},
        "half of the error is gone", "",
    ),
    mean_claim(
        "load compensation, slippery rail",
        "on a slippery rail the learnt mass, spread evenly, gives at least the acceleration of wrong sensors",
        _slippery("mass learned"), AT_LEAST, 1.0, "acceleration, over that with wrong sensors",
        {
            "sensors scaled to the learnt mass": _slippery(SCALED),
            "slip time with wrong sensors in s": "slip_time@slippery@sensors wrong",
            "slip time with the learnt mass in s": "slip_time@slippery@mass learned",
            "slip time with sensors scaled in s": f"slip_time@slippery@{SCALED}",
        },
        "what is learnt does no harm", "",
    ),
)  # fmt: skip
"""What is claimed, one family."""


def resistance_statements(table: pd.DataFrame) -> list[Statement]:
    """All statements on a table with one row per event."""
    return family((table, CLAIMS))


def cells(seed: int, k: int) -> list[Task]:
    """Event `k`: random runs of the speed control, and a random boarding."""
    return [Task(f"{seed}/{k}", event_row, (seed, k), (("seed", seed),))]


RESISTANCE = Study(
    name="resistance",
    question="compensation and learning of running resistance by line position (JP H07-322414)",
    default_events=12,
    cells=EachEvent(cells),
    judge=resistance_statements,
    claims=CLAIMS,
    whole=True,
)
