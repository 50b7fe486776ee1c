"""Panels of a running test: speed, accelerations, coupler force, estimated brake forces (RTRI report, Figs. 4 and 5)."""

import matplotlib as mpl
from matplotlib.figure import Figure

from paper_figs.style import STYLE_FILE, new_figure
from studies.brake_force.running_tests import BRAKED_AT, TestResult, estimate

LOCOMOTIVE, WAGONS, THEORY, OWN = "#d55e00", "#0072b2", "#000000", "#009e73"
"""Colours of locomotive, wagons, theory or truth, and wagons with their own accelerations."""
BEFORE = 1.0
"""Time shown before the driver's command [s]."""


def draw_test(result: TestResult) -> Figure:
    """Rows: speed, accelerations of locomotive and first wagon, force of the coupler between them, brake forces."""
    m, found = result.measured, estimate(result)
    time = m.time - BRAKED_AT
    drawn = new_figure(5.6, 6.6)
    with mpl.rc_context(fname=STYLE_FILE):
        axes = drawn.subplots(4, 1, sharex=True, height_ratios=(0.8, 1.0, 1.0, 1.3))
        speed, acceleration, coupler, force = axes
        speed.plot(time, 3.6 * m.speed, color="black")
        speed.set_ylabel("speed [km/h]")
        speed.set_ylim(bottom=0.0)
        # beneath: the wagon's, whose noise and swings are the larger
        acceleration.plot(time, m.acceleration[:, 1], color=WAGONS, linewidth=0.8, label="wagon 1")
        acceleration.plot(
            time, m.acceleration[:, 0], color=LOCOMOTIVE, linewidth=0.8, label="locomotive"
        )
        acceleration.set_ylabel("acceleration [m/s²]")
        coupler.plot(time, m.coupler_force[:, 0] / 1e3, color="black", linewidth=0.9)
        coupler.set_ylabel("coupler force [kN]")
        coupler.set_title("between locomotive and wagon 1, tension positive", fontsize=7.5)
        true = result.true_force / 1e3
        force.plot(time, found.wagons / 1e3, color=WAGONS, linewidth=0.8, label="all wagons")
        force.plot(
            time, found.locomotive / 1e3, color=LOCOMOTIVE, linewidth=0.8, label="locomotive"
        )
        force.plot(time, true[:, 1:].sum(axis=1), "--", color=THEORY, linewidth=0.8, label="truth")
        force.plot(time, true[:, 0], "--", color=THEORY, linewidth=0.8)
        force.set_ylabel("brake force [kN]")
        force.set_xlabel("time [s]")
        force.set_xlim(-BEFORE, float(time[result.window.stop]))
        acceleration.legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.1
        )
        force.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.1)
        drawn.align_ylabels(axes.tolist())
    return drawn


__all__ = ["BEFORE", "LOCOMOTIVE", "OWN", "THEORY", "WAGONS", "draw_test"]
