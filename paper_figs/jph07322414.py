"""Figures of JP H07-322414: air resistance in the open and in a tunnel, and what a tunnel and a climb do to a train.

The source draws Figs. 9 and 10 for a speed control without compensation. Here they have compensation too, for the
commuter train of the study `jph07322414`, half loaded, under PI control and without noise.
"""

from functools import cache

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from paper_figs.sharing import study_figure
from paper_figs.style import NARROW, Drawing
from studies.jph07322414 import drive_case, make_route

SOURCE = "jph07322414"
LOOKS = {
    "feedback": ("feedback alone", "0.35", "-"),
    "compensation": ("compensated at a point", "#d55e00", "--"),
    "cars": ("car by car", "#0072b2", "-"),
}
"""Cases of the study: words, colour, and line."""
COMMUTER = make_route("commuter", tunnel_factor=2.0, load=0.5, gradient=0.02, cruise=18.0)


@cache
def drive_commuter(case: str) -> xr.Dataset:
    """A run without noise."""
    return drive_case(COMMUTER, case, integral=True, wrong=np.ones(3), seed=None)


def draw_air_resistance() -> Figure:
    """Fig. 3."""
    drawn = Figure(figsize=(NARROW, 2.2), layout="constrained")
    axes = drawn.subplots()
    speed = np.linspace(0.0, 72.0, 100)
    route = make_route("high-speed", tunnel_factor=2.0, load=0.5, gradient=0.0, cruise=70.0)
    looks = (("open, $K_1 V^2$", "#0072b2"), ("tunnel, $K_2 V^2$", "#d55e00"))
    for coefficient, (label, colour) in zip(route.weights(2), looks, strict=True):
        axes.plot(3.6 * speed, coefficient * speed**2 / 1e3, color=colour, label=label)
    axes.set(
        xlabel="speed [km/h]", ylabel="air resistance [kN]", xlim=(0.0, None), ylim=(0.0, None)
    )
    axes.legend()
    return drawn


def draw_passage(stretch: str, start: float, end: float, axis: str, values: list[float]) -> Figure:
    """Acceleration, speed, and a coefficient with its `values` before and between `start` and `end` [m] of the `stretch`."""
    drawn = Figure(figsize=(NARROW, 3.8), layout="constrained")
    panels = drawn.subplots(3, 1, sharex=True, height_ratios=(3, 3, 1.2))
    first, length, last = -150.0, end - start, end - start + 450.0
    for case, (label, colour, line) in LOOKS.items():
        run = drive_commuter(case)
        x = run["position"].values - start
        w = (x > first) & (x < last)
        off = 3.6 * (run["speed"] - run["commanded_speed"]).values
        panels[0].plot(x[w], run["acceleration"].values[w], line, color=colour, label=label)
        panels[1].plot(x[w], off[w], line, color=colour)
    panels[2].step([first, 0.0, length, last], [values[0], *values, values[0]], "0.2")
    for axes in panels:
        axes.axvspan(0.0, length, color="0.93", lw=0)
    panels[0].set_ylabel("acceleration [m/s²]")
    panels[1].set_ylabel("speed off command\n[km/h]")
    panels[2].set(ylabel=axis, ylim=(0.0, 1.15 * values[1]))
    panels[2].set_xlabel(f"front beyond the start of the {stretch} [m]")
    drawn.align_ylabels()
    drawn.legend(loc="outside upper right", ncols=3, columnspacing=1.0)
    return drawn


def draw_tunnel() -> Figure:
    """Fig. 9."""
    start, end = COMMUTER.line.tunnels[0]
    return draw_passage("tunnel", start, end, "$K_1, K_2$\n[kg/m]", COMMUTER.weights(2).tolist())


def draw_climb() -> Figure:
    """Fig. 10."""
    line = COMMUTER.line
    sine = line.grades[1] / float(np.hypot(1.0, line.grades[1]))  # (1)
    start, end = line.stations[1:3]
    return draw_passage("climb", start, end, "sin θ [1]", [0.0, sine])


FIGURES = {
    "resistance-air": Drawing(
        draw_air_resistance,
        "Air resistance of the high-speed train over its speed, in the open and in a tunnel with twice the coefficient.",
        source=SOURCE,
    ),
    "resistance-tunnel": Drawing(
        draw_tunnel,
        "A train of 160 m passes a tunnel at 65 km/h (grey: its front is inside): acceleration, speed off the commanded, "
        "and the coefficient; before the tunnel the speed still settles from the start of the run.",
        source=SOURCE,
    ),
    "resistance-climb": Drawing(
        draw_climb,
        "The same past a climb of 20 per mille (grey: the front is on it): acceleration, speed off the commanded 65 km/h, "
        "and the slope.",
        source=SOURCE,
    ),
    "resistance": Drawing(
        study_figure(SOURCE),
        "Disturbances with compensation over those of the feedback alone: means of random routes and 95 % intervals.",
        study=SOURCE,
        source=SOURCE,
    ),
}
