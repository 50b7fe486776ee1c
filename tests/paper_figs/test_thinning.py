"""The table beside a figure is no longer than what the picture shows, and nothing that shows is lost."""

import numpy as np
import pytest
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from paper_figs.drawn_data import DOTS, MOST_CELLS, drawn_data, shown_points
from paper_figs.events import SLIP_SHADES, axle_map


def walk(count, seed):
    rng = np.random.default_rng(seed)
    return np.sort(rng.uniform(-3.0, 40.0, count)), rng.normal(size=count).cumsum()


@pytest.mark.parametrize("seed", range(4))
def test_each_column_keeps_its_ends_and_its_extremes(seed):
    x, y = walk(50_000, seed)
    shown = shown_points(x, y)
    assert (np.diff(shown) > 0).all()
    assert shown.size <= 4 * DOTS
    column = np.minimum((x - x[0]) / (x[-1] - x[0]) * DOTS, DOTS - 1).astype(int)
    for one in np.unique(column):
        every, kept = np.flatnonzero(column == one), shown[column[shown] == one]
        assert {every[0], every[-1]} <= set(kept.tolist())
        assert (y[kept].min(), y[kept].max()) == (y[every].min(), y[every].max())


def test_what_lasts_one_sample_stays_in_the_table():
    axes = Figure().subplots()
    y = np.zeros(20_000)
    y[[7321, 15_000]] = 5.0, -4.0
    axes.plot(np.arange(y.size), y)
    table = drawn_data(axes.figure)
    assert len(table) <= 4 * DOTS
    assert table.loc[table["y"] > 0.0, ["x", "y"]].to_numpy().tolist() == [[7321.0, 5.0]]
    assert table.loc[table["y"] < 0.0, ["x", "y"]].to_numpy().tolist() == [[15_000.0, -4.0]]


@pytest.mark.parametrize("spoil", ["few", "back", "gap", "still"])
def test_other_lines_stay_whole(spoil):
    x, y = walk(3000 if spoil == "few" else 9000, 7)
    if spoil == "back":
        x[5000] = x[0]
    elif spoil == "gap":
        y[5000] = np.nan
    elif spoil == "still":
        x[:] = 1.0
    assert shown_points(x, y).tolist() == list(range(x.size))


@pytest.mark.parametrize("along", ["x", "y"])
def test_an_area_is_told_by_its_two_edges(along):
    axes = Figure().subplots()
    x = np.arange(5.0)
    fill = axes.fill_between if along == "x" else axes.fill_betweenx
    fill(x, x + 2.0, x**2, label="band")
    table, across = drawn_data(axes.figure), "y" if along == "x" else "x"
    assert table["series"].unique().tolist() == ["band"]
    np.testing.assert_array_equal(table[along], x)
    np.testing.assert_array_equal(table[f"{across}_low"], np.minimum(x + 2.0, x**2))
    np.testing.assert_array_equal(table[f"{across}_high"], np.maximum(x + 2.0, x**2))


def test_an_area_with_a_gap_and_a_long_one():
    axes = Figure().subplots()
    x = np.arange(9.0)
    axes.fill_between(x, 0.0, 1.0, where=(x < 3) | (x > 5))
    assert drawn_data(axes.figure)["x"].tolist() == [0.0, 1.0, 2.0, 6.0, 7.0, 8.0]
    axes = Figure().subplots()
    x, y = walk(30_000, 8)
    axes.fill_between(x, y - 1.0, y + 1.0)
    table = drawn_data(axes.figure)
    assert len(table) <= 8 * DOTS
    assert (table["y_low"].min(), table["y_high"].max()) == (y.min() - 1.0, y.max() + 1.0)


def test_a_map_is_told_in_stretches_of_one_shade():
    """Every known cell lies in one stretch of its row, whose value has the cell's shade and is their mean."""
    rng = np.random.default_rng(9)
    values = np.repeat(rng.uniform(0.0, 2.0, (50, 16)), 8, axis=0)
    values += rng.uniform(0.0, 1e-5, values.shape)
    values[100:140, 3] = np.nan
    axes = Figure().subplots()
    image = axle_map(
        axes, np.arange(values.shape[0]) * 0.1, values, SLIP_SHADES, Normalize(0.0, 2.0)
    )
    cells = np.ma.filled(image.get_array(), np.nan)
    assert cells.size > MOST_CELLS
    table = drawn_data(axes.figure)
    assert len(table) < 0.4 * cells.size
    left, right, *_ = image.get_extent()
    middle = left + (np.arange(cells.shape[1]) + 0.5) * (right - left) / cells.shape[1]
    for axle, own in enumerate(cells, 1):
        rows = table[table["y"] == axle]
        inside = (middle[:, None] > rows["x_low"].to_numpy()) & (
            middle[:, None] < rows["x_high"].to_numpy()
        )
        assert (inside.sum(axis=1) == np.isfinite(own)).all()
        told = (inside * rows["value"].to_numpy()).sum(axis=1)
        known = np.isfinite(own)
        assert np.abs(told - own)[known].max() <= 2.0 / SLIP_SHADES.N
        assert told[known].sum() == pytest.approx(own[known].sum())


def test_a_small_picture_has_every_cell():
    axes = Figure().subplots()
    axes.imshow(np.eye(5))
    table = drawn_data(axes.figure)
    assert len(table) == 25
    assert table["value"].sum() == 5.0
