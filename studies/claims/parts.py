"""Parts of the random events, by what was drawn: the conditions that a verdict may name."""

from studies.claims.events import BELIEVED_SLOPE
from studies.core.verdict import Part

PARTS: dict[str, Part] = {
    "summer": lambda e: e["season"] == "summer",
    "winter": lambda e: e["season"] == "winter",
    "growth along the train much below belief": lambda e: e["slope"] < 0.67 * BELIEVED_SLOPE,
    "growth along the train about as believed": lambda e: e["slope"].between(
        0.67 * BELIEVED_SLOPE, 1.33 * BELIEVED_SLOPE
    ),
    "growth along the train much above belief": lambda e: e["slope"] > 1.33 * BELIEVED_SLOPE,
    "little scatter (< 0.006)": lambda e: e["scatter"] < 0.006,
    "much scatter (>= 0.006)": lambda e: e["scatter"] >= 0.006,
    "uniform rail": lambda e: e["patch_factor"] == 1.0,
    "a patch": lambda e: e["patch_factor"] < 1.0,
    "adhesion independent of speed": lambda e: e["speed_law"] == "none",
    "adhesion falling with speed": lambda e: e["speed_law"] != "none",
    "heavier front": lambda e: e["tilt"] < -0.25,
    "even load": lambda e: e["tilt"].abs() <= 0.25,
    "heavier rear": lambda e: e["tilt"] > 0.25,
    "level line": lambda e: e["grade_permille"] == 0.0,
    "a gradient": lambda e: e["grade_permille"] > 0.0,
}
"""Name -> which events of a table with what was drawn (`studies.claims.events`) belong to it."""
