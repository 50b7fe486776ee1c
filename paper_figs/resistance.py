"""Running resistance, open and in tunnels, JP H07-322414 Fig. 3, and learning it."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from alloc.onboard.line_memory import WEIGHTS
from alloc.plant.laws import running_resistance
from paper_figs.palette import BLUE, GREY, ORANGE, SKY, VERMILION
from paper_figs.registry import figure
from paper_figs.source import made
from paper_figs.style import PAGE, legend_below, new_panels
from studies.resistance.learners import GRADIENT, NORMALISED, PRINTED, SQUARES, convergence
from studies.resistance.routes import Route, route

READINGS = (("cars", "black", "-", "plant, car by car"), ("middle", SKY, "--", "memory, middle of the train"),
            ("front", ORANGE, ":", "memory, front"))  # fmt: skip
MARGIN = 300.0
"""Line [m] shown before and behind the tunnel's first mouth."""
LEARNER_LOOKS = {
    GRADIENT: (ORANGE, "o"),
    PRINTED: (GREY, "X"),
    NORMALISED: (VERMILION, "s"),
    SQUARES: (BLUE, "D"),
}
"""Colour and marker of each learner."""
MEANING = {"W1": "air, open", "W2": "air, tunnel", "W3": "mass"}
PASSES = 4
LEAST = 0.02
"""Least error shown [%]."""


@figure("air-resistance", "air resistance coefficient, open and tunnel (JP H07-322414 Fig. 3)",
        made(route, "commuter"))  # fmt: skip
def air_resistance(of: Route) -> Figure:
    """Left: coefficient over the front's position at a mouth. Right: running resistance over speed, and V² alone."""
    a, b, c = of.train.resistance
    factor, mouth = of.line.tunnel_factor, of.line.tunnels[0][0]
    cruise = of.command.speeds[0]
    drawn, (left, right) = new_panels(PAGE, 3.1, 1, 2)
    x = np.linspace(mouth - MARGIN, mouth + MARGIN, 1201)
    for reading, colour, dashes, label in READINGS:
        coefficient = c * (1.0 + (factor - 1.0) * of.memory(reading).read(x)[0])
        left.plot(x, coefficient, color=colour, linestyle=dashes, label=label)
    left.set(xlabel="position of the front [m]", ylabel="coefficient of V² [kg/m]")
    left.set_title(f"(a) open and tunnel, train of {of.length:g} m")
    left.legend(loc="lower right")
    v = np.linspace(0.0, 1.25 * cruise, 200)
    for name, weight, air, colour in (
        ("open", "W1", 1.0, BLUE),
        ("tunnel", "W2", factor, VERMILION),
    ):
        equivalent = running_resistance(cruise, a, b, c, air) / cruise**2
        for resistance, dashes, law in (
            (running_resistance(v, a, b, c, air), "-", "A + BV + CV²"),
            (equivalent * v**2, "--", f"{weight} V²"),
            (air * c * v**2, ":", "CV²"),
        ):
            right.plot(v, 1e-3 * resistance, dashes, color=colour, label=f"{law}, {name}")
    right.set(xlabel="speed [m/s]", ylabel="running resistance [kN]")
    right.set_title(f"(b) weights learnt at {cruise:g} m/s")
    right.legend(loc="upper left")
    for axes in (left, right):
        axes.set_ylim(0.0, None)
    return drawn


@figure("resistance-weights", "convergence of the weights of running resistance, by learner",
        made(lambda: convergence(route("commuter", load_share=0.5).square_only(), PASSES)))  # fmt: skip
def resistance_weights(errors: pd.DataFrame) -> Figure:
    """A panel per weight: median size of its error relative to the plant's in each pass of the line, and its middle 80 %."""
    drawn, panels = new_panels(PAGE, 2.7, 1, len(WEIGHTS), sharex=True, sharey=True)
    aside = np.linspace(-0.27, 0.27, len(LEARNER_LOOKS))
    for axes, weight in zip(panels, WEIGHTS, strict=True):
        for (learner, (colour, marker)), offset in zip(LEARNER_LOOKS.items(), aside, strict=True):
            own = errors[errors["learner"] == learner]
            sizes = 100.0 * own[weight].abs().clip(lower=LEAST / 100.0)
            found = sizes.groupby(own["run"]).quantile(np.array([0.1, 0.5, 0.9])).unstack()
            sides = np.abs(found[[0.1, 0.9]].to_numpy() - found[[0.5]].to_numpy()).T
            axes.errorbar(
                found.index + 1 + offset, found[0.5], sides, color=colour, marker=marker, linestyle="none",
                markersize=4.0, elinewidth=1.2, label=learner,
            )  # fmt: skip
        axes.set(yscale="log", title=f"{weight} ({MEANING[weight]})", xlabel="pass of the line [–]")
        axes.set(ylim=(LEAST, None), xticks=range(1, errors["run"].max() + 2))
        axes.grid(visible=False, axis="x")
    panels[0].set_ylabel("error of the weight [%]")
    panels[0].yaxis.set_major_formatter("{x:g}")
    legend_below(drawn, len(LEARNER_LOOKS), panels[0])
    return drawn
