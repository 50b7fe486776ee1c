"""Random runs of the speed control and random boardings: what is drawn, and the row that an event yields."""

from typing import Any

import numpy as np

from alloc.estimation.running_resistance import LARGEST_DEVIATION, LEARNED
from alloc.onboard.line_memory import WEIGHTS, PositionDetector
from studies.resistance import driven_cases as cases
from studies.resistance.driven_cases import (
    LEARNER_NAMES,
    boarding,
    learn_passes,
    learners,
    load_compensation,
    random_loads,
)
from studies.resistance.routes import ROUTES, Route, route

CRUISE = {"commuter": (16.0, 20.0), "high-speed": (64.0, 72.0)}
"""Cruising speed [m/s], uniform."""
STEEPEST = {"commuter": 0.025, "high-speed": 0.012}
"""Gradients are uniform from a quarter of it to all of it."""
TUNNEL_FACTOR = (1.3, 2.5)
WRONG_BY = 0.3
"""Wrong coefficients are too great or too small by this share, each by the toss of a coin."""
LEVEL = (0.10, 0.14)
"""Adhesion coefficient of the slip event after boarding, uniform."""
FALSE_BY = 3.0 * LARGEST_DEVIATION
"""Relative error of a weight that must not be called learned."""
ONE_CAR = {cases.FEEDBACK: "one car, feedback only", cases.RIGHT: "one car, compensation"}
"""Labels of the cases that are also driven with a single car."""
QUANTITIES = ("speed_peak", "acceleration_peak", "acceleration_rms", "jerk_peak")


def column(quantity: str, kind: str, case: str) -> str:
    """Column of a disturbance."""
    return f"{quantity}@{kind}@{case}"


def draw(seed: int, event: int) -> dict[str, Any]:
    """What is drawn for an event; it follows from its number alone."""
    generator = np.random.default_rng([seed, event])
    name = ROUTES[int(generator.integers(2))]
    return {
        "event": event,
        "route": name,
        "control": cases.CONTROLS[int(generator.integers(2))],
        "load_share": float(generator.uniform(0.0, 1.0)),
        "tunnel_factor": float(generator.uniform(*TUNNEL_FACTOR)),
        "gradient": float(STEEPEST[name] * generator.uniform(0.25, 1.0)),
        "cruise": float(generator.uniform(*CRUISE[name])),
        "wrong": tuple(float(1.0 + WRONG_BY * s) for s in generator.choice([-1.0, 1.0], 3)),
        "loads": random_loads(generator),
        "level": float(generator.uniform(*LEVEL)),
    }


def drawn_route(drawn: dict[str, Any]) -> Route:
    """The route of an event."""
    return route(
        drawn["route"], drawn["tunnel_factor"], drawn["load_share"], drawn["gradient"], drawn["cruise"]
    )  # fmt: skip


def event_row(seed: int, event: int) -> dict[str, Any]:
    """Everything about one event in one row."""
    drawn = draw(seed, event)
    of = drawn_route(drawn)
    noise_seed = 1000 * seed + 10 * event
    row = {name: value for name, value in drawn.items() if name not in ("wrong", "loads")}
    row |= {f"wrong_{name}": x for name, x in zip(WEIGHTS, drawn["wrong"], strict=True)}

    def driven(case: str, open_loop: bool = False, on: Route = of) -> cases.CaseRun:
        return cases.drive_case(
            on, case, drawn["control"], detector=PositionDetector(speed_noise=cases.SPEED_NOISE, seed=noise_seed),
            open_loop=open_loop, wrong=drawn["wrong"],
        )  # fmt: skip

    done = {case: driven(case) for case in cases.ALL_CASES}
    for case, one in done.items():
        row |= felt(of, one, case)
        force = one.log["feedback_current"].values / cases.CURRENT_PER_FORCE
        row[f"feedback_share@{case}"] = _rms(force) / _rms(one.log["force"].values)
    single = of.one_car()
    for case, label in ONE_CAR.items():
        row |= felt(single, driven(case, on=single), label)
    true = of.true_weights()
    learned = done[cases.LEARNED].control.weights / true
    row |= {f"{name}@{cases.LEARNED}": float(x) for name, x in zip(WEIGHTS, learned, strict=True)}
    row |= _alone(of, done[cases.FEEDBACK], noise_seed)
    row |= _switched(done[cases.USED], driven(cases.USED, True))
    return row | _boarded(drawn, noise_seed)


def felt(of: Route, done: cases.CaseRun, label: str, lead: float = 0.0) -> dict[str, float]:
    """Disturbances of a run, means over like points; `lead` as in `disturbances`."""
    means = cases.disturbances(of, done, lead).groupby("kind")[list(QUANTITIES)].mean()
    found = means.stack()
    return {column(q, kind, label): float(found[kind, q]) for kind, q in found.index}


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


def _alone(of: Route, done: cases.CaseRun, seed: int) -> dict[str, float]:
    """The stand-alone learners on the run of the feedback alone; `equivalent`: W1 that stands for A, B and C in cruise."""
    row = {}
    for weights in (3, 5):
        true = of.true_weights(weights)
        for name, learner in learners(of, weights).items():
            if weights == 5 and name != LEARNER_NAMES[-1]:
                continue
            _, found = learn_passes(of, done.run, learner, seed=seed)
            label = f"{name}, {weights}"
            for place, weight in enumerate(WEIGHTS):
                row[f"{weight}@{label}"] = float(found.weights[-1, place] / true[place])
        statuses = [one for one in found.excitation.weights if one.status == LEARNED]
        row[f"learned@{weights}"] = float(len(statuses))
        values = dict(zip(("W1", "W2", "W3", "A", "B"), true, strict=False))
        row[f"falsely learned@{weights}"] = float(
            sum(abs(one.value / values[one.name] - 1.0) > FALSE_BY for one in statuses)
        )
    a, b, c = of.train.resistance
    v = of.command.speeds[0]
    row["equivalent W1"] = 1.0 + b / (c * v) + a / (c * v * v)
    return row


def _switched(closed: cases.CaseRun, open_loop: cases.CaseRun) -> dict[str, float]:
    """Claim 5: share of the time in which what was learnt is used, and the speed's error then."""
    row = {}
    for name, one in (("use", closed), ("use as printed", open_loop)):
        using = one.log["switch"].values == 2.0
        error = np.abs(one.log["commanded_speed"].values - one.run["speed"].values)
        row[f"{name} share"] = float(using.mean())
        row[f"{name} changes"] = float(np.count_nonzero(np.diff(using)))
        row[f"{name} speed error"] = float(error[using].max()) if using.any() else np.nan
    return row


def _boarded(drawn: dict[str, Any], seed: int) -> dict[str, float]:
    """Mass learnt on the first departure, and what it does for the load compensation on a dry and a slippery rail."""
    loads = drawn["loads"]
    found = boarding(loads, seed)
    row = {"mass@not learned": found.empty_mass / found.mass - 1.0}
    row |= {f"mass@{name}": mass / found.mass - 1.0 for name, mass in found.learned.items()}
    for rail, level in (("dry", 0.3), ("slippery", drawn["level"])):
        for one in load_compensation(loads, found.learned["five weights"], level).itertuples():
            row[f"acceleration@{rail}@{one.belief}"] = float(one.acceleration)  # type: ignore[arg-type]
            row[f"slip_time@{rail}@{one.belief}"] = float(one.slip_time)  # type: ignore[arg-type]
    return row
