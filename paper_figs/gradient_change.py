"""Acceleration, speed and gradient over a climb, by case (JP H07-322414 Fig. 10)."""

from matplotlib.figure import Figure

from paper_figs.resistance_passage import Runs, drive_all
from paper_figs.resistance_passage import draw as draw_passage
from paper_figs.source import Source
from studies.resistance.routes import Route, route


def figure(source: Source) -> Figure:
    """The figure, of the commuter train half loaded; its runs take half a minute."""
    of = route("commuter", load_share=0.5)
    return draw(of, drive_all(of))


def draw(of: Route, runs: Runs) -> Figure:
    """All cases over the route's first climb, a column per control."""
    climb = max(range(len(of.line.grades)), key=lambda k: of.line.grades[k])
    place = of.line.stations[climb], of.line.stations[climb + 1]
    return draw_passage(of, runs, place, tunnel=False)
