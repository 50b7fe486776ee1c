"""What is drawn for the random events with headroom: each quantity with its distribution and reason."""

from typing import Any

from studies.core.drawn_events import DrawnEvents, Quantity, sometimes, uniform

TRAINS: dict[str, tuple[str, dict[str, Any]]] = {
    "8 cars, 4 units": ("wet-start", {"inverter_group": "1C4M"}),
    "16 cars, 14 units": ("wet-start", {"train": "high-speed-16car", "command": [
        {"time_s": 0.0, "acceleration_kmhs": 2.2}]}),
    "8 cars, 16 units": ("wet-start", {"inverter_group": "1C1M"}),
    "locomotive, 6 units": ("freight-start", {}),
    "8 cars, 8 units": ("wet-start", {"inverter_group": "1C2M"}),
}  # fmt: skip
"""Train -> the shipped scenario whose train and command it has, and the changes to it. The 16 cars are asked for less than
2.6 km/h/s, at which motors have a reserve of a tenth."""
SOURCES = ("growth", "bad front", "bad rear", "failed motors")
"""What makes most of the headroom."""
WANTED = ((0.0, 0.015), (0.025, 0.05), (0.065, 0.10), (0.10, 0.18))
"""Headroom that the source is to make, by class; a train that moves over the rail meets less."""

QUANTITIES: dict[str, Quantity] = {
    "train": Quantity(
        "each of five in its turn",
        "few units and many, trailers between them or none, a torque for four axles, for two, for one",
        lambda _, d: list(TRAINS)[d["number"] % len(TRAINS)],
    ),
    "wanted": Quantity(
        f"uniform in each of {', '.join(f'{a:g} ... {b:g}' for a, b in WANTED)}, each for five events in its turn",
        "small and large headroom alike; the random events of the claims have 0.0014 in the median",
        lambda g, d: float(g.uniform(*WANTED[d["number"] // len(TRAINS) % len(WANTED)])),
    ),
    "source": Quantity(
        "growth along the train 40 %, bad rail in front, bad rail at the rear, failed motors 20 % each",
        "JP5484215 (15); a shower or leaves that begin below the train; rail cleaned or sanded as far as there",
        lambda g, _: str(g.choice(SOURCES, p=[0.4, 0.2, 0.2, 0.2])),
    ),
    "growth": uniform(
        -0.05, 0.2, " of the plan from the first axle to the last, where something else makes the headroom",
        "JP5484215 (15): 0.0083 ln 16 where the plan needs 0.07 is a third",
    ),
    "border": uniform(0.1, 0.9, " of the train's length behind its head", "where good and bad rail meet at the start"),
    "failed_place": uniform(0.0, 1.0, " of the units, from the front", "any unit may fail"),
    "failed_at_s": uniform(1.0, 5.0, " s", "before and after the torque is up"),
    "level_ratio": uniform(
        0.96, 1.06, " times the plan's coefficient, on the mean of the driven axles",
        "the train as a whole reaches the plan or nearly so: where it is far above or below, nothing can be gained",
    ),
    "demand": uniform(0.85, 1.0, " of the usual acceleration", "motors have 17 to 70 % in hand"),
    "curve": Quantity(
        "piecewise and Polach's of wet rail, equally likely",
        "a narrow peak and a wide one; the train believes in the narrow one",
        lambda g, _: str(g.choice(["piecewise", "polach"])),
    ),
    "residual_ratio": uniform(
        0.5, 0.9, " of the peak at infinite slip (piecewise only)", "readhesion paper leaves it open"
    ),
    "scatter_share": sometimes(
        0.5, 0.01, 0.06, " of the plan's coefficient, correlated over 20 m", 0.0,
        "JP5484215 par. on (12)-(15): 0.012 over all its measurements; one stretch of one day scatters less",
    ),
    "conditioning": sometimes(
        0.4, 0.05, 0.3, " of the coefficient, where wheels ahead slipped much", 0.0, "wheels that slip clean the rail",
    ),
    "patch_factor": sometimes(
        0.3, 0.6, 0.9, " times the coefficient", 1.0, "leaves or oil, met axle after axle",
    ),
    "patch_start_m": uniform(5.0, 30.0, " m", "met during the event"),
    "patch_length_m": uniform(10.0, 60.0, " m", "half a car to three cars"),
    "load_t": uniform(0.0, 6.0, " t per car on the mean (not the locomotive's train)", "motors reach the plan throughout"),
    "tilt": uniform(-0.8, 0.8, ": the load's growth from the middle to the rear end, over its mean", "as in the claims"),
    "load_error": uniform(0.0, 0.05, "", "assumed: pressure of air springs"),
    "speed_noise_kmh": uniform(0.0, 0.04, " km/h", "twice the scenario scattered-rail at most"),
    "telegram_loss": uniform(0.0, 0.05, "", "the scenario scattered-rail at most"),
    "grade_permille": sometimes(0.4, 5.0, 20.0, " per mille uphill", 0.0, "as in the claims"),
}  # fmt: skip
"""Every drawn quantity in the order of drawing."""
EVENTS = DrawnEvents("headroom", QUANTITIES, stream=(14,), numbered=True)
draw, event_name = EVENTS.draw, EVENTS.event_name
