"""What lost telegrams and noisy speeds cost: the same starts under every loss and every noise, each rule and controller.

All meet the same drawn starts with headroom (`studies.patent.headroom_study`), so differences are paired. Loss and noise go
far beyond what a train has, to show where each rule and controller gives way.
"""

from collections.abc import Sequence
from itertools import product

import pandas as pd

from studies.core.claims import AT_LEAST, Claim, family
from studies.core.drawn_events import complete, paired, with_parts
from studies.core.job import Job, check_controller
from studies.core.statement import INTERVALS_OF_MEANS, POINTS, Statement
from studies.core.study import EachEvent, Study
from studies.files.units import stated
from studies.patent import headroom_study
from studies.scenario.scenario import Scenario

LOSSES = (0.0, 0.1, 0.3, 0.6)
"""Share of telegrams that is lost; other studies draw 0.1 at most."""
NOISES = (0.0, 0.02, 0.1, 0.2)
"""Standard deviation of measured axle speeds [km/h]; other studies draw 0.1 at most."""
BASE, SHARING = "alone", "cooperative"
RULES = (BASE, SHARING)
CONTROLLERS = ("cut-and-ramp", "perturb-observe", "mpc")
NUMBERS = ("bound_use", "slip_time", "damage")
LOST = 0.01
"""Share of the bound that the loss of telegrams may cost and still counts as little."""
METHOD = f"paired by start; {INTERVALS_OF_MEANS}; after Holm over all claims"


def column(metric: str, controller: str, rule: str, loss: float, noise: float) -> str:
    """Column of a metric of a rule under a controller, at a loss and a noise [km/h]."""
    return f"{metric}@{controller}/{rule}/{loss:g}/{noise:g}"


def more(
    controller: str, loss: float, noise: float, metric: str = NUMBERS[0], base: float | None = None
) -> str:
    """A metric of sharing less that of alone; where a loss is given as `base`, less that of sharing at that loss."""
    rule, lost = (BASE, loss) if base is None else (SHARING, base)
    own = column(metric, controller, SHARING, loss, noise)
    return f"{own} - {column(metric, controller, rule, lost, noise)}"


def claims_of(controllers: Sequence[str] = CONTROLLERS) -> list[Claim]:
    """Under each controller: sharing gains at the worst loss and noise, and the worst loss alone costs it little."""
    return [claim for one in controllers for claim in (_gains(one), _keeps(one))]


def _gains(controller: str) -> Claim:
    return Claim(
        f"{controller}: gain",
        f"{SHARING} uses more of the bound than {BASE} at the worst loss and noise under {controller}",
        more(controller, LOSSES[-1], NOISES[-1]), AT_LEAST, show=POINTS, method=METHOD,
        reason="a rule that telegrams and sensors spoil is worth less than none",
        numbers={
            f"{metric}, gain at a loss of {loss:g} and {noise:g} km/h": more(controller, loss, noise, metric)
            for metric in NUMBERS for loss in LOSSES for noise in NOISES
        },
    )  # fmt: skip


def _keeps(controller: str) -> Claim:
    worst, usual = LOSSES[-1], NOISES[1]
    return Claim(
        f"{controller}: loss", f"the worst loss costs {SHARING} less than a point of the bound under {controller}",
        more(controller, worst, usual, base=0.0), AT_LEAST, -LOST, show=POINTS, method=METHOD,
        reason="a hundredth is what the choice of a rule is about",
        numbers={
            f"{metric}, loss of {loss:g} less none": more(controller, loss, usual, metric, 0.0)
            for metric in NUMBERS for loss in LOSSES[1:]
        },
    )  # fmt: skip


def pairs_of(table: pd.DataFrame) -> pd.DataFrame:
    """One row per start that succeeded throughout; numbers as ``number@controller/rule/loss/noise``."""
    rows = complete(table.assign(scenario=table["event"]))
    words = [rows[name].map("{:g}".format) for name in ("loss", "noise")]
    arm = rows["controller"] + "/" + rows["rule"] + "/" + words[0] + "/" + words[1]
    return paired(rows.assign(arm=arm), "arm", NUMBERS, ())


def scenario(seed: int, k: int, loss: float, noise: float, duration: float) -> Scenario:
    """Start `k` with this loss and noise."""
    event = headroom_study.scenario(seed, k, duration)
    onboard = event.onboard.model_dump(exclude_unset=True)
    onboard["telegrams"] = onboard.get("telegrams", {}) | {"loss": loss}
    speeds = {"speed_noise_kmh": stated("_kmh", noise)}
    onboard["sensors"] = onboard.get("sensors", {}) | speeds
    return event.changed(name=event.name + _part(loss, noise), onboard=onboard)


def _part(loss: float, noise: float) -> str:
    return f"-{loss:g}-{noise:g}"


def cells(
    seed: int,
    k: int,
    duration: float = headroom_study.DURATION,
    controllers: Sequence[str] = CONTROLLERS,
) -> list[Job]:
    """Start `k` at every loss and noise under every controller and rule."""
    for controller in controllers:
        check_controller(controller)
    return [
        Job(one, rule, controller, k)
        for one in (scenario(seed, k, *place, duration) for place in product(LOSSES, NOISES))
        for controller in controllers
        for rule in RULES
    ]


def meant(table: pd.DataFrame, seed: int, events: int) -> pd.DataFrame:
    """The rows with "event", "loss" and "noise" [km/h]."""
    places = {_part(*place): place for place in product(LOSSES, NOISES)}
    return with_parts(table, places, "loss", "noise")


def statements(table: pd.DataFrame) -> list[Statement]:
    """What loss and noise cost under each controller of the table."""
    return family((pairs_of(table), claims_of(list(dict.fromkeys(table["controller"])))))


ROBUSTNESS = Study(
    name="robustness",
    question="what lost telegrams and noisy speeds cost, and whether sharing still gains",
    default_events=12,
    cells=EachEvent(cells),
    finish=meant,
    judge=statements,
    claims=claims_of,
)
