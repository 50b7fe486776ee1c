"""Records of single numbers whose fields are attributes, in Python as in compiled code."""

import numpy as np


def named_record(*names: str, **others: type) -> np.dtype[np.void]:
    """Type of records of floats called `names`, then of what is said of `others`; for arrays of such records."""
    return np.dtype((np.record, [(name, float) for name in names] + list(others.items())))
