"""Compiled fuzzy inference against a library's Takagi-Sugeno engine."""

import numpy as np
import pytest

from alloc.onboard.controllers.search import RULES as STEPS
from alloc.onboard.laws import RULES as VALVES
from alloc.onboard.laws import weighted_action

simpful = pytest.importorskip("simpful")

SETS = ("low", "middle", "high")
FAR = 1e3
"""Where the outer sets end, beyond all inputs."""


def variable(knots):
    """Sets that peak at three knots; the outer ones stay full beyond them."""
    low, middle, high = knots
    sets = [
        simpful.TrapezoidFuzzySet(low - FAR, low - FAR, low, middle, "low"),
        simpful.TriangleFuzzySet(low, middle, high, "middle"),
        simpful.TrapezoidFuzzySet(middle, high, high + FAR, high + FAR, "high"),
    ]
    return simpful.LinguisticVariable(sets, universe_of_discourse=[low - FAR, high + FAR])


def engine(rules, x_knots, y_knots):
    """Nine rules whose degree is the product of their sets', zero-order Sugeno."""
    made = simpful.FuzzySystem(operators=["AND_PRODUCT"], show_banner=False, verbose=False)
    made.add_linguistic_variable("x", variable(x_knots))
    made.add_linguistic_variable("y", variable(y_knots))
    for i, row in enumerate(rules):
        for j, action in enumerate(row):
            made.set_crisp_output_value(f"action{i}{j}", action)
            condition = f"(x IS {SETS[i]}) AND (y IS {SETS[j]})"
            made.add_rules([f"IF {condition} THEN (action IS action{i}{j})"])
    return made


@pytest.mark.parametrize(
    ("rules", "x_knots", "y_knots"),
    [
        (VALVES, (0.0, 0.05, 0.15), (-1.0, 0.0, 1.0)),  # uneven sets
        (STEPS, (-0.002, 0.0, 0.002), (-0.01, 0.0, 0.01)),
        (np.random.default_rng(1).normal(size=(3, 3)), (-3.0, 0.5, 0.7), (0.0, 2.0, 9.0)),
    ],
    ids=["valves", "steps", "any rules"],
)
def test_the_action_is_that_of_a_library(rules, x_knots, y_knots):
    made = engine(rules, x_knots, y_knots)
    points = [np.linspace(2.0 * k[0] - k[1], 2.0 * k[2] - k[1], 12) for k in (x_knots, y_knots)]
    for x in points[0]:
        for y in points[1]:
            made.set_variable("x", x)
            made.set_variable("y", y)
            found = made.Sugeno_inference(["action"])["action"]
            own = weighted_action(rules, x, y, x_knots, y_knots)
            assert own == pytest.approx(found, abs=1e-9)
