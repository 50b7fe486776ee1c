"""Torque factor over the deviation of acceleration: readhesion paper Fig. 5."""

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from alloc.onboard.controllers.torque_table import torque_factor
from paper_figs.readhesion_cases import CASES, COLOURS
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure


def figure(source: Source) -> Figure:
    """The figure; it needs no data from `source`."""
    return draw()


def draw() -> Figure:
    """The table of both cases, with margin and width of case B marked."""
    drawn = new_figure(4.6, 2.9)
    deviation = np.linspace(-0.3, 1.6, 400)
    with mpl.rc_context(fname=STYLE_FILE):
        axes = drawn.subplots()
        for (name, case), dashes in zip(CASES.items(), ("-", "--"), strict=True):
            factor = [torque_factor(value, case.margin, case.width) for value in deviation]
            axes.plot(
                deviation, factor, dashes, color=COLOURS[name],
                label=f"case {name}: $a_0$ = {case.margin:g}, $a_w$ = {case.width:g} km/h/s",
            )  # fmt: skip
        case = CASES["B"]
        for begin, end, height, text in (
            (0.0, case.margin, -0.10, "$a_0$"),
            (case.margin, case.margin + case.width, -0.10, "$a_w$"),
        ):
            axes.annotate(
                "", (begin, height), (end, height), annotation_clip=False,
                arrowprops={"arrowstyle": "<->", "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0},
            )  # fmt: skip
            axes.text(0.5 * (begin + end), height + 0.02, text, ha="center", va="bottom")
        axes.set(
            xlim=(deviation[0], deviation[-1]), ylim=(-0.2, 1.1),
            xlabel="wheel acceleration less the commanded one [km/h/s]",
            ylabel="torque factor [–]",
        )  # fmt: skip
        axes.legend(loc="upper right")
    return drawn
