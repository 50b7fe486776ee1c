"""Whether the stated uncertainty is right, and whether a car is accused because its wheels slide."""

from collections.abc import Mapping

import pandas as pd

from studies.core.statement import Statement
from studies.core.verdict import Bound, decided, judged

COVERAGE = (0.93, 0.97)
"""Bounds of the share of 95 % intervals that contain the truth."""
RARE = 0.05
"""Share of stops in which a sliding trailer may be accused."""
SURE = 0.95


def stated_uncertainty(tests: Mapping[str, pd.DataFrame]) -> Statement:
    """Over days, whose tests have wagons and errors of sensors in common: a day counts once, with the share of its tests."""
    rows = pd.concat(tests.values()).groupby(level=0)
    shares = {
        "intervals of the mean by the report's rule that hold it": rows["covered"],
        "intervals of the mean by own accelerations that hold it": rows["covered_own"],
        "instants and cars at which the smoother's hold the force": rows["covered_smooth"],
    }
    means = {
        words: one.apply(lambda day: day.astype(float).mean()) for words, one in shares.items()
    }
    return decided(
        "stated uncertainty",
        "intervals of 95 %, of averaged and of smoothed forces, hold the truth in 93 to 97 %",
        {
            f"within bounds: {words}": Bound("", values, *COVERAGE)
            for words, values in means.items()
        },
        means
        | {
            "deviation of the smoother's changing errors over the stated one": rows[
                "smooth_ratio"
            ].mean()
        },
        "share of each day's tests, mean over days with its 95 % interval, which must lie within 0.93 and 0.97",
    )


def sliding_trailer(rows: pd.DataFrame) -> Statement:
    """A trailer that slides: it is not accused, while another one whose brake is cut out still is."""
    sound, faulty = (rows[rows["kind"] == kind] for kind in ("sound", "another's brake cut out"))
    return judged(
        "sliding trailer not accused",
        "a trailer whose wheels slide under slide protection is not accused of a weak brake, and another that has one is",
        [
            Bound("sliding trailer accused", rows["sliding_accused"].astype(float), most=RARE),
            Bound("share of stops in which a sound car is accused", sound["wrong"], most=RARE),
            Bound("other trailer, brake cut out, named first", faulty["first"].astype(float), least=SURE),
            Bound("sliding trailer accused where slides are not looked for", rows["accused_blindly"]),
            Bound("its wheels slide", rows["slides"], least=SURE),
            Bound("share of cars not judged", rows["not_judged"]),
        ],
        "adhesion coefficient 0.04 under one trailer, 0.2 under the others",
    )  # fmt: skip
