"""Figures show what was computed, on axes that say what and in which unit, and look alike."""

import importlib
import pkgutil
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_hex
from PIL import Image

import paper_figs
from alloc.onboard.host import CONTROLLERS
from alloc.plant.adhesion import PiecewiseCurve
from alloc.rules import RULES
from paper_figs.adhesion import PEAK
from paper_figs.drawing import FIGURES, draw_comparison, draw_one, draw_run, save_figure
from paper_figs.events import slip_event
from paper_figs.rules import HIGH, LOW, SHOWN, allocate, caps
from paper_figs.saving import MovingFigure
from paper_figs.style import CONTROLLER_FILL, rule_colour
from studies.core.job import Job, simulate_job
from studies.files.study_error import StudyError
from studies.scenario.loading import load_scenario
from studies.slides.jp4209318 import CALIBRATED as DEMONSTRATION
from studies.slides.jp4209318 import brake, brake_event


def lines_of(axes):
    """Lines that carry data; error bars have theirs among them."""
    return [line for line in axes.get_lines() if len(line.get_xdata()) > 0]


def test_every_figure_of_the_register_has_its_function():
    for entry in FIGURES.values():
        assert callable(entry)
        assert len(entry.description) > 20


def test_a_share_in_percent_is_a_hundred_times_the_metric_and_all_else_the_metric_itself():
    """Of every panel of the figures and every column of the printed tables."""
    modules = [f"paper_figs.{one.name}" for one in pkgutil.iter_modules(paper_figs.__path__)]
    found = 0
    for name in (*modules, "studies.comparison.table"):
        for shown in vars(importlib.import_module(name)).values():
            for one in shown if isinstance(shown, tuple) else ():
                words = (
                    [word for word in one if isinstance(word, str)]
                    if isinstance(one, tuple)
                    else []
                )
                words += [one.heading] if hasattr(one, "heading") else []
                if words and hasattr(one, "factor"):
                    share = any("%" in word or "points" in word for word in words)
                    assert one.factor == (100.0 if share else 1.0), (name, one)
                    found += 1
    assert found > 45


@pytest.mark.parametrize("name", ["adhesion-curve", "slip-event", "slip-replay"])
def test_equal_figures_are_equal_files(drawn, name, tmp_path):
    """Of lines, of images, and of a figure that moves."""
    pdf, png, *beside = save_figure(drawn[name], tmp_path / name)
    assert pdf.read_bytes().startswith(b"%PDF")
    assert png.read_bytes().startswith(b"\x89PNG")
    again = save_figure(drawn[name], tmp_path / "again" / name)
    assert [pdf.read_bytes(), *(path.read_bytes() for path in beside)] == [
        path.read_bytes() for path in (again[0], *again[2:])
    ]


def test_every_rule_and_controller_has_a_look_of_its_own():
    for parts in (RULES, CONTROLLERS):
        assert len({part.colour for part in parts.values()}) == len(parts)
        assert len({part.marker for part in parts.values()}) == len(parts)
    assert set(CONTROLLER_FILL) < set(CONTROLLERS)
    assert len(set(CONTROLLER_FILL.values())) == len(CONTROLLER_FILL)


def test_a_rule_has_the_same_colour_in_every_figure(drawn, source):
    rules = list(dict.fromkeys(source.table["rule"]))[1:]
    compared = drawn["rule-comparison"]
    shown = {to_hex(line.get_color()) for axes in compared.axes for line in lines_of(axes)}
    assert {rule_colour(rule) for rule in rules} <= shown
    (legend,) = compared.legends
    of_label = {
        text.get_text(): to_hex(handle.get_color())
        for text, handle in zip(legend.get_texts(), legend.legend_handles, strict=True)
    }
    assert of_label == {rule: rule_colour(rule) for rule in rules}
    columns = drawn["allocation-bars"].axes[: len(SHOWN)]
    for rule, axes in zip(SHOWN, columns, strict=True):
        assert axes.get_title().startswith(f"{rule}\n")
        limits = [line for line in axes.get_lines() if line.get_gid()]
        assert {to_hex(line.get_color()) for line in limits} == {rule_colour(rule)}
    titles = [axes._left_title for axes in drawn["slip-event"].axes[:2]]
    assert [to_hex(t.get_color()) for t in titles] == [rule_colour("alone"), rule_colour("exact")]


def test_the_curve_drawn_is_the_plants(drawn):
    curve, left = PiecewiseCurve(), drawn["adhesion-curve"].axes[0]
    for line in left.get_lines()[:3]:
        slip, mu = line.get_xdata(), line.get_ydata()
        np.testing.assert_allclose(mu, curve.coefficient(np.asarray(slip), PEAK))
    peak, top = curve.limit(PEAK)
    marked = left.get_lines()[3]
    assert (marked.get_xdata()[0], marked.get_ydata()[0]) == (float(top), float(peak))


def test_the_dots_are_the_rules_answers_and_open_above_the_cap(drawn):
    for k, rule in enumerate(SHOWN):
        for row, found in enumerate((HIGH, LOW)):
            axes = drawn["allocation-bars"].axes[row * len(SHOWN) + k]
            dots = {line.get_gid(): line for line in axes.get_lines()}
            answer = allocate(rule, found).limit
            np.testing.assert_allclose(dots[f"limit of {rule}"].get_ydata(), answer)
            above = dots[f"limit of {rule} above the cap"]
            np.testing.assert_allclose(above.get_ydata(), answer[answer > caps(found) + 1e-9])
            assert above.get_markerfacecolor() == "white"


def test_the_log_is_drawn_with_its_gap_and_what_was_found(drawn, logged):
    log, found = logged
    axes = drawn["measured-log"].axes
    train = next(line for line in axes[0].get_lines() if line.get_label() == "train")
    assert np.isnan(train.get_ydata()).sum() == 1
    np.testing.assert_allclose(train.get_ydata()[:60], 3.6 * log.run.speed[:60])
    slips, coefficients, forces = (one for one in axes if one.get_images())
    shown = slips.get_images()[0].get_array()  # (axle, column)
    assert np.ma.is_masked(shown)  # in the gap
    assert shown.max() == pytest.approx(np.nanmax(np.abs(found.slip_velocity)))
    (rings,) = (line for line in slips.get_lines() if line.get_marker() == "o")
    assert sorted(rings.get_ydata()) == sorted(event.axle + 1 for event in found.events)
    assert coefficients.get_images()[0].get_array().shape[0] == log.train.radius.size
    drawn["measured-log"].draw_without_rendering()
    for one in (slips, coefficients, forces):  # the scale of each stands beside it
        scale = one.get_images()[0].colorbar.ax.get_position()
        assert scale.y0 == pytest.approx(one.get_position().y0, abs=0.01)
    force = forces.get_images()[0].get_array()
    assert force.max() == pytest.approx(1e-3 * np.nanmax(found.car_force))
    bars = next(one for one in axes if one.get_xlabel() == "Q [kJ]").containers[0]
    np.testing.assert_allclose([bar.get_width() for bar in bars], 1e-3 * found.axle_damage)


def test_high_and_low_adhesion_are_the_cases_that_the_figure_names():
    assert allocate("exact", HIGH).case == "B"
    assert allocate("exact", LOW).case == "A"


def test_the_event_shows_what_units_have_and_use(drawn, runs):
    rows = 2 + runs[0].sizes["unit"] + 1
    axes = np.reshape(drawn["slip-event"].axes[: 2 * rows], (rows, 2))
    for column, run in zip(axes.T, runs, strict=True):
        rail, slip = (one.get_images()[0].get_array() for one in column[:2])
        assert rail.min() == pytest.approx(run["adhesion_limit"].values.min())
        assert slip.max() == pytest.approx(np.abs(run["slip_velocity"].values).max())
        for unit, one in enumerate(column[2:-1]):
            own = run["axle_unit"].values == unit
            load = run["axle_load"].values[:, own].sum(axis=1)
            used = np.abs(run["rail_force"].values[:, own].sum(axis=1)) / load
            lines = {line.get_label(): np.asarray(line.get_ydata()) for line in one.get_lines()}
            np.testing.assert_allclose(lines["used"], used)
            np.testing.assert_allclose(lines["limit"], run["limit"].values[:, unit])
            (there,) = (one.get_paths()[0].vertices[:, 1].max() for one in one.collections)
            assert there >= used.max() - 1e-9  # nobody uses more than there is


def test_the_line_shows_the_run_below_what_is_permitted(drawn, line_run):
    permitted, speed = drawn["real-line"].axes[0].get_lines()[:2]
    np.testing.assert_allclose(speed.get_xdata(), 1e-3 * line_run.run["position"].values)
    np.testing.assert_allclose(speed.get_ydata(), 3.6 * line_run.run["speed"].values)
    allowed = np.interp(speed.get_xdata(), permitted.get_xdata(), permitted.get_ydata())
    assert (speed.get_ydata() - allowed).max() < 2.0  # between two points of the drawn curve


def test_stops_of_a_line_are_named_as_points_passed_are(line_run):
    stops = {one.point.name for one in line_run.stops}
    assert stops
    upper, strip, _ = FIGURES["real-line"](line_run).axes
    named = [text.get_text() for text in strip.texts]
    assert stops <= set(named)
    assert len(named) == len(set(named))
    assert not upper.texts  # no name lies over the curve of a braking train


def test_a_comparisons_figures_are_drawn_with_it(source, tmp_path):
    names = draw_comparison(source.table, source.store, tmp_path)
    assert names == [name for name, entry in FIGURES.items() if entry.of_comparison]
    assert {path.stem for path in tmp_path.iterdir()} == set(names)


def test_a_comparison_in_which_all_failed_has_no_figures(source, tmp_path):
    failed = source.table.assign(status="failed")
    assert draw_comparison(failed, source.store, tmp_path) == []


def test_one_run_is_drawn_alone(runs, tmp_path):
    draw_run(runs[0], tmp_path / "run.svg")
    assert "<svg" in (tmp_path / "run.svg").read_text()
    with pytest.raises(StudyError, match="'xyz' is not supported"):
        draw_run(runs[0], tmp_path / "run.xyz")


def test_a_folder_that_cannot_be_written_is_refused(drawn, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StudyError, match="cannot be written"):
        save_figure(drawn["adhesion-curve"], tmp_path / "file" / "figure")


def test_a_run_of_any_event_is_shown_as_it_happens(tmp_path, monkeypatch):
    """Train, rule, controller and seed are those of the job, and the file's ending says that the figure moves."""
    scenario = load_scenario("long-train").changed(duration_s=2.0)
    job = Job(scenario, "exact", "none", 3)
    run, shown = simulate_job(job), []
    monkeypatch.setattr(
        MovingFigure, "save_motion", lambda self, path, _: shown.append(self) or path.touch()
    )
    draw_run(run, tmp_path / "run.gif", job)
    (figure,) = shown
    line = figure.axes[0]
    cars = [patch for patch in line.patches if patch.get_y() > 0.0]
    assert len(cars) == len(scenario.event(3).model.train.cars)
    assert line.get_title(loc="left").startswith("exact, none: ")
    with pytest.raises(StudyError, match="not known of what event"):
        draw_run(run, tmp_path / "run.gif")
    with pytest.raises(StudyError, match="no motor"):
        draw_run(
            brake(replace(brake_event(DEMONSTRATION, 1), duration=1.0)), tmp_path / "run.gif", job
        )
    with pytest.raises(StudyError, match="does not move"):
        draw_one("allocation-bars", tmp_path / "bars.gif")


def test_a_runs_file_names_the_command_that_made_it(runs, tmp_path):
    job = Job(load_scenario("very-low-adhesion"), "alone", "cut-and-ramp", 4)
    for command, words in (
        ("", "simulate very-low-adhesion --rule alone"),
        ("readhesion simulate my/own.toml", "my/own.toml"),
    ):
        draw_run(runs[0], tmp_path / "run.png", job, command)
        source = Image.open(tmp_path / "run.png").text["Source"]
        assert words in source
        assert "seed 4" in source


def test_slip_that_is_no_more_than_creep_is_not_drawn_as_spinning(runs):
    """The darkest shade stands for the greatest slip, or for one at which a wheel spins."""
    run = runs[0].copy()
    for factor in (1.0, 1e-3):
        run["slip_velocity"] = factor * runs[0]["slip_velocity"]
        slip = slip_event(run).axes[1].images[0]
        assert slip.norm.vmax == max(0.1, float(abs(run["slip_velocity"]).max()))


@pytest.mark.parametrize("cars", [1, 2])
def test_a_run_without_motors_is_drawn(cars, tmp_path):
    run = brake(replace(brake_event(DEMONSTRATION, cars), duration=3.0))
    draw_run(run, tmp_path / "run.png")
    assert (tmp_path / "run.png").stat().st_size > 10_000
