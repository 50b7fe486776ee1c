"""Acceleration, speed and air resistance through a tunnel, by case (JP H07-322414 Fig. 9)."""

from matplotlib.figure import Figure

from paper_figs.resistance_passage import Runs, drive_all
from paper_figs.resistance_passage import draw as draw_passage
from paper_figs.source import Source
from studies.resistance.routes import Route, route


def figure(source: Source) -> Figure:
    """The figure, of the high-speed train half loaded; its runs take half a minute."""
    of = route("high-speed", load_share=0.5)
    return draw(of, drive_all(of))


def draw(of: Route, runs: Runs) -> Figure:
    """All cases through the route's tunnel, a column per control."""
    return draw_passage(of, runs, of.line.tunnels[0], tunnel=True)
