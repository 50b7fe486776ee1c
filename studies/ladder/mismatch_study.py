"""The MPC where curve, noise and computing time are others than it was built on, beside two controllers without a model."""

from collections.abc import Mapping

import pandas as pd

from studies.core.claims import Claim, conjunction, quantity
from studies.core.drawn_events import paired
from studies.core.job import Job
from studies.core.statement import CONFIDENCE, INTERVALS_OF_MEANS, Statement
from studies.core.study import EachEvent, Study
from studies.ladder.ladder_study import RULE
from studies.ladder.mismatch_events import (
    DELAYED,
    DURATION,
    GIVEN,
    MIDDLE,
    NOISES,
    OWN,
    RAILS,
    REFERENCE,
    RIGHT,
    SAME_BELIEF,
    SEARCHER,
    SOUGHT,
    Place,
    scenario,
    settings_at,
)

LOSS = 0.01
"""Share of the adhesion that may be lost to another controller and still counts as none."""
METRICS = {
    "utilisation_short": "adhesion used where short",
    "damage": "wheel damage [kJ]",
    "slip_time": "slip [axle s]",
    "torque_fluctuation": "torque fluctuation over plan",
}
"""Metric -> what a statement calls it."""
METHOD = (
    f"means of paired differences of the adhesion used where short above -{LOSS:g} in every cell; "
    f"{INTERVALS_OF_MEANS}, {CONFIDENCE:.0%} each"
)


def _loses(name: str, claim: str, cells: Mapping[str, tuple[str, float, str, str]]) -> Claim:
    """That no cell loses; `cells`: words of each -> curve, noise and the two settings."""
    return Claim(
        name, claim, method=METHOD,
        cases=tuple(
            Claim(f"with {words}", mean=less(*cell, "utilisation_short"), value=-LOSS,
                  reason="a hundredth is what the choice of a controller is about")
            for words, cell in cells.items()
        ),
        numbers={
            f"{text}, {words}": less(*cell, metric)
            for metric, text in METRICS.items() for words, cell in cells.items()
        },
    )  # fmt: skip


def less(curve: str, noise: float, one: str, other: str, metric: str) -> str:
    """A metric under setting `one` less that under `other`, at one curve and noise [km/h]."""
    return f"'{metric}@{curve}/{noise:g}/{one}' - '{metric}@{curve}/{noise:g}/{other}'"


BASE = next(iter(RAILS))
CLAIMS = (
    *(
        _loses(
            f"{curve}: mpc, {other.name}",
            f"on {curve} rail the MPC loses less than a point of adhesion to {other.name}, whatever noise and computing "
            "time",
            {
                f"{setting.name}, {noise:g} km/h of noise": (curve, noise, setting.name, other.name)
                for setting in (SOUGHT, DELAYED) for noise in NOISES
            },
        )
        for other in (REFERENCE, SEARCHER) for curve in RAILS
    ),
    *(
        _loses(
            f"given slip: {one.name}",
            f"an MPC that holds the slip at {one.name} loses less than a point of adhesion to {REFERENCE.name} on every "
            "rail",
            {f"{curve} rail": (curve, MIDDLE, one.name, REFERENCE.name) for curve in RAILS},
        )
        for one in GIVEN
    ),
)  # fmt: skip
"""What is claimed of adhesion; that belief makes no difference has no threshold."""


def mismatch_statements(table: pd.DataFrame) -> list[Statement]:
    """Statements on the rows of a table of `studies.ladder.mismatch_study` that are ok."""
    arm = table["curve"] + "/" + table["noise"].map("{:g}".format) + "/" + table["setting"]
    events = paired(table.assign(scenario=table["event"], arm=arm), "arm", METRICS, [])
    return [*(conjunction(events, claim) for claim in CLAIMS), _believed(events)]


def difference(
    table: pd.DataFrame, curve: str, noise: float, one: str, other: str, metric: str
) -> "pd.Series[float]":
    """A metric under setting `one` less that under `other`, by event, at one curve and noise [km/h]."""
    rows = table[(table["curve"] == curve) & (table["noise"] == noise)]
    values = [rows[rows["setting"] == name].set_index("event")[metric] for name in (one, other)]
    return (values[0] - values[1]).astype(float)


def _believed(events: pd.DataFrame) -> Statement:
    numbers = {
        f"{text}, {other.name} less {SOUGHT.name}": quantity(
            events, less(BASE, MIDDLE, other.name, SOUGHT.name, metric)
        ).astype(float)
        for metric, text in METRICS.items()
        for other in SAME_BELIEF
    }
    claim = Claim(
        "belief", "an MPC that seeks its slip does the same whatever curve it believes in",
        method="holds if no number of any event differs",
    )  # fmt: skip
    same = all(bool((values == 0.0).all()) for values in numbers.values())
    enough = all(values.notna().any() for values in numbers.values())
    return conjunction(events, claim, {"to the last digit": same}, numbers=numbers, enough=enough)


def places(seed: int, k: int) -> list[Place]:
    """Every rail and noise that event `k` has."""
    return [Place(seed, k, curve, noise) for curve in RAILS for noise in NOISES]


def cells(seed: int, k: int, duration: float = DURATION) -> list[Job]:
    """Event `k` at every place under every setting that meets it."""
    return [
        Job(scenario(place, setting, duration), RULE, setting.controller, place.number)
        for place in places(seed, k)
        for setting in settings_at(place.curve, place.noise)
    ]


def meant(table: pd.DataFrame, seed: int, events: int) -> pd.DataFrame:
    """The rows with "event", "curve", "noise" [km/h] and "setting"."""
    names = {
        place.name(setting): (k, place.curve, place.noise, setting.name)
        for k in range(events)
        for place in places(seed, k)
        for setting in settings_at(place.curve, place.noise)
    }
    meaning = pd.DataFrame(
        table["scenario"].map(names).tolist(),
        columns=["event", "curve", "noise", "setting"],
        index=table.index,
    )
    table = pd.concat([table, meaning], axis=1)
    # who believes in the rail's curve by its name believes in the rail's own
    same = [
        table[(table["curve"] == one.believed) & (table["setting"] == RIGHT)].assign(
            setting=one.name
        )
        for one in GIVEN
        if one.believed != OWN
    ]
    return pd.concat([table, *same], ignore_index=True)


MISMATCH = Study(
    name="mismatch",
    question=f"the MPC on rails of {len(RAILS)} curves, with noise, with computing time, and with a given slip "
    f"(at {MIDDLE:g} km/h of noise)",
    default_events=12,
    cells=EachEvent(cells),
    finish=meant,
    judge=lambda table: mismatch_statements(table[table["status"] == "ok"]),
    claims=CLAIMS,
)
