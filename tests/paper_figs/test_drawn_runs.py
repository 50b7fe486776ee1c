"""Runs in pictures: axle maps, strips of units, replays, and the table beside a picture keep what is short."""

import hashlib
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from PIL import Image

from paper_figs.drawing import draw_run
from paper_figs.drawn_data import DOTS, MOST_CELLS, drawn_data, shown_points
from paper_figs.events import (
    MOST_COLUMNS,
    MOST_NAMES,
    SHOWN_UNITS,
    SLIP_SHADES,
    axle_map,
    name_units,
    shown_units,
    slip_event,
    use_of_units,
)
from paper_figs.replay import (
    INSTANTS,
    event_of,
    rail_found,
    shown_instants,
    slip_replay,
    with_slip_since,
)
from paper_figs.saving import Legend, Origin, data_of, save_image
from paper_figs.style import COLUMN, STYLE_FILE
from studies.report.replay import drawing
from studies.scenario.scenario import load_scenario
from studies.slides.jp4209318 import CALIBRATED as DEMONSTRATION
from studies.slides.jp4209318 import brake, brake_event
from tests.paper_figs.small_figures import runs
from tests.paper_figs.text_boxes import cut_off, overlapping, words_of

TIME = np.arange(0.0, 100.0, 0.01)


def drawn(time, values, *gather):
    axes = Figure().subplots()
    image = axle_map(axes, time, values, SLIP_SHADES, Normalize(0.0, 1.0), *gather)
    return axes, image, image.get_array()


def test_what_lasts_one_sample_is_kept_at_its_place():
    for gather, usual, short in ((np.fmax, 0.1, 0.9), (np.fmin, 0.3, 0.05)):
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
    values = np.random.default_rng(1).uniform(size=(40, 2))
    np.testing.assert_array_equal(drawn(TIME[:40], values)[2], values.T)  # few stay what they are


def test_a_gap_in_time_is_unknown_and_nothing_else_is():
    for jitter in (0.0, 0.002):
        time = np.concatenate([TIME[:3000], TIME[6000:]])
        time = time + np.random.default_rng(2).uniform(-jitter, jitter, time.size)
        _, image, shown = drawn(time, np.ones((time.size, 3)))
        unknown = np.ma.getmaskarray(shown).all(axis=0)
        left, right, *_ = image.get_extent()
        width = (right - left) / shown.shape[1]
        assert unknown.sum() == pytest.approx(30.0 / width, abs=2)
        assert (np.diff(unknown.astype(int)) != 0).sum() == 2  # one stretch


def test_units_are_named_at_their_axles_and_cover_nothing():
    def named(axles, units, shown):
        axes, *_ = drawn(TIME[:50], np.zeros((50, axles)))
        name_units(axes, np.array(units), shown)
        axis = axes.yaxis
        return axis, axis.get_major_locator()().tolist(), axis.get_major_formatter().seq

    axis, places, names = named(12, [-1, -1, 0, 0, 0, 0, 1, 1, 1, 1, -1, -1], [0, 1])
    wanted = {1.0: "1", 4.5: "unit 1: 3–6", 8.5: "unit 2: 7–10", 12.0: "12"}
    assert dict(zip(places, names, strict=True)) == wanted
    assert axis.get_minor_locator()().tolist() == [0.5, 2.5, 6.5, 10.5, 12.5]
    # the end of a train has no number where a unit is named
    *_, names = named(12, [0, 1, 1, 1, -1, -1, -1, -1, 2, 2, 2, 2], [0, 1, 2])
    assert names == ["unit 1: 1", "unit 2: 2–4", "unit 3: 9–12", "12"]
    # units in one car
    _, places, _ = named(26, [*range(6), *20 * [-1]], [0, 2, 4, 5])
    assert places[0] == 1.0
    assert (np.diff(places) >= 26 / MOST_NAMES).all()


def test_a_unit_uses_no_more_than_there_is_and_the_train_is_the_mean_by_load():
    for run in runs():
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
    # a long train has strips of some units only
    long = run.isel(unit=np.arange(40) % run.sizes["unit"])
    chosen = shown_units(long)
    assert len(chosen) == SHOWN_UNITS
    assert (chosen[0], chosen[-1]) == (0, 39)


def test_one_run_alone_fits_a_column_and_creep_is_not_drawn_as_spinning():
    """The darkest shade stands for the greatest slip, or for one at which a wheel spins."""
    run = runs()[0].copy()
    figure = slip_event(run)
    with mpl.rc_context(fname=STYLE_FILE):
        words = words_of(figure)
    assert figure.get_size_inches()[0] == COLUMN.value
    assert overlapping(words) == []
    assert cut_off(figure, words) == []
    for factor in (1.0, 1e-3):
        run["slip_velocity"] = factor * runs()[0]["slip_velocity"]
        slip = slip_event(run).axes[1].images[0]
        assert slip.norm.vmax == max(0.1, float(abs(run["slip_velocity"]).max()))


def test_a_run_without_motors_is_drawn(tmp_path):
    for cars in (1, 2):
        run = brake(replace(brake_event(DEMONSTRATION, cars), duration=3.0))
        draw_run(run, tmp_path / "run.png")
        assert (tmp_path / "run.png").stat().st_size > 10_000


@pytest.fixture(scope="module")
def train():
    return drawing(load_scenario("very-low-adhesion").event().model)


def test_the_rail_is_what_the_first_wheel_finds(train):
    def rail(place):
        return np.where((place > 5.0) & (place < 85.0), 0.1, 0.2)

    behind = np.asarray(train["axles"])
    position = np.linspace(0.0, 120.0, 4001)
    there = rail(position[:, None] - behind) * (1.0 + 0.01 * np.arange(behind.size))
    run = xr.Dataset({"position": ("time", position), "adhesion_limit": (("time", "axle"), there)})
    places, found = rail_found(run, train)
    # the first wheel comes to all that lies before it, the others to what lies below the train at first
    first = np.searchsorted(behind, -places).clip(max=behind.size - 1)
    edges = np.minimum(np.abs(places - 5.0), np.abs(places - 85.0)) < 0.1
    known = np.isfinite(found)
    assert not known[places > 120.0 - behind[0]].any()
    np.testing.assert_allclose(
        found[known & ~edges], (rail(places) * (1.0 + 0.01 * first))[known & ~edges], rtol=1e-6
    )
    assert known[places < 120.0 - behind[0]].all()


def test_no_slip_is_passed_over():
    event = event_of(runs()[0])
    chosen = shown_instants(event)
    held = with_slip_since(event, chosen)
    assert chosen.size <= INSTANTS
    assert (np.diff(chosen) > 0).all()
    assert chosen[-1] == event.time.size - 1
    assert held.worst[chosen].max() == event.worst[chosen[0] + 1 :].max()
    assert held.slip[chosen].max() == event.slip[chosen[0] + 1 :].max()


@pytest.fixture(scope="module")
def moving(train):
    return slip_replay(train, runs()[1])


def test_an_instant_shows_what_was_recorded_then(moving):
    run, motion = runs()[1], moving.motion
    for share in (0.0, 0.3, 1.0):
        instant = round(share * (motion.instants - 1))
        k = int(shown_instants(event_of(run))[instant])
        motion.show(instant)
        line, forces, *_ = moving.axes
        assert f"{float(run['time'][k]):4.1f} s" in line.get_title(loc="left")
        there, used = forces.containers[:2]
        limits = [one.get_ydata()[0] for one in forces.get_lines()]
        np.testing.assert_allclose(limits, run["limit"].values[k])
        for unit in range(run.sizes["unit"]):
            own = run["axle_unit"].values == unit
            load = run["axle_load"].values[k, own].sum()
            force = abs(run["rail_force"].values[k, own].sum())
            assert used[unit].get_height() == pytest.approx(force / load)
            assert there[unit].get_height() >= used[unit].get_height() - 1e-9


def test_the_file_has_every_instant_and_says_where_it_comes_from_as_other_formats_do(
    moving, tmp_path
):
    moving.motion = moving.motion._replace(instants=4, still=2)
    moving.motion.show(2)
    before = moving.axes[0].get_title(loc="left")
    origin = Origin("readhesion simulate — --seed 3", "one run", (3,), draft=True)
    legend = Legend(
        "replay", "a train slips", "First line.\n\nSecond line. " + 300 * "ü", (origin,)
    )
    data = data_of(moving)
    with mpl.rc_context(fname=STYLE_FILE):
        save_image(moving, tmp_path / "replay.gif", legend, data)
    assert moving.axes[0].get_title(loc="left") == before  # the figure stands as before
    with Image.open(tmp_path / "replay.gif") as image:
        assert (image.n_frames, image.size) == (4, (700, 700))
        assert image.info["loop"] == 0  # again and again
        told = dict(line.split(": ", 1) for line in image.info["comment"].decode().split("\n"))
    wanted = {key: " ".join(value.split()) for key, value in legend.fields(data).items()}
    assert told == wanted
    assert told["Data hash"] == f"sha256 {hashlib.sha256(data).hexdigest()}"
    assert told["Status"].startswith("draft: one run; in full: readhesion simulate —")


def walk(count, seed):
    rng = np.random.default_rng(seed)
    return np.sort(rng.uniform(-3.0, 40.0, count)), rng.normal(size=count).cumsum()


def test_each_column_keeps_its_ends_and_its_extremes():
    for seed in range(4):
        x, y = walk(50_000, seed)
        shown = shown_points(x, y)
        assert (np.diff(shown) > 0).all()
        assert shown.size <= 4 * DOTS
        column = np.minimum((x - x[0]) / (x[-1] - x[0]) * DOTS, DOTS - 1).astype(int)
        for one in np.unique(column):
            every, kept = np.flatnonzero(column == one), shown[column[shown] == one]
            assert {every[0], every[-1]} <= set(kept.tolist())
            assert (y[kept].min(), y[kept].max()) == (y[every].min(), y[every].max())
    # so what lasts one sample stays in the table
    axes = Figure().subplots()
    y = np.zeros(20_000)
    y[[7321, 15_000]] = 5.0, -4.0
    axes.plot(np.arange(y.size), y)
    table = drawn_data(axes.figure)
    assert len(table) <= 4 * DOTS
    assert table.loc[table["y"] != 0.0, ["x", "y"]].to_numpy().tolist() == [[7321.0, 5.0], [15_000.0, -4.0]]  # fmt: skip


def test_other_lines_stay_whole():
    for spoil in ("few", "back", "gap", "still"):
        x, y = walk(3000 if spoil == "few" else 9000, 7)
        if spoil == "back":
            x[5000] = x[0]
        elif spoil == "gap":
            y[5000] = np.nan
        elif spoil == "still":
            x[:] = 1.0
        assert shown_points(x, y).tolist() == list(range(x.size)), spoil


def test_an_area_is_told_by_its_two_edges_with_its_gaps():
    x = np.arange(5.0)
    for along, across in (("x", "y"), ("y", "x")):
        axes = Figure().subplots()
        fill = axes.fill_between if along == "x" else axes.fill_betweenx
        fill(x, x + 2.0, x**2, label="band")
        table = drawn_data(axes.figure)
        assert table["series"].unique().tolist() == ["band"]
        np.testing.assert_array_equal(table[along], x)
        np.testing.assert_array_equal(table[f"{across}_low"], np.minimum(x + 2.0, x**2))
        np.testing.assert_array_equal(table[f"{across}_high"], np.maximum(x + 2.0, x**2))
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
