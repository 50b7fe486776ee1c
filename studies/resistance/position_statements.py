"""What the sweep `line-position` says."""

import pandas as pd

from studies.core.statement import Statement


def position_statements(table: pd.DataFrame) -> list[Statement]:
    """Statements."""
    return []
