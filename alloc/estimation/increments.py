"""Growth of adhesion along the train from slides per axle: JP5484215 (12) to (15); and tables learnt from run to run.

In: counts of slides, or a recorded run. Out: increments per axle or unit with their sampling error; a file of the train.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.stats import norm

from alloc.display import displayed
from alloc.errors import EstimationError, OnboardError
from alloc.onboard.increment_learning import Increments, LearntIncrements
from alloc.plant.laws import hyperbolic_speed_law
from alloc.plant.rail import SPEED_LAWS
from alloc.sources import write_whole

# Slides counted per axle, and the table that represents those of JP5484215 (12) to (14).
#
# Under an automatic brake whose force follows the planned coefficient, measured coefficients scatter about it as a
# normal distribution. Half of all brake applications make an axle of the lead car slide; fewer make an axle slide whose
# rail was wiped before.


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


# From slides per axle to the growth of adhesion along the train: JP5484215 (13) to (15), with its sampling error.


Floats = NDArray[np.float64]


@displayed
@dataclass(frozen=True, eq=False)
class AxleShifts:
    """k_j sigma of each axle: difference between its mean coefficient and the lead car's, (axles,)."""

    shift: Floats
    """[-]; nan for axles without information: no slide at all, or at least twice the lead car's mean."""
    covariance: Floats
    """Covariance of `shift` due to counting alone, (axles, axles)."""

    @property
    def deviation(self) -> Floats:
        """Standard error of each shift, (axles,)."""
        return np.sqrt(np.diag(self.covariance))


def axle_shifts(counts: SlideCounts) -> AxleShifts:
    """Solve (14) for every axle: k_j = -Phi^-1(fr_j / (2 fr_avg)).

    Counts are Poisson, so their variance is the count itself; the covariance follows by linearisation, with the
    lead car's mean, which all axles share, included.
    """
    slides = counts.slides.astype(float)
    ratio = slides / (2.0 * counts.lead_mean)
    usable = (ratio > 0.0) & (ratio < 1.0)
    k = np.full(slides.size, np.nan)
    k[usable] = -norm.ppf(ratio[usable])
    steepness = ratio / norm.pdf(k)  # -dk over the relative change of the ratio
    lead = np.arange(slides.size) < LEAD_AXLES
    with np.errstate(divide="ignore", invalid="ignore"):
        change = np.diag(1.0 / slides) - lead[None, :] / (LEAD_AXLES * counts.lead_mean)
        jacobian = np.where(slides > 0.0, -SIGMA * steepness[:, None] * change, 0.0)
        covariance = jacobian * slides @ jacobian.T
    covariance[~usable, :] = covariance[:, ~usable] = np.nan
    return AxleShifts(SIGMA * k, covariance)


@displayed
@dataclass(frozen=True, eq=False)
class IncrementFit:
    """slope ln j + offset fitted to the shifts, offset such that the lead car's mean is zero, as (15)."""

    slope: float
    offset: float
    slope_deviation: float
    """Standard error of the slope due to counting; that of the offset is `LEAD_LOG_MEAN` times it."""
    axles: int

    def increments(self, axle_count: int | None = None) -> Floats:
        """Increment of each axle, (axle_count,)."""
        j = np.arange(1, (self.axles if axle_count is None else axle_count) + 1)
        return self.slope * np.log(j) + self.offset

    def band(self, confidence: float = 0.95) -> tuple[Floats, Floats]:
        """Lower and upper edge of the fitted curve at this confidence, two (axles,).

        One parameter is free, so the band is valid for all axles at once.
        """
        j = np.arange(1, self.axles + 1)
        width = norm.ppf(0.5 + 0.5 * confidence) * self.slope_deviation
        half = width * np.abs(np.log(j) - LEAD_LOG_MEAN)
        return self.increments() - half, self.increments() + half


LEAD_LOG_MEAN = float(np.log(np.arange(1, LEAD_AXLES + 1)).mean())
"""Mean of ln 1 to ln 4, 0.7945."""


def fit_increments(shifts: AxleShifts) -> IncrementFit:
    """Fit slope and intercept by least squares, each axle weighted with its own counting error, then shift as (15).

    The slope's error takes the correlation of the axles into account. It does not contain the bias: small counts enter (14)
    through a curved function (with 250 slides per lead axle and 64 axles: -0.8 %, half a standard error). Raises
    `EstimationError` where fewer than three axles carry information.
    """
    usable = np.flatnonzero(np.isfinite(shifts.shift))
    if usable.size < 3:
        raise EstimationError(
            f"increments: {usable.size} axles with a usable count; at least 3 are needed for a line through them"
        )
    log = np.log(usable + 1.0)
    weight = 1.0 / np.diag(shifts.covariance)[usable]
    centred = log - np.average(log, weights=weight)
    gain = weight * centred / (weight @ centred**2)
    slope = float(gain @ shifts.shift[usable])
    variance = gain @ shifts.covariance[np.ix_(usable, usable)] @ gain
    return IncrementFit(slope, -slope * LEAD_LOG_MEAN, float(np.sqrt(variance)), shifts.shift.size)


def unit_increments(per_axle: Floats, axle_unit: NDArray[np.int64]) -> Floats:
    """Increment of each traction unit over the foremost one: mean over its own axles minus that of unit 1, (units,).

    `axle_unit` (axles,): unit of each axle from the front, -1 for none; works for 1C4M, 1C2M and 1C1M alike.
    """
    units = int(axle_unit.max()) + 1
    mean = np.array([per_axle[axle_unit == j].mean() for j in range(units)])
    return mean - mean[0]


def conventional_increments(
    per_axle: Floats, speed: float, law: str = "curtius-kniffler"
) -> Floats:
    """Increments on a conventional line at `speed` [m/s], (axles,), from those of the Shinkansen.

    JP5484215 par. 0057 corrects (15) by the difference of the planned curves, which grows with speed, and prints no formula.
    The assumption here is that increments are a share of the coefficient, so they grow by the ratio of the curves. The lead
    car's mean stays zero, as (15) demands; a difference added to every axle would violate that.
    """
    if law not in SPEED_LAWS:
        raise EstimationError(
            f"increments: law = {law!r} is unknown; choose from {', '.join(SPEED_LAWS)}"
        )
    EstimationError.check("increments", {"speed": speed}, nonnegative=("speed",))
    conventional, shinkansen = (
        hyperbolic_speed_law(speed, *SPEED_LAWS[name]) for name in (law, "shinkansen")
    )
    return per_axle * (conventional / shinkansen)


# Increments that a train has learnt, from run to run: read from a recorded run, and stored in a file of the train.


DIRECTIONS = ("forward", "backward")
"""Running directions; each has its own increments, because another car leads."""


def learnt_in(run: xr.Dataset) -> LearntIncrements:
    """What the train has learnt by the end of a recorded run; raises `EstimationError` for a run without learning."""
    if "learnt_increment" not in run:
        raise EstimationError(
            'learning: nothing is learnt in this run; give [onboard.learning] kind = "running-mean" or "gaussian"'
        )
    return LearntIncrements(
        *(tuple(run[f"learnt_{name}"].values.tolist()) for name in Increments._fields)
    )


def save_learning(path: str | Path, train: str, learnt: dict[str, LearntIncrements]) -> None:
    """Save what a train has learnt, by running direction, in a JSON file; replaces the whole file."""
    path = Path(path)
    directions = {name: asdict(item) for name, item in learnt.items()}
    text = json.dumps({"train": train, "directions": directions}, indent=1)
    try:
        write_whole(path, lambda aside: aside.write_text(text, encoding="utf-8"))
    except OSError as error:
        raise EstimationError(
            f"learning file {str(path)!r} cannot be written: {error.strerror}"
        ) from None


def load_learning(path: str | Path, train: str) -> dict[str, LearntIncrements]:
    """What `train` has learnt, by running direction; empty if there is no file yet.

    Raises `EstimationError` for a file that belongs to another train or is not from `save_learning`.
    """
    path = Path(path)
    if not path.exists():
        return {}
    named = f"learning file {str(path)!r}"
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        owner, directions = content["train"], content["directions"]
        unknown = set(directions) - set(DIRECTIONS)
        if unknown:
            raise KeyError(*unknown)
        learnt = {
            name: LearntIncrements(**{key: tuple(values) for key, values in state.items()})
            for name, state in directions.items()
        }
    except (KeyError, TypeError, ValueError, AttributeError, OnboardError) as error:
        raise EstimationError(
            f"{named} is damaged ({type(error).__name__}: {error}); remove it to start anew"
        ) from None
    except OSError as error:
        raise EstimationError(f"{named} cannot be read: {error.strerror}") from None
    if owner != train:
        raise EstimationError(
            f"{named} belongs to train {owner!r}, not {train!r}; give another file"
        )
    return learnt
