"""How large are limits of rules, controllers and model: the first table of the page docs/limits.md, beside this file."""

import re
from pathlib import Path

from matplotlib.figure import Figure

from paper_figs.style import WIDE, Drawing

TABLE = Path(__file__).with_suffix(".md")
GAIN = 0.57
"""Points that `cooperative` gains under the MPC, for comparison."""
TICKS = {-30: "−30", -10: "−10", -3: "−3", -1: "−1", 0: "0", 1: "1"}


def read_sizes() -> dict[str, list[float]]:
    """What does not hold -> its size [points], with the bounds of an interval if there is one, as the table has them."""
    _, _, *lines = TABLE.read_text("utf-8").replace("−", "-").splitlines()
    cells = [line.strip("| ").split(" | ") for line in lines]
    return {name: [float(x) for x in re.findall(r"-?[\d.]+", size)] for name, size, *_ in cells}


def draw_limits_sizes() -> Figure:
    """A row for each: means as circles with intervals, single events as crosses."""
    sizes = read_sizes()
    drawn = Figure(figsize=(WIDE, 0.6 + 0.17 * len(sizes)), layout="constrained")
    axes = drawn.subplots()
    for j, (name, (value, *bounds)) in enumerate(sizes.items()):
        marker, colour = ("x", "#d55e00") if name.endswith("worst event") else ("o", "#0072b2")
        axes.plot(bounds, [j] * len(bounds), color=colour, linewidth=0.9)
        axes.plot(value, j, marker, color=colour)
    axes.axvspan(-GAIN, GAIN, color="0.9", zorder=0)
    axes.set_xscale("symlog", linthresh=1.0)
    axes.set_xticks(list(TICKS), list(TICKS.values()))
    axes.set_yticks(range(len(sizes)), [name.replace("`", "") for name in sizes])
    axes.set(xlabel="effect on the bound used [points]", ylabel="rule, controller or assumption")
    axes.invert_yaxis()
    return drawn


CAPTION = (
    "What the limits of rules, controllers and model cost: circles are means with 95 % intervals, crosses single events, "
    "the grey band is what cooperative sharing gains on the mean under the MPC."
)
FIGURES = {"limits-sizes": Drawing(draw_limits_sizes, CAPTION)}
