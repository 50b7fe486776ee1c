"""One look for all figures: the style file, and a fixed colour and marker for every rule."""

from collections.abc import Iterable
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

STYLE_FILE = Path(__file__).parent / "readhesion.mplstyle"

RULE_COLOURS: dict[str, str] = {
    "alone": "#7f7f7f",
    "preset": "#b0a000",
    "sharing": "#e69f00",
    "greedy": "#d55e00",
    "greedy-claim": "#cc79a7",
    "exact": "#0072b2",
    "qp": "#56b4e9",
    "qp-cvxpy": "#009e73",
    "qp-robust": "#7b3294",
    "oracle": "#000000",
}
"""After Okabe and Ito's palette for colour-blind readers, its yellow darkened to show on white."""
OTHER_COLOUR = "#882255"
"""Of a rule that has no colour of its own yet."""

RULE_MARKERS: dict[str, str] = {
    "alone": "o", "preset": "v", "sharing": "^", "greedy": "s", "greedy-claim": "D",
    "exact": "P", "qp": "X", "qp-cvxpy": "<", "qp-robust": ">", "oracle": "*",
}  # fmt: skip

CONTROLLER_FILL: dict[str, str] = {
    "none": "bottom", "cut-and-ramp": "full", "mpc": "none", "mpc-car": "top", "mpc-train": "right",
    "mpc-train-ideal": "left",
}  # fmt: skip
"""How a marker is filled tells the readhesion controller."""


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of this size [inches] in the project's style, outside of pyplot's memory."""
    with mpl.rc_context(fname=STYLE_FILE):
        return Figure(figsize=(width, height), layout="constrained")


def rule_colour(rule: str) -> str:
    """The rule's colour, the same in every figure."""
    return RULE_COLOURS.get(rule, OTHER_COLOUR)


def rule_marker(rule: str) -> str:
    """The rule's marker, so that colour is never the only sign."""
    return RULE_MARKERS.get(rule, "h")


def rule_handles(rules: Iterable[str]) -> list[Line2D]:
    """Legend entries of rules: marker and colour."""
    return [
        Line2D([], [], linestyle="none", marker=rule_marker(r), color=rule_colour(r), label=r)
        for r in rules
    ]


def controller_handles(controllers: Iterable[str]) -> list[Line2D]:
    """Legend entries of controllers: fill of the marker."""
    return [
        Line2D([], [], linestyle="none", marker="o", color="#444444", markerfacecoloralt="white",
               fillstyle=CONTROLLER_FILL.get(c, "left"), label=c)  # type: ignore[arg-type]
        for c in controllers
    ]  # fmt: skip
