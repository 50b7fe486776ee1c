"""Statements of the sweep `log-accuracy`."""

import pandas as pd

from studies.core.statement import Statement


def log_accuracy_statements(table: pd.DataFrame) -> list[Statement]:
    return []
