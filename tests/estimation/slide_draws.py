"""Slide counts as the model of JP5484215 (14) has them: expected and drawn. The shipped table was made so."""

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from alloc.estimation.increments import SIGMA, SlideCounts


def slide_probability(
    shift: NDArray[np.float64], lead: NDArray[np.float64], sigma: float = SIGMA
) -> NDArray[np.float64]:
    """Slides of each axle over the lead car's mean, (14): Phi(-shift / sigma) over its mean for `lead`.

    `shift` (axles,), `lead` (any,): how much higher the mean coefficients lie than the planned one.
    """
    return np.asarray(norm.cdf(-shift / sigma) / norm.cdf(-lead / sigma).mean())


def draw_slide_counts(
    increments: NDArray[np.float64], slides_per_lead_axle: float, seed: int, sigma: float = SIGMA
) -> SlideCounts:
    """A synthetic table for axles with `increments` (axles,), drawn from (14): Poisson counts.

    `slides_per_lead_axle`: expected count of an axle at the planned coefficient, which fixes the sampling error.
    """
    expected = 2.0 * slides_per_lead_axle * norm.cdf(-np.asarray(increments) / sigma)
    slides = np.random.default_rng(seed).poisson(expected)
    source = (
        f"SYNTHETIC, drawn from JP5484215 (14): seed {seed}, {slides_per_lead_axle:g} slides expected of an axle at "
        f"the planned coefficient, standard deviation {sigma:g}"
    )
    return SlideCounts(slides, source)
