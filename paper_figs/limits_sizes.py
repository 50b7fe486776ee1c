"""How large are the limits that the page docs/limits.md lists: its first table, which stands beside this file."""

import re
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from paper_figs.style import WIDE, Drawing

TABLE = Path(__file__).with_suffix(".md")
GAIN = 0.56
"""Points that `cooperative` gains under the MPC, for comparison."""
NUMBER = re.compile(r"-?\d+\.?\d*")


def read_sizes() -> list[tuple[str, list[float]]]:
    """What does not hold, and its size [points] with the bounds of an interval or range, the largest first."""
    _, _, *lines = TABLE.read_text("utf-8").splitlines()
    rows = [line.strip("| ").split(" | ") for line in lines]
    sizes = [(name, size.replace("\N{MINUS SIGN}", "-")) for name, size, *_ in rows]
    found = [
        (name.replace("`", ""), [float(x) for x in NUMBER.findall(size)]) for name, size in sizes
    ]
    return sorted(found, key=lambda size: size[1][0])


def draw_limits_sizes() -> Figure:
    """A row for each: means as circles with intervals, single events as crosses."""
    sizes = read_sizes()
    drawn = Figure(figsize=(WIDE, 0.6 + 0.17 * len(sizes)), layout="constrained")
    axes = drawn.subplots()
    for j, (name, (value, *bounds)) in enumerate(sizes):
        worst = name.endswith("worst event")
        colour = "#d55e00" if worst else "#0072b2"
        axes.plot(bounds or [value], [j] * len(bounds or [value]), color=colour, linewidth=0.9)
        axes.plot(value, j, "x" if worst else "o", color=colour)
    axes.axvspan(-GAIN, GAIN, color="0.9", label="less than cooperative gains")
    axes.set_xscale("symlog", linthresh=1.0)
    ticks = [-30, -10, -3, -1, 0, 1]
    axes.set_xticks(ticks, [f"{tick}".replace("-", "\N{MINUS SIGN}") for tick in ticks])
    axes.set_yticks(np.arange(len(sizes)), [name for name, _ in sizes])
    axes.set(
        xlabel="effect on the bound used [points]",
        ylabel="limit of a rule, a controller or the model",
    )
    axes.invert_yaxis()
    return drawn


FIGURES = {
    "limits-sizes": Drawing(
        draw_limits_sizes,
        "What the limits of rules, controllers and model cost: circles are means with 95 % intervals, crosses single events, "
        "the grey band is what cooperative sharing gains on the mean under the MPC.",
    )
}
