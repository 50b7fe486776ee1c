"""Running test with only the locomotive braked: RTRI report, Fig. 4."""

from matplotlib.figure import Figure

from paper_figs.brake_panels import draw_test
from paper_figs.source import Source
from studies.brake_force.running_tests import TestResult, run_test

DAY = 0


def figure(source: Source) -> Figure:
    """The figure, from one test (it takes a second)."""
    return draw(run_test("locomotive", DAY))


def draw(result: TestResult) -> Figure:
    """Speed, accelerations, coupler force and brake forces over time."""
    return draw_test(result)
