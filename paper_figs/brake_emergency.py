"""Emergency brake of 18 cars, estimate against theory: RTRI report, Fig. 7; beside it the remedies that the report names."""

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from paper_figs.brake_panels import BEFORE, OWN, THEORY, WAGONS
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.brake_force.running_tests import BRAKED_AT, TestResult, estimate, run_test, smooth

DAY = 0
SMOOTHED = "#cc79a7"


def figure(source: Source) -> Figure:
    """The figure, from one test (it takes some seconds)."""
    return draw(run_test("emergency", DAY))


def draw(result: TestResult) -> Figure:
    """Left, sum of the wagons and first wagon against theory; right, the same with own accelerations, smoothed."""
    m, found, smoothed = result.measured, estimate(result), smooth(result)
    time, wagons = m.time - BRAKED_AT, result.test.wagons
    total, deviation = (values / 1e3 for values in smoothed.total(slice(1, None)))
    one, one_deviation = smoothed.force[:, 1] / 1e3, smoothed.deviation[:, 1] / 1e3
    drawn = new_figure(7.1, 4.6)
    with mpl.rc_context(fname=STYLE_FILE):
        axes = drawn.subplots(2, 2, sharex=True, sharey="row")
        sums, single = axes[0, 0], axes[1, 0]
        sums.plot(
            time, found.wagons / 1e3, color=WAGONS, linewidth=0.7, label="wagon 1's acceleration"
        )
        single.plot(time, found.wagon / 1e3, color=WAGONS, linewidth=0.7)
        for row, values, band, raw in (
            (0, total, deviation, found.wagons_own / 1e3),
            (1, one, one_deviation, found.wagon / 1e3),
        ):
            right: Axes = axes[row, 1]
            right.plot(time, raw, color=OWN, linewidth=0.5, alpha=0.6, label="own accelerations")
            right.fill_between(
                time, values - 1.96 * band, values + 1.96 * band, color=SMOOTHED, alpha=0.4,
                linewidth=0.0,
            )  # fmt: skip
            right.plot(time, values, color=SMOOTHED, linewidth=1.1, label="smoothed, 95 %")
        for axis, scale in zip(axes.flat, (wagons, wagons, 1, 1), strict=True):
            axis.plot(
                time, scale * found.theory / 1e3, "--", color=THEORY, linewidth=0.9, label="theory"
            )
        for axis, title in zip(
            axes.flat,
            (f"(a) {wagons} wagons", "remedies", "(b) wagon 1", "remedies"),
            strict=True,
        ):
            axis.set_title(title)
        top = 1.02 * float(found.wagons[result.window].max() / 1e3)
        axes[0, 0].set_ylim(min(0.0, 1.05 * float(found.wagons.min() / 1e3)), top)
        for axis in axes[:, 0]:
            axis.set_ylabel("brake force [kN]")
        for axis in axes[1]:
            axis.set_xlabel("time [s]")
            axis.set_xlim(-BEFORE, float(time[result.window.stop]))
        for axis in axes[0]:
            axis.legend(loc="lower right")
        drawn.align_ylabels(axes[:, 0].tolist())
    return drawn
