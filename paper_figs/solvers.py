"""What QP solvers answer to the allocation problem: how near, how fast, and whether they say so rightly."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from paper_figs.style import NARROW, Drawing
from studies.solvers import table

COLOURS = {"casadi": "#d55e00", "qpsolvers": "#0072b2", "cvxpy": "#009e73"}


def draw_solvers(rows: pd.DataFrame) -> Figure:
    """Worst distance of each solver, from default to tight tolerances, and time; hollow where it was wrong."""
    lines = table(rows).astype({"distance": float, "time": float})
    groups = [part for _, part in lines.groupby(["by", "solver"])]
    groups.sort(key=lambda part: tuple(-part["distance"].iloc[[-1, 0]]))
    drawn = Figure(figsize=(NARROW, 5.2), layout="constrained")
    left, right = drawn.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    for y, part in enumerate(groups):
        library, solver = (part[name].iloc[0].split()[0] for name in ("by", "solver"))
        look, colour = {"arrowstyle": "->", "shrinkA": 0.0, "shrinkB": 0.0}, COLOURS[library]
        start, end = part["distance"].iloc[[0, -1]]
        left.annotate("", (end, y), (start, y), arrowprops=look | {"color": colour})
        place = {"transform": left.get_yaxis_transform(), "ha": "right", "va": "center"}
        left.text(-0.05, y, solver.lower(), color=colour, **place)
        for axes, name in ((left, "distance"), (right, "time")):
            filling = np.where(part["wrong [%]"] > 0, "white", colour)
            axes.scatter(part[name], [y] * len(part), 12.0, filling, edgecolors=colour, zorder=3)
    left.set(
        xscale="log", xlabel="worst distance over\nthe plan [1]", yticks=[], ylim=(-1, len(groups))
    )
    right.set(xscale="log", xlabel="time over the\nexact level's [1]")
    for name, colour in COLOURS.items():
        left.scatter([], [], 12.0, colour, label=name)
    left.scatter([], [], 12.0, "white", edgecolors="black", label="says solved, is not")
    drawn.legend(loc="outside upper center", ncols=2)
    return drawn


FIGURES = {
    "solvers": Drawing(
        draw_solvers,
        "Worst distance of QP solvers from the exact level, an arrow from default to tight tolerances, and median times "
        "over that of the compiled exact level; hollow where a solver says that a problem is solved and it is not.",
        study="solvers",
    ),
}
