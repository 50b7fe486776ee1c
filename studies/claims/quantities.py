"""What is drawn for the random events of the claims: each quantity with its distribution and reason."""

import numpy as np

from studies.core.drawn_events import DrawnEvents, Quantity, sometimes, uniform

BELIEVED_SLOPE = 0.0166
"""Slope of the increments that the train believes in, in every event: what is stored changes less than the weather."""
LEVELS = {"summer": (0.138, 0.012), "winter": (0.118, 0.018)}
"""Mean and standard deviation of the level by season."""
LEVEL_BOUNDS = (0.06, 0.20)

QUANTITIES: dict[str, Quantity] = {
    "season": Quantity(
        "summer or winter, equally likely",
        "JP5484215 names the difference between summer and winter as what a preset pattern cannot follow",
        lambda g, _: str(g.choice(list(LEVELS))),
    ),
    "level": Quantity(
        "normal, summer 0.138 ± 0.012, winter 0.118 ± 0.018, cut to 0.06 ... 0.20; of the first four axles at 15 km/h",
        "assumed: in summer the front often falls short and the whole does not, in winter the whole often does too",
        lambda g, d: float(np.clip(g.normal(*LEVELS[d["season"]]), *LEVEL_BOUNDS)),
    ),
    "slope": uniform(
        0.0, 2.0 * BELIEVED_SLOPE, ": from no growth along the train to twice what it believes",
        "JP5484215 (15): 0.0083 where the planned coefficient is 0.07; in proportion 0.0166 at starting, always believed",
    ),
    "scatter": uniform(
        0.0, 0.012, ", correlated over 20 m",
        "JP5484215 par. on (12)-(15): 0.012 over all its measurements; one stretch of one day scatters less",
    ),
    "patch_factor": sometimes(
        0.3, 0.6, 0.9, " times the coefficient", 1.0, "assumed: leaves, oil or a leaking drain do not lie everywhere",
    ),
    "patch_start_m": uniform(5.0, 40.0, " m", "assumed: met during the event"),
    "patch_length_m": uniform(20.0, 60.0, " m", "assumed: one to three cars"),
    "speed_law": Quantity(
        "none in half, Curtius-Kniffler and JP5484215 (12) in a quarter each",
        "adhesion falls with speed; how much over the first 36 km/h is disputed",
        lambda g, _: str(g.choice(["none", "curtius-kniffler", "shinkansen"], p=[0.5, 0.25, 0.25])),
    ),
    "load_t": uniform(
        0.0, 8.0, " t per car on the mean", "12 t is a crowded car; up to 8 t the motors reach the plan throughout"
    ),
    "tilt": uniform(
        -0.8, 0.8, ": the load's growth from the middle to the rear end, over its mean",
        "assumed: passengers gather near stairs at one end of the platform",
    ),
    "load_error": uniform(0.0, 0.05, "", "assumed: pressure of air springs"),
    "speed_noise_kmh": uniform(0.0, 0.04, " km/h", "twice the scenario scattered-rail at most"),
    "telegram_loss": uniform(0.0, 0.05, "", "the scenario scattered-rail at most"),
    "grade_permille": sometimes(
        0.4, 5.0, 20.0, " per mille uphill", 0.0, "most stations are level; 20 per mille as in gradient-start"
    ),
}  # fmt: skip
"""Every drawn quantity in the order of drawing."""
EVENTS = DrawnEvents("random", QUANTITIES)
draw, event_name, drawn_table = EVENTS.draw, EVENTS.event_name, EVENTS.table
