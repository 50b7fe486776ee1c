"""Pictures of all axles keep what is short, leave gaps open, and stand where time and axle are."""

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from paper_figs.events import (
    MOST_COLUMNS,
    MOST_NAMES,
    SHOWN_UNITS,
    SLIP_SHADES,
    axle_map,
    draw_use,
    name_units,
    shown_units,
    slip_event,
    use_of_units,
)
from paper_figs.style import COLUMN, STYLE_FILE
from tests.paper_figs.text_boxes import cut_off, overlapping, words_of

TIME = np.arange(0.0, 100.0, 0.01)


def drawn(time, values, *gather):
    axes = Figure().subplots()
    image = axle_map(axes, time, values, SLIP_SHADES, Normalize(0.0, 1.0), *gather)
    return axes, image, image.get_array()


@pytest.mark.parametrize(("gather", "usual", "short"), [(np.fmax, 0.1, 0.9), (np.fmin, 0.3, 0.05)])
def test_what_lasts_one_sample_is_kept_at_its_place(gather, usual, short):
    values = np.full((TIME.size, 5), usual)
    values[7321, 3] = short
    _, image, shown = drawn(TIME, values, gather)
    assert shown.shape == (5, MOST_COLUMNS)
    row, column = np.argwhere(shown == short)[0]
    left, right, bottom, top = image.get_extent()
    width = (right - left) / MOST_COLUMNS
    assert left + column * width <= TIME[7321] < left + (column + 1) * width
    assert (row, top, bottom) == (3, 0.5, 5.5)  # the foremost axle is uppermost
    assert (shown != usual).sum() == 1


def test_few_samples_stay_what_they_are():
    values = np.random.default_rng(1).uniform(size=(40, 2))
    _, _, shown = drawn(TIME[:40], values)
    np.testing.assert_array_equal(shown, values.T)


@pytest.mark.parametrize("jitter", [0.0, 0.002])
def test_a_gap_in_time_is_unknown_and_nothing_else_is(jitter):
    time = np.concatenate([TIME[:3000], TIME[6000:]])
    time = time + np.random.default_rng(2).uniform(-jitter, jitter, time.size)
    _, image, shown = drawn(time, np.ones((time.size, 3)))
    unknown = np.ma.getmaskarray(shown).all(axis=0)
    left, right, *_ = image.get_extent()
    width = (right - left) / shown.shape[1]
    assert unknown.sum() == pytest.approx(30.0 / width, abs=2)
    assert (np.diff(unknown.astype(int)) != 0).sum() == 2  # one stretch


def test_units_are_named_at_their_axles():
    axes, *_ = drawn(TIME[:50], np.zeros((50, 12)))
    name_units(axes, np.array([-1, -1, 0, 0, 0, 0, 1, 1, 1, 1, -1, -1]), [0, 1])
    named = dict(
        zip(
            axes.yaxis.get_major_locator()().tolist(),
            axes.yaxis.get_major_formatter().seq,
            strict=True,
        )
    )
    assert named == {1.0: "1", 4.5: "unit 1: 3–6", 8.5: "unit 2: 7–10", 12.0: "12"}
    assert axes.yaxis.get_minor_locator()().tolist() == [0.5, 2.5, 6.5, 10.5, 12.5]


def test_the_end_of_a_train_has_no_number_where_a_unit_is_named():
    axes, *_ = drawn(TIME[:50], np.zeros((50, 12)))
    name_units(axes, np.array([0, 1, 1, 1, -1, -1, -1, -1, 2, 2, 2, 2]), [0, 1, 2])
    assert axes.yaxis.get_major_formatter().seq == [
        "unit 1: 1",
        "unit 2: 2–4",
        "unit 3: 9–12",
        "12",
    ]


def test_a_unit_uses_no_more_than_there_is_and_the_train_is_the_mean_by_load(runs):
    for run in runs:
        units = list(range(run.sizes["unit"]))
        each, whole = [use_of_units(run, [unit]) for unit in units], use_of_units(run, units)
        load = np.stack(
            [run["axle_load"].values[:, run["axle_unit"].values == j].sum(axis=1) for j in units]
        )
        for name in ("used", "available"):
            mean = (np.stack([getattr(one, name) for one in each]) * load).sum(axis=0)
            # forces of one direction add up
            np.testing.assert_allclose(getattr(whole, name), mean / load.sum(axis=0), atol=1e-3)
        for one in (*each, whole):
            assert (one.used <= one.available + 1e-9).all()


def test_a_long_train_has_strips_of_some_units_only(runs):
    long = runs[0].isel(unit=np.arange(40) % runs[0].sizes["unit"])
    chosen = shown_units(long)
    assert len(chosen) == SHOWN_UNITS
    assert (chosen[0], chosen[-1]) == (0, 39)


def test_a_strip_is_the_run(runs):
    axes, use = Figure().subplots(), use_of_units(runs[0], [1])
    draw_use(axes, use, "black")
    lines = {line.get_label(): line.get_ydata() for line in axes.get_lines()}
    np.testing.assert_array_equal(lines["limit"], runs[0]["limit"].values[:, 1])
    np.testing.assert_array_equal(lines["used"], use.used)


def test_names_of_units_in_one_car_do_not_cover_each_other():
    axes, *_ = drawn(TIME[:50], np.zeros((50, 26)))
    name_units(axes, np.array([*range(6), *20 * [-1]]), [0, 2, 4, 5])
    places = axes.yaxis.get_major_locator()()
    assert places[0] == 1.0
    assert (np.diff(places) >= 26 / MOST_NAMES).all()


def test_one_run_alone_fits_a_column(runs):
    figure = slip_event(runs[0])
    with mpl.rc_context(fname=STYLE_FILE):
        words = words_of(figure)
    assert figure.get_size_inches()[0] == COLUMN.value
    assert overlapping(words) == []
    assert cut_off(figure, words) == []
