"""Convergence of the weights of running resistance by learner, on a recorded run that is repeated (JP H07-322414 (5))."""

import matplotlib as mpl
import pandas as pd
from matplotlib.figure import Figure

from alloc.onboard.speed_control import WEIGHTS
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.resistance.learners import (
    GRADIENT,
    NORMALISED,
    PRINTED,
    SQUARES,
    convergence,
)
from studies.resistance.routes import route

LOOKS = {
    GRADIENT: ("#e69f00", "-"),
    PRINTED: ("#7f7f7f", "--"),
    NORMALISED: ("#d55e00", "-"),
    SQUARES: ("#0072b2", "-"),
}
"""Colour and dashes of each learner."""
MEANING = {"W1": "air, open", "W2": "air, tunnel", "W3": "mass"}
PASSES = 4
LEAST = 0.02
"""Least error shown [%]."""


def figure(source: Source) -> Figure:
    """The figure, of the commuter train whose resistance is CV² alone; some seconds."""
    return draw(convergence(route("commuter", load_share=0.5).square_only(), PASSES))


def draw(errors: pd.DataFrame) -> Figure:
    """A panel per weight: size of its error relative to the plant's, over time."""
    drawn = new_figure(7.1, 3.0)
    with mpl.rc_context(fname=STYLE_FILE):
        panels = drawn.subplots(1, len(WEIGHTS), sharex=True, sharey=True)
        for axes, weight in zip(panels, WEIGHTS, strict=True):
            for learner, (colour, dashes) in LOOKS.items():
                own = errors[errors["learner"] == learner]
                axes.plot(
                    own["time"],
                    100.0 * own[weight].abs(),
                    color=colour,
                    linestyle=dashes,
                    label=learner,
                )
            axes.set_yscale("log")
            axes.set_ylim(LEAST, None)
            axes.set_title(f"{weight} ({MEANING[weight]})")
            axes.set_xlabel("time of running [s]")
        panels[0].set_ylabel("error of the weight [%]")
        handles, labels = panels[0].get_legend_handles_labels()
        drawn.legend(handles, labels, loc="outside lower center", ncols=len(LOOKS))
    return drawn
