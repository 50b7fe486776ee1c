"""Rules and controllers have colours of their own, told apart by every reader and never by colour alone."""

from itertools import combinations, product

import numpy as np
from colorspacious import cspace_convert
from matplotlib.colors import to_rgb

from alloc.onboard.host import CONTROLLERS, HostedController
from alloc.rules import RULES
from paper_figs.style import CONTROLLER_FILL, OTHER_COLOUR
from studies.comparison.summary import SLOW_CONTROLLER
from studies.core.drawn_events import COMPARED

SIGHTS = (None, "deuteranomaly", "protanomaly", "tritanomaly")
"""Full colour vision, and each kind of its loss (Machado et al. 2009)."""
LEAST, LEAST_COMPARED, LEAST_ACROSS = 8.0, 15.0, 8.0
"""Distances in CAM02-UCS, in which 1 is just seen side by side: within a palette, among those compared by default, and
between the palettes as full colour vision has them."""
DARKEST_GROUND = 80.0
"""Lightness above which a mark is lost on white."""
PALETTES = {
    "rules": {name: part.colour for name, part in RULES.items()},
    "controllers": {name: part.colour for name, part in CONTROLLERS.items()},
}
MAIN = {
    "rules": (
        "alone",
        "uniform",
        "preset",
        "sharing",
        "erp",
        "greedy",
        "exact",
        "cooperative",
        "wear",
        "oracle",
    ),
    "controllers": ("none", *COMPARED, SLOW_CONTROLLER),
}


def seen(colour, sight):
    """A colour in CAM02-UCS as a reader sees it."""
    rgb = np.array(to_rgb(colour))
    if sight is not None:
        space = {"name": "sRGB1+CVD", "cvd_type": sight, "severity": 100}
        rgb = np.clip(cspace_convert(rgb, space, "sRGB1"), 0.0, 1.0)
    return cspace_convert(rgb, "sRGB1", "CAM02-UCS")


def distance(one, other, sight=None):
    return float(np.linalg.norm(seen(one, sight) - seen(other, sight)))


def test_colours_and_markers_of_a_palette_are_told_apart():
    for palette, colours in PALETTES.items():
        for (one, other), sight in product(combinations(colours, 2), SIGHTS):
            both_main = one in MAIN[palette] and other in MAIN[palette]
            least = LEAST_COMPARED if both_main else LEAST
            assert distance(colours[one], colours[other], sight) >= least, (one, other, sight)
    # no rule looks like a controller
    for one, other in product(*(palette.items() for palette in PALETTES.values())):
        assert distance(one[1], other[1]) >= LEAST_ACROSS, (one, other)
    # what grey print does not tell apart markers do, and fillings of controllers
    for parts in (RULES, CONTROLLERS):
        assert len({part.marker for part in parts.values()}) == len(parts)
    assert set(CONTROLLER_FILL) < set(CONTROLLERS)
    assert len(set(CONTROLLER_FILL.values())) == len(CONTROLLER_FILL)


def test_every_colour_stands_out_from_paper():
    for colour in (*PALETTES["rules"].values(), *PALETTES["controllers"].values()):
        assert seen(colour, None)[0] <= DARKEST_GROUND, colour


def test_a_part_that_states_no_colour_has_none_of_another():
    assert type(RULES["alone"]).colour == HostedController.colour == OTHER_COLOUR
    for palette in PALETTES.values():
        assert all(distance(OTHER_COLOUR, colour) >= LEAST for colour in palette.values())


def test_the_measure_finds_what_is_alike():
    assert distance("#d55e00", "#d55e00") == 0.0
    red, green = "#c04000", "#608000"
    assert distance(red, green) > 20.0
    assert distance(red, green, "deuteranomaly") < 0.5 * distance(red, green)
