"""A replay shows the recorded run, no short slip is passed over, and its file has every instant."""

import hashlib

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr
from PIL import Image

from paper_figs.replay import (
    INSTANTS,
    event_of,
    rail_found,
    shown_instants,
    slip_replay,
    with_slip_since,
)
from paper_figs.saving import Legend, Origin, data_of, save_image
from paper_figs.style import STYLE_FILE
from studies.report.replay import drawing
from studies.scenario.loading import load_scenario


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


def test_no_slip_is_passed_over(runs):
    event = event_of(runs[0])
    chosen = shown_instants(event)
    held = with_slip_since(event, chosen)
    assert chosen.size <= INSTANTS
    assert (np.diff(chosen) > 0).all()
    assert chosen[-1] == event.time.size - 1
    assert held.worst[chosen].max() == event.worst[chosen[0] + 1 :].max()
    assert held.slip[chosen].max() == event.slip[chosen[0] + 1 :].max()


@pytest.fixture(scope="module")
def moving(train, runs):
    return slip_replay(train, runs[1])


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_an_instant_shows_what_was_recorded_then(moving, runs, share):
    run, motion = runs[1], moving.motion
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


def test_the_file_has_every_instant_and_the_figure_stands_as_before(moving, tmp_path):
    moving.motion = moving.motion._replace(instants=4, still=2)
    moving.motion.show(2)
    before = moving.axes[0].get_title(loc="left")
    with mpl.rc_context(fname=STYLE_FILE):
        moving.save_motion(tmp_path / "replay.gif")
    assert moving.axes[0].get_title(loc="left") == before
    with Image.open(tmp_path / "replay.gif") as image:
        assert (image.n_frames, image.size) == (4, (700, 700))
        assert image.info["loop"] == 0  # again and again


def test_the_file_says_where_it_comes_from_as_other_formats_do(moving, tmp_path):
    origin = Origin("readhesion simulate — --seed 3", "one run", (3,), draft=True)
    legend = Legend(
        "replay", "a train slips", "First line.\n\nSecond line. " + 300 * "ü", (origin,)
    )
    moving.motion = moving.motion._replace(instants=2, still=1)
    data = data_of(moving)
    with mpl.rc_context(fname=STYLE_FILE):
        save_image(moving, tmp_path / "replay.gif", legend, data)
    with Image.open(tmp_path / "replay.gif") as image:
        told = dict(line.split(": ", 1) for line in image.info["comment"].decode().split("\n"))
    wanted = {key: " ".join(value.split()) for key, value in legend.fields(data).items()}
    assert told == wanted
    assert told["Data hash"] == f"sha256 {hashlib.sha256(data).hexdigest()}"
    assert told["Status"].startswith("draft: one run; in full: readhesion simulate —")
