"""Colours, after Okabe and Ito's palette for colour-blind readers, its yellow darkened; colour and marker of every rule."""

BLUE, VERMILION, ORANGE, SKY, GREEN = "#0072b2", "#d55e00", "#e69f00", "#56b4e9", "#009e73"
PURPLE, PINK, OLIVE, GREY, BLACK = "#7b3294", "#cc79a7", "#b0a000", "#7f7f7f", "#000000"
DARK = "#444444"
"""Of bounds, and of legend entries that stand for every colour."""

RULE_COLOURS: dict[str, str] = {
    "alone": GREY, "preset": OLIVE, "sharing": ORANGE, "greedy": VERMILION, "greedy-claim": PINK,
    "exact": BLUE, "qp": SKY, "qp-cvxpy": GREEN, "qp-robust": PURPLE, "oracle": BLACK,
}  # fmt: skip
OTHER_COLOUR = "#882255"
"""Of a rule that has no colour of its own yet."""

RULE_MARKERS: dict[str, str] = {
    "alone": "o", "preset": "v", "sharing": "^", "greedy": "s", "greedy-claim": "D",
    "exact": "P", "qp": "X", "qp-cvxpy": "<", "qp-robust": ">", "oracle": "*",
}  # fmt: skip
