"""Air resistance coefficient in the open and in a tunnel (JP H07-322414 Fig. 3), and what V² alone makes of A + BV + CV²."""

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from alloc.plant.equations import running_resistance
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.resistance.routes import Route, route

READINGS = (("cars", "black", "-", "plant, car by car"), ("middle", "#56b4e9", "--", "memory, middle of the train"),
            ("front", "#e69f00", ":", "memory, front"))  # fmt: skip
MARGIN = 300.0
"""Line [m] shown before and behind the tunnel's first mouth."""


def figure(source: Source) -> Figure:
    """The figure; nothing is run."""
    return draw(route("commuter"))


def draw(of: Route) -> Figure:
    """Left: coefficient over the front's position at a mouth. Right: running resistance over speed, and V² alone."""
    a, b, c = of.train.resistance
    factor, mouth = of.line.tunnel_factor, of.line.tunnels[0][0]
    cruise = of.command.speeds[0]
    drawn = new_figure(7.1, 3.1)
    with mpl.rc_context(fname=STYLE_FILE):
        left, right = drawn.subplots(1, 2)
        x = np.linspace(mouth - MARGIN, mouth + MARGIN, 1201)
        for reading, colour, dashes, label in READINGS:
            share, _ = of.memory(reading).read(x)
            left.plot(
                x, c * (1.0 + (factor - 1.0) * share), color=colour, linestyle=dashes, label=label
            )
        left.set(
            xlabel="position of the front [m]", ylabel="coefficient of V² [kg/m]", ylim=(0.0, None)
        )
        left.set_title(f"(a) open and tunnel, train of {of.length:g} m")
        left.legend(loc="lower right")
        v = np.linspace(0.0, 1.25 * cruise, 200)
        for name, air, colour in (("open", 1.0, "#0072b2"), ("tunnel", factor, "#d55e00")):
            true = running_resistance(v, a, b, c, air)
            equivalent = running_resistance(cruise, a, b, c, air) / cruise**2
            right.plot(v, 1e-3 * true, color=colour, label=f"A + BV + CV², {name}")
            right.plot(
                v, 1e-3 * equivalent * v**2, color=colour, linestyle="--",
                label=f"{'W1' if air == 1.0 else 'W2'} V², {name}",
            )  # fmt: skip
            right.plot(v, 1e-3 * air * c * v**2, color=colour, linestyle=":", label=f"CV², {name}")
        right.set(xlabel="speed [m/s]", ylabel="running resistance [kN]", ylim=(0.0, None))
        right.set_title(f"(b) weights learnt at {cruise:g} m/s")
        right.legend(loc="upper left")
    return drawn
