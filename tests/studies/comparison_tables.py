"""Synthetic rows of a comparison: differences between rules are known, and several rules give the same."""

import numpy as np
import pandas as pd

SCENARIOS = ("one", "two", "three")
RULES = {"alone": 0.0, "greedy": 0.02, "exact": 0.02, "cooperative": 0.08}
"""What each rule adds to the effort over plan; two of them the same."""


def comparison_table(
    controllers: tuple[str, ...] = ("cut-and-ramp", "mpc"), seeds: int = 4
) -> pd.DataFrame:
    """Every rule adds its own share of effort, and ten times as much damage [kJ] in per cent; the MPC meets one seed."""
    noise = np.random.default_rng(5)
    rows = []
    for k, scenario in enumerate(SCENARIOS):
        for controller in controllers:
            for seed in range(1 if controller == "mpc" else seeds):
                base = 0.8 + 0.03 * k + 0.01 * noise.standard_normal()
                for rule, more in RULES.items():
                    effort = base + more + (0.002 * noise.standard_normal() if more > 0.05 else 0.0)
                    rows.append({
                        "scenario": scenario, "rule": rule, "controller": controller, "seed": seed, "status": "ok",
                        "reason": "", "cell": f"{scenario}/{rule}/{controller}/{seed}", "effort_ratio": effort,
                        "bound_use": effort, "utilisation": effort, "damage": 100.0 + 1000.0 * more, "jerk_rms": 0.2 - more,
                    })  # fmt: skip
    return pd.DataFrame(rows)
