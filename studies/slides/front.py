"""The front of distance against Q."""

import numpy as np
import pandas as pd


def front(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows of runs that no other run beats in both distance and Q, by growing distance."""
    ordered = rows.sort_values(["distance", "damage"])
    return ordered[ordered["damage"] < ordered["damage"].cummin().shift(fill_value=np.inf)]
