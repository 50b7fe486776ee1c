"""The thresholds of the sweep `line-position`: what each claim of JP H07-322414 must pass, with every error alike."""

from studies.core.threshold import Threshold
from studies.resistance.driven_cases import CARS, FEEDBACK, LEARNED, RIGHT, TAUGHT

PATENT, OWN = "JP H07-322414", "set by this project"

TABLE = (
    Threshold("1, 2: speed", f"speed_peak, {RIGHT} over {FEEDBACK}", "at most", 1.0,
              "compensation lessens the disturbance of the speed", PATENT),
    Threshold("1, 2: speed, car by car", f"speed_peak, {CARS} over {FEEDBACK}", "at most", 1.0,
              "the same, the memory read car by car", OWN),
    Threshold("1, 2: ride", f"acceleration_peak, {RIGHT} over {FEEDBACK}", "at most", 1.0,
              "compensation improves the ride: less acceleration off the command", PATENT),
    Threshold("1, 2: ride, car by car", f"acceleration_peak, {CARS} over {FEEDBACK}", "at most", 1.0,
              "the same, the memory read car by car", OWN),
    Threshold("1, 2: jerk", f"jerk_peak, {RIGHT} over {FEEDBACK}", "at most", 1.0,
              "a better ride is less jerk too", OWN),
    Threshold("1, 2: jerk, car by car", f"jerk_peak, {CARS} over {FEEDBACK}", "at most", 1.0,
              "the same, the memory read car by car", OWN),
    Threshold("3, 4: as steady as true ones", f"speed_peak, {LEARNED} over {RIGHT}", "at most", 1.25,
              "learning has arrived where a quarter is left to be gained", f"{PATENT}: almost true; a quarter {OWN}"),
    Threshold("3, 4: mass", f"error of W3@{LEARNED}", "at most", 0.05,
              "W3 becomes the train's mass while it compensates", f"{PATENT}: the mass; a twentieth {OWN}"),
    Threshold("5: in use", "use share", "at least", 0.5,
              "the switch comes to use what was learnt, for most of the run", f"{PATENT}: alternately; most {OWN}"),
    Threshold("6, 7: mass", "error of W3, least squares", "at most", 0.05,
              "the stand-alone learner finds the train's mass", f"{PATENT}: the mass; a twentieth {OWN}"),
    Threshold("learning mends", f"speed_peak, {TAUGHT} over {CARS}", "at most", 0.9,
              "coefficients that were learnt take away a tenth of what the error of the map leaves", OWN),
)  # fmt: skip
"""Every threshold that decides a verdict; it is the same with every error."""
