"""Slide counts to increments, within the sampling error that is stated; and what a train has learnt stays with it."""

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray
from scipy.stats import norm

from alloc.errors import EstimationError
from alloc.estimation.increments import (
    LEAD_LOG_MEAN,
    SIGMA,
    SYNTHETIC_TABLE,
    AxleShifts,
    SlideCounts,
    axle_shifts,
    conventional_increments,
    fit_increments,
    learnt_in,
    load_learning,
    read_slide_counts,
    save_learning,
    unit_increments,
)
from alloc.onboard.increment_learning import Increments, LearntIncrements
from alloc.plant.laws import hyperbolic_speed_law
from alloc.plant.rail import SPEED_LAWS, logarithmic_increments
from tests.cases import looped


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


SLOPE, OFFSET = 0.0083, -0.0066  # JP5484215 (15)


GROWTH = logarithmic_increments(64)


def test_a_lower_limit_of_zero_in_14_hardly_changes_the_increments():
    """JP5484215 par. 0054: coefficients are not negative, and the normal distribution is. Up to 270 km/h it is right."""
    for speed in (70.0, 160.0, 270.0):
        planned = hyperbolic_speed_law(speed / 3.6, *SPEED_LAWS["shinkansen"]) / SIGMA
        below = norm.cdf(-planned)
        assert below < 8e-4
        shift = np.array([0.0083 * np.log(j) - 0.0066 for j in range(1, 65)]) / SIGMA
        cut = (norm.cdf(-shift) - norm.cdf(-planned - shift)) / (0.5 - below)
        found = -SIGMA * norm.ppf(
            0.5 * cut
        )  # (14) with the printed limit, of frequencies that end at zero
        assert np.abs(found - SIGMA * shift).max() < 2e-4


def test_expected_counts_give_the_increments_back_exactly():
    # without sampling error only the lead car's mean, which is not quite the planned coefficient, shifts all alike
    expected = 1e9 * slide_probability(GROWTH, GROWTH[:4])
    shifts = axle_shifts(SlideCounts(expected.round()))
    common = shifts.shift - GROWTH
    assert np.ptp(common) < 2e-4
    assert abs(common.mean()) < 5e-4


def test_mean_slide_of_the_lead_car_is_one():
    assert slide_probability(GROWTH[:4], GROWTH[:4]).mean() == pytest.approx(1.0)


def test_stated_errors_are_those_of_repeated_counts():
    fits = [
        fit_increments(axle_shifts(draw_slide_counts(GROWTH, 250.0, seed))) for seed in range(300)
    ]
    slopes = np.array([fit.slope for fit in fits])
    stated = np.array([fit.slope_deviation for fit in fits])
    # 300 draws know a standard deviation to 4 %; linearisation and weighting with noisy counts cost a few more
    assert slopes.std() == pytest.approx(stated.mean(), rel=0.15)
    # the rear axles' few counts enter (14) through a curved function: the slope is 0.8 % low, half its standard error
    assert abs(slopes.mean() - SLOPE) < 0.7 * stated.mean()
    covered = np.abs(slopes - SLOPE) < 1.96 * stated
    assert 0.88 < covered.mean() < 0.99


def test_shipped_synthetic_table_recovers_the_printed_fit():
    counts = read_slide_counts(SYNTHETIC_TABLE)
    assert counts.source.startswith("SYNTHETIC")
    fit = fit_increments(axle_shifts(counts))
    assert abs(fit.slope - SLOPE) < 1.96 * fit.slope_deviation
    # the printed offset is rounded to four places
    assert abs(fit.offset - OFFSET) < 1.96 * fit.slope_deviation * LEAD_LOG_MEAN + 0.5e-4
    assert fit.slope_deviation < 0.1 * SLOPE


def test_shipped_table_is_what_its_seed_draws():
    counts = read_slide_counts(SYNTHETIC_TABLE)
    assert counts.slides.tolist() == draw_slide_counts(GROWTH, 250.0, seed=1).slides.tolist()


def test_offset_makes_the_lead_car_the_reference():
    fit = fit_increments(axle_shifts(read_slide_counts(SYNTHETIC_TABLE)))
    assert fit.increments()[:4].mean() == pytest.approx(0.0, abs=1e-15)


def test_band_holds_the_curve_and_is_narrowest_at_the_lead_car():
    fit = fit_increments(axle_shifts(read_slide_counts(SYNTHETIC_TABLE)))
    low, high = fit.band(0.95)
    curve = fit.increments()
    assert np.all((low <= curve) & (curve <= high))
    assert np.argmin(high - low) < 4
    wider = fit.band(0.99)
    assert np.all(wider[1] - wider[0] >= high - low)


def test_line_through_exact_shifts():
    shift = 0.01 * np.log(np.arange(1, 13)) + 0.003
    fit = fit_increments(AxleShifts(shift, 1e-8 * np.eye(12)))
    assert fit.slope == pytest.approx(0.01)
    assert fit.offset == pytest.approx(-0.01 * np.log([1, 2, 3, 4]).mean())


@looped("seed", [1, 2, 3])
def test_the_line_is_that_of_the_library_and_its_error_that_of_the_weighted_sums(seed):
    rng = np.random.default_rng(seed)
    root, log = rng.normal(size=(9, 9)), np.log(np.arange(1, 10))
    shifts = AxleShifts(0.01 * log + 0.01 * rng.normal(size=9), 1e-5 * (root @ root.T + np.eye(9)))
    fit = fit_increments(shifts)
    weight = 1.0 / np.sqrt(np.diag(shifts.covariance))
    assert fit.slope == pytest.approx(np.polyfit(log, shifts.shift, 1, w=weight)[0], rel=1e-9)
    # the slope is linear in the shifts: its weights are its values at unit shifts
    gain = [np.polyfit(log, one, 1, w=weight)[0] for one in np.eye(9)]
    assert fit.slope_deviation == pytest.approx(np.sqrt(gain @ shifts.covariance @ gain), rel=1e-9)


@looped(
    "axle_unit",
    [
        [-1, -1, -1, -1, 0, 0, 0, 0, 1, 1, 1, 1],  # 1C4M behind a trailer
        [0, 0, 1, 1, -1, -1, -1, -1, 2, 2, 3, 3],  # 1C2M
        [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11],  # 1C1M
    ],
)
def test_increment_of_a_unit_is_its_axles_mean_over_the_foremost_units(axle_unit):
    axle_unit = np.array(axle_unit)
    increments = unit_increments(GROWTH[:12], axle_unit)
    assert increments[0] == 0.0
    for j, value in enumerate(increments):
        assert value == pytest.approx(
            GROWTH[:12][axle_unit == j].mean() - GROWTH[:12][axle_unit == 0].mean()
        )


def test_conventional_correction_grows_with_speed_and_keeps_the_reference():
    slow, fast = (conventional_increments(GROWTH, v / 3.6) for v in (30.0, 130.0))
    assert np.all(np.abs(fast) >= np.abs(slow))
    assert slow[:4].mean() == pytest.approx(0.0, abs=5e-5)
    # by hand at 130 km/h: (7.5 / 174 + 0.161) / (13.6 / 215) = 3.227
    assert fast[63] / GROWTH[63] == pytest.approx((7.5 / 174 + 0.161) / (13.6 / 215))


def test_axles_without_information_are_left_out():
    slides = np.array([50, 48, 40, 40, 30, 0, 25, 200])
    shifts = axle_shifts(SlideCounts(slides))
    assert np.isnan(shifts.shift).tolist() == [False] * 5 + [True, False, True]
    assert np.isfinite(fit_increments(shifts).slope)


def test_table_reads_back(tmp_path):
    path = tmp_path / "counts.csv"
    path.write_text("# counted by hand\naxle,slides\n1,5\n2,4\n3,4\n4,6\n5,3\n", encoding="utf-8")
    counts = read_slide_counts(path)
    assert counts.slides.tolist() == [5, 4, 4, 6, 3]
    assert counts.source == "counted by hand"


@looped(
    ("text", "message"),
    [
        ("axle,slides\n1,5\n3,4\n", "line 3: axle 3 where 2 was due"),
        ("axle,slides\n1,5\n2,many\n", "line 3: '2,many' is no pair"),
        ("axle,count\n1,5\n", r"columns are \['axle', 'count'\]"),
        ("", r"columns are \[\]"),
        ("axle,slides\n1,5\n2,4\n", "more than 4 axles"),
        ("axle,slides\n1,0\n2,0\n3,0\n4,0\n5,1\n", "lead car never slid"),
        ("axle,slides\n1,5\n2,4\n3,3\n4,2\n5,-1\n", "axle 5 has -1"),
    ],
)
def test_bad_tables_are_refused(tmp_path, text, message):
    path = tmp_path / "counts.csv"
    path.write_text(text)
    with pytest.raises(EstimationError, match=message):
        read_slide_counts(path)


def test_bad_values_are_refused(tmp_path):
    with pytest.raises(EstimationError, match="cannot be read"):
        read_slide_counts(tmp_path / "none.csv")
    with pytest.raises(EstimationError, match="law = 'dry'"):
        conventional_increments(GROWTH, 10.0, "dry")
    with pytest.raises(EstimationError, match="speed = nan"):
        conventional_increments(GROWTH, float("nan"))
    with pytest.raises(EstimationError, match=r"axle 2 has 4.5; counts are whole"):
        SlideCounts(np.array([5, 4.5, 4, 4, 3]))
    with pytest.raises(EstimationError, match="at least 3"):
        fit_increments(axle_shifts(SlideCounts(np.array([10, 10, 0, 0, 0]))))


def test_band_by_hand():
    fit = fit_increments(AxleShifts(0.01 * np.log(np.arange(1, 13)), 1e-8 * np.eye(12)))
    low, high = fit.band(0.95)
    half = 1.959963984540054 * fit.slope_deviation * abs(np.log(12) - 0.7945134)
    assert high[11] - fit.increments()[11] == pytest.approx(half, rel=1e-6)
    assert fit.increments()[11] - low[11] == pytest.approx(half, rel=1e-6)
    # slope's error of equal and independent ones: theirs over the root of the squares of ln j about their mean
    log = np.log(np.arange(1, 13))
    assert fit.slope_deviation == pytest.approx(1e-4 / np.sqrt(np.sum((log - log.mean()) ** 2)))


def test_increments_of_units_may_be_negative():
    unit = np.array([0, 0, 1, -1, 2])
    per_axle = np.array([0.02, 0.04, 0.01, 0.9, 0.05])
    assert unit_increments(per_axle, unit) == pytest.approx([0.0, -0.02, 0.02])


def test_shift_and_error_of_an_axle_by_hand():
    """36 slides of 2 x 40: k = -Phi^-1(0.45); the count varies by its root, the lead car's 160 slides by theirs."""
    counts = SlideCounts(np.array([44, 40, 38, 38, 36]))
    shifts = axle_shifts(counts)
    assert shifts.shift[4] == pytest.approx(0.012 * 0.12566134685507416, rel=1e-12)
    density = np.exp(-0.5 * 0.12566134685507416**2) / np.sqrt(2 * np.pi)
    relative = np.sqrt(1 / 36 + 1 / 160)
    assert shifts.deviation[4] == pytest.approx(0.012 * 0.45 / density * relative, rel=1e-9)


LEARNT = LearntIncrements(
    (0.0, 0.011), (0.0, 0.004), (10.0, 25.0), (0.0, 0.013), (0.0, 1.0), (0.0, 3.0)
)


OTHER = LearntIncrements(*(tuple(0.1 / 3.0 for _ in range(4)) for _ in range(6)))


def test_a_file_keeps_everything(tmp_path):
    path = tmp_path / "learnt.json"
    save_learning(path, "train", {"forward": LEARNT, "backward": OTHER})
    assert load_learning(path, "train") == {"forward": LEARNT, "backward": OTHER}


def test_no_file_is_no_experience(tmp_path):
    assert load_learning(tmp_path / "none.json", "train") == {}


def test_a_run_says_what_is_known_by_its_end():
    run = xr.Dataset(
        {f"learnt_{name}": ("unit", np.array(getattr(LEARNT, name))) for name in Increments._fields}
    )
    assert learnt_in(run) == LEARNT
    with pytest.raises(EstimationError, match="nothing is learnt in this run"):
        learnt_in(xr.Dataset())


@looped(
    ("content", "message"),
    [
        ("{", "damaged"),
        ("[]", "damaged"),
        ('{"train": "train", "directions": {"up": {}}}', "damaged.*up"),
        ('{"train": "train", "directions": {"forward": {"magic": [1.0]}}}', "damaged.*magic"),
        ('{"train": "train", "directions": {"forward": {"increment": [0.0]}}}', "damaged"),
        ('{"train": "train", "directions": {"forward": 3}}', "damaged"),
        ('{"train": "other", "directions": {}}', "belongs to train 'other'"),
    ],
)
def test_bad_files_are_refused(tmp_path, content, message):
    path = tmp_path / "learnt.json"
    path.write_text(content)
    with pytest.raises(EstimationError, match=message):
        load_learning(path, "train")


def test_a_file_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(EstimationError, match="cannot be written"):
        save_learning(tmp_path / "no" / "learnt.json", "train", {})
