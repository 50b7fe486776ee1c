"""Colours, after Okabe and Ito's palette for colour-blind readers, its yellow darkened to show on white."""

BLUE, VERMILION, ORANGE, SKY, GREEN = "#0072b2", "#d55e00", "#e69f00", "#56b4e9", "#009e73"
PURPLE, PINK, OLIVE, GREY, BLACK = "#7b3294", "#cc79a7", "#b0a000", "#7f7f7f", "#000000"
DARK = "#444444"
"""Of bounds, and of legend entries that stand for every colour."""
DRAFT = "#b00000"
"""Of the line that marks a draft."""
