"""A column that is read block by block."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


class GrowingColumn:
    """Values that come block by block, in one array: small pieces would stay in memory after they are freed."""

    def __init__(self, expected: int) -> None:
        self.values: NDArray[Any] = np.empty(0)
        self.expected, self.count = expected, 0

    def append(self, block: NDArray[Any]) -> None:
        """Add a block."""
        end = self.count + block.size
        if end > self.values.size:
            larger = np.empty(max(self.expected, 2 * end if self.count else end), block.dtype)
            larger[: self.count] = self.values[: self.count]
            self.values = larger
        self.values[self.count : end] = block
        self.count = end

    def __len__(self) -> int:
        return self.count
