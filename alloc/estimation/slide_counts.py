"""Slides counted per axle, and the table that represents those of JP5484215 (12) to (14).

Under an automatic brake whose force follows the planned coefficient, measured coefficients scatter about it as a normal
distribution. Half of all brake applications make an axle of the lead car slide; fewer make an axle slide whose rail was
wiped before.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from alloc.errors import EstimationError

SIGMA = 0.012
"""Standard deviation of measured coefficients about the planned one, JP5484215 par. 0055."""

LEAD_AXLES = 4
"""Axles of the lead car, whose mean is the reference."""

SYNTHETIC_TABLE = Path(__file__).parent / "slide_counts_synthetic.csv"
"""Table that is shipped in place of JP5484215 Fig. 11, whose counts are lost: drawn from the model, not measured."""


@dataclass(frozen=True, eq=False)
class SlideCounts:
    """Number of slides of each axle over the same brakings, axle 1 foremost, (axles,)."""

    slides: NDArray[np.int64]
    source: str = ""

    def __post_init__(self) -> None:
        slides = np.asarray(self.slides)
        if slides.ndim != 1 or slides.size <= LEAD_AXLES:
            raise EstimationError(
                f"slide counts: shape {slides.shape}; give one count per axle of more than {LEAD_AXLES} axles"
            )
        wrong = np.flatnonzero(~(np.isfinite(slides) & (slides >= 0) & (slides == slides.round())))
        if wrong.size:
            raise EstimationError(
                f"slide counts: axle {wrong[0] + 1} has {slides[wrong[0]]}; counts are whole numbers, 0 or greater"
            )
        if slides[:LEAD_AXLES].sum() == 0:
            raise EstimationError("slide counts: the lead car never slid, so there is no reference")
        object.__setattr__(self, "slides", slides.astype(np.int64))

    @property
    def axle_count(self) -> int:
        """Number of axles."""
        return self.slides.size

    @property
    def lead_mean(self) -> float:
        """Mean count of the lead car's axles, fr_avg of JP5484215 (13) times the number of brakings."""
        return float(self.slides[:LEAD_AXLES].mean())


def read_slide_counts(path: str | Path) -> SlideCounts:
    """Read a CSV table with the columns `axle` (1, 2, ...) and `slides`; lines that start with # are comments.

    Raises `EstimationError` naming the file, the line and what is wrong with it.
    """
    named = f"slide counts {str(path)!r}"
    try:
        lines = Path(path).read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise EstimationError(f"{named} cannot be read: {error.strerror}") from None
    remarks = [line[1:].strip() for line in lines if line.startswith("#")]
    rows = [(k, line) for k, line in enumerate(lines, 1) if line.strip() and line[0] != "#"]
    header = [name.strip() for name in rows[0][1].split(",")] if rows else []
    if sorted(header) != ["axle", "slides"]:
        raise EstimationError(f"{named}: the columns are {header}, must be axle, slides")
    slides: list[int] = []
    for number, line in rows[1:]:
        try:
            cells = dict(zip(header, map(int, line.split(",")), strict=True))
        except ValueError:
            raise EstimationError(
                f"{named}, line {number}: {line.strip()!r} is no pair of whole numbers"
            ) from None
        if cells["axle"] != len(slides) + 1:
            raise EstimationError(
                f"{named}, line {number}: axle {cells['axle']} where {len(slides) + 1} was due"
            )
        slides.append(cells["slides"])
    return SlideCounts(np.array(slides), " ".join(remarks))
