"""Wheel slide protection of the air brakes: what a bogie's supply and release valve do while its wheels slide.

Each car has a computer of its own that decides for every bogie. The laws are `threshold` (switching points of the slip
ratio) and `fuzzy` (rules on slip and its rate); `protect` runs the one that a train has, and its safeguards.
"""

NONE, THRESHOLD, FUZZY = range(3)
"""Identifiers in compiled code."""

LAWS: dict[str, int] = {"none": NONE, "threshold": THRESHOLD, "fuzzy": FUZZY}
"""Laws by name, from the simplest on."""
