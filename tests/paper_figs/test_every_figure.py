"""Every figure, laid out once: it can be read as printed, shows what was computed, and looks as when last looked at."""

import io
import re
from collections import defaultdict
from functools import partial

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.testing.compare import calculate_rms

from alloc.onboard.host import CONTROLLERS
from alloc.plant.adhesion import PiecewiseCurve
from paper_figs import controllers, rules
from paper_figs.adhesion import PEAK
from paper_figs.brakes import ACCUSED, FAULT
from paper_figs.controllers import SEEKING
from paper_figs.drawing import FIGURES, Source
from paper_figs.drawn_data import drawn_data
from paper_figs.model import PLAN
from paper_figs.patent import LEARNERS, LOOKS, claim_verdicts, claim_verdicts_search, learning
from paper_figs.readhesion_paper import on_coefficient_scale, width_sweep
from paper_figs.rules import (
    HIGH,
    LOW,
    NO_EVENT,
    NO_PAIRS,
    SHOWN,
    allocate,
    caps,
    differences,
    rule_comparison,
    rule_events,
)
from paper_figs.style import BETTER, COLUMN, NOTE, STYLE_FILE, Width, new_figure, rule_colour
from studies.brake_force.study import CUT_OUT
from studies.comparison.pooled import ALL, pooled
from studies.comparison.summary import EFFORT, MOST_OVER, REFERENCE, summarise
from studies.core.drawn_events import COMPARED, Arm
from studies.core.statement import FAILS, HOLDS, LEAST_SHOWN
from studies.core.store import Store
from studies.files.study_error import StudyError
from studies.ladder.equal_effort_study import MPC, PRICES, SEARCH
from studies.ladder.mismatch_study import GIVEN, NOISES, RAILS
from studies.patent.claims_study import CLAIM_STUDY, LAYERS
from studies.patent.learning_study import TOLERANCE as LEARNT_WITHIN
from studies.patent.robustness_study import CONTROLLERS as CONTROLLERS_MET
from studies.patent.robustness_study import LOSSES
from studies.patent.robustness_study import NOISES as NOISES_MET
from studies.readhesion_paper.paper import DROP, RECOVERY
from tests.docs.pages import PAGES
from tests.paper_figs import small_figures
from tests.paper_figs.small_figures import DPI, DRAWN, TABLES, from_tables, pixels, without_letters
from tests.paper_figs.text_boxes import cut_off, overlapping, words_of
from tests.studies.brake_tables import brake_table
from tests.studies.made_tables import RULES as RULES_COMPARED
from tests.studies.made_tables import comparison_table, falling, limit_of, sweep_table
from tests.studies.made_tables import synthetic as learning_table
from tests.studies.sweep_tables import claim_table, difference_table

TOLERANCE = 1.0
"""Root mean square over all pixels, of 255; a mark that moves by its own width gives more."""
BODY = 7.0
"""Size of type [points] of a figure as printed."""
UNIT = re.compile(r"\[(–|%|s|m|km|m/s|m/s²|m/s³|ms|km/h|km/h/s|N m|kN|kPa|kJ|‰)\]$")
COUNTED = {
    "unit", "event", "solver", "car (1 = foremost)", "axle from the front", "stations", "adhesion curve",
    "first half ahead of car", "second half ahead of car",
}  # fmt: skip
"""Labels of axes that count things, which have no unit."""
STORED = {
    name: pytest.mark.mpl_image_compare(
        baseline_dir="pictures", filename=f"{name}.png", style=str(STYLE_FILE),
        tolerance=TOLERANCE, savefig_kwargs={"dpi": DPI},
    )
    for name in TABLES
}  # fmt: skip
LAWS = defaultdict(list)
"""Figure -> what it alone must show, each a function of it."""


def law(*names):
    """Register a law of figures, which is checked where the figure is laid out."""

    def register(function):
        for name in names:
            LAWS[name].append(function)
        return function

    return register


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=STORED.get(name, ())) for name in FIGURES]
)
def test_figure(name):
    figure = from_tables(name) if name in TABLES else DRAWN[name]()
    with mpl.rc_context(fname=STYLE_FILE):  # as files are written
        words = words_of(figure)
        whole = figure.get_tightbbox()
    fits_its_page(figure, whole)
    says_quantity_and_unit(figure)
    sizes = {round(one.size, 2) for one in words}
    assert sizes <= {NOTE, BODY}
    assert BODY in sizes
    assert overlapping(words) == []
    assert cut_off(figure, words) == []
    its_numbers_are_written(figure)
    for check in LAWS[name]:
        check(figure)
    return without_letters(figure) if name in TABLES else None


def fits_its_page(figure, whole):
    width, height = figure.get_size_inches()
    assert width in {one.value for one in Width}
    assert height <= 10.0
    assert min(whole.x0, whole.y0) >= -0.01
    assert whole.x1 <= width + 0.01
    assert whole.y1 <= height + 0.01


def says_quantity_and_unit(figure):
    labels = [
        label
        for axes in figure.axes
        if axes.get_visible()
        for label in (axes.get_xlabel(), axes.get_ylabel())
        if label
    ]
    assert len(labels) >= 2
    assert [one for one in labels if not (UNIT.search(one) or one in COUNTED)] == []


def its_numbers_are_written(figure):
    table = pd.read_csv(io.StringIO(drawn_data(figure).to_csv(index=False)), low_memory=False)
    assert len(table) >= 8
    assert table["panel"].nunique() >= 1
    assert table.drop(columns=["panel", "kind"]).notna().any(axis="columns").all()


def lines_of(axes):
    """Lines that carry data; error bars have theirs among them."""
    return [line for line in axes.get_lines() if len(line.get_xdata()) > 0]


def data(line):
    return np.asarray(line.get_xdata(), dtype=float), np.asarray(line.get_ydata(), dtype=float)


@law("rule-comparison")
def its_marks_are_the_pooled_differences_and_its_dots_the_events(figure):
    lines = summarise(small_figures.six_events())
    means, data = pooled(lines), drawn_data(figure)
    shown = {
        "bound_use": (100.0, 1),
        "over_delivery": (100.0, -1),
        "damage": (1.0, -1),
        "jerk_rms": (1.0, -1),
    }
    for k, (metric, (factor, better)) in enumerate(shown.items()):
        axes, own = figure.axes[k], data[data["panel"] == list(dict.fromkeys(data["panel"]))[k]]
        marks = own[own["kind"] == "mean"]
        meant = {(one.rule, *(round(factor * end, 9) for end in (d.value, d.low, d.high)))
                 for one in means if one.differences for d in [one.differences[metric]]}  # fmt: skip
        numbers = marks[["x", "x_low", "x_high"]].round(9).itertuples(index=False, name=None)
        assert {(rule, *ends) for rule, ends in zip(marks["series"], numbers, strict=True)} == meant
        dots = own[own["series"].fillna("").str.endswith(", an event")]
        each = [factor * one.differences[metric].value for one in lines if one.differences]
        np.testing.assert_allclose(sorted(dots["x"]), sorted(each), atol=1e-9)
        low, high = axes.get_xlim()
        tinted = [patch for patch in axes.patches if to_hex(patch.get_facecolor()) == BETTER]
        ends = [end for one in tinted for end in (one.get_x(), one.get_x() + one.get_width())]
        assert ends == pytest.approx([0.0, high] if better > 0 else [low, 0.0])
    colours = {
        line.get_gid(): to_hex(line.get_color())
        for line in lines_of(figure.axes[0])
        if line.get_gid()
    }
    rules = {rule for rule in RULES_COMPARED if rule != REFERENCE}
    rows = [text.get_text() for text in figure.axes[0].get_yticklabels()]
    gains = [RULES_COMPARED[rule] for rule in rows]
    assert set(rows) == rules
    assert gains == sorted(gains, reverse=True)
    assert {rule: colours[rule] for rule in rules} == {rule: rule_colour(rule) for rule in rules}


@law("rule-events")
def its_cells_are_the_gains_and_white_where_they_are_open(figure):
    lines = summarise(small_figures.six_events())
    for axes, controller in zip(figure.axes, ("cut-and-ramp", "mpc"), strict=True):
        rules = [text.get_text() for text in figure.axes[-1].get_xticklabels()]
        rows = [text.get_text() for text in axes.get_yticklabels()]
        assert rows[0] == ALL
        words = {tuple(map(round, text.get_position())): text.get_text() for text in axes.texts}
        cells = {
            (round(one.get_x() + 0.48), round(one.get_y() + 0.46)): one for one in axes.patches
        }
        for line in (*pooled(lines), *lines):
            found = line.differences.get(EFFORT)
            if found is None or line.controller != controller:
                continue
            place = rules.index(line.rule), rows.index(line.scenario)
            over = "*" if line.over > MOST_OVER else ""
            assert words[place].replace("\N{MINUS SIGN}", "-") == f"{100 * found.value:+.1f}{over}"
            white = found.count >= LEAST_SHOWN and found.low <= 0.0 <= found.high
            assert (to_hex(cells[place].get_facecolor()) == "#ffffff") == white
        assert len(words) == len(rules) * len(rows)
    assert any(
        "*" in text.get_text() for text in figure.axes[0].texts
    )  # greedy in the second event


@law("allocation-bars")
def its_dots_are_the_rules_answers_and_open_above_the_cap(figure):
    for k, rule in enumerate(SHOWN):
        assert figure.axes[k].get_title().startswith(f"{rule}\n")
        for row, (found, case) in enumerate(((HIGH, "B"), (LOW, "A"))):
            axes = figure.axes[row * len(SHOWN) + k]
            dots = {line.get_gid(): line for line in axes.get_lines()}
            limits = {to_hex(line.get_color()) for gid, line in dots.items() if gid}
            assert limits == {rule_colour(rule)}
            answer = allocate(rule, found).limit
            np.testing.assert_allclose(dots[f"limit of {rule}"].get_ydata(), answer)
            above = dots[f"limit of {rule} above the cap"]
            np.testing.assert_allclose(above.get_ydata(), answer[answer > caps(found) + 1e-9])
            assert above.get_markerfacecolor() == "white"
            assert allocate("exact", found).case == case  # which the figure names


@law("model")
def its_limits_make_up_for_what_the_wet_unit_lacks(figure):
    rail = figure.axes[1]
    peaks = np.concatenate([data(line)[1] for line in rail.get_lines()[:2]])
    (limits,) = (box.lines[2][0].get_segments() for box in rail.containers)
    limit = np.array([ends[0][1] for ends in limits])
    assert limit.mean() == pytest.approx(PLAN)
    assert limit[0] == pytest.approx(peaks.min())  # the wet unit's weakest axle
    assert len(set(limit[1:])) == 1


@law("adhesion-curve")
def its_curve_is_the_plants(figure):
    curve, left = PiecewiseCurve(), figure.axes[0]
    for line in left.get_lines()[:3]:
        slip, mu = line.get_xdata(), line.get_ydata()
        np.testing.assert_allclose(mu, curve.coefficient(np.asarray(slip), PEAK))
    peak, top = curve.limit(PEAK)
    marked = left.get_lines()[3]
    assert (marked.get_xdata()[0], marked.get_ydata()[0]) == (float(top), float(peak))


@law("measured-log")
def its_log_has_its_gap_and_what_was_found(figure):
    log, found = small_figures.logged()
    axes = figure.axes
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
    for one in (slips, coefficients, forces):  # the scale of each stands beside it
        scale = one.get_images()[0].colorbar.ax.get_position()
        assert scale.y0 == pytest.approx(one.get_position().y0, abs=0.01)
    force = forces.get_images()[0].get_array()
    assert force.max() == pytest.approx(1e-3 * np.nanmax(found.car_force))
    bars = next(one for one in axes if one.get_xlabel() == "Q [kJ]").containers[0]
    np.testing.assert_allclose([bar.get_width() for bar in bars], 1e-3 * found.axle_damage)


@law("slip-event")
def it_shows_what_units_have_and_use(figure):
    runs = small_figures.runs()
    titles = [axes._left_title for axes in figure.axes[:2]]
    assert [to_hex(t.get_color()) for t in titles] == [rule_colour("alone"), rule_colour("exact")]
    units = [0, runs[0].sizes["unit"] - 1]
    rows = 2 + len(units) + 1
    axes = np.reshape(figure.axes[: 2 * rows], (rows, 2))
    for column, run in zip(axes.T, runs, strict=True):
        rail, slip = (one.get_images()[0].get_array() for one in column[:2])
        assert rail.min() == pytest.approx(run["adhesion_limit"].values.min())
        assert slip.max() == pytest.approx(np.abs(run["slip_velocity"].values).max())
        for unit, one in zip(units, column[2:-1], strict=True):
            own = run["axle_unit"].values == unit
            load = run["axle_load"].values[:, own].sum(axis=1)
            used = np.abs(run["rail_force"].values[:, own].sum(axis=1)) / load
            lines = {line.get_label(): np.asarray(line.get_ydata()) for line in one.get_lines()}
            np.testing.assert_allclose(lines["used"], used)
            np.testing.assert_allclose(lines["limit"], run["limit"].values[:, unit])
            (there,) = (one.get_paths()[0].vertices[:, 1].max() for one in one.collections)
            assert there >= used.max() - 1e-9  # nobody uses more than there is


@law("mismatch")
def its_lines_are_differences_over_the_noise_and_its_cells_the_given_slips(figure):
    """In the made-up table every MPC uses two points more than cut-and-ramp, whose 90 % all others have."""
    used, cells = figure.axes[: len(RAILS)], figure.axes[-1]
    for axes in used:
        lines = {
            line.get_gid(): data(line)
            for line in axes.get_lines()
            if line.get_gid() and len(line.get_xdata()) > 1
        }
        assert set(lines) == {one.name for one in SEEKING}
        for name, (noise, gain) in lines.items():
            np.testing.assert_allclose(noise, NOISES, atol=2e-3)
            np.testing.assert_allclose(gain, 2.0 * name.startswith("mpc"), atol=1e-9)
    assert [round(float(text.get_text())) for text in cells.texts] == [92] * len(RAILS) * len(GIVEN)
    assert all(
        one.get_facecolor()[2] > one.get_facecolor()[0] for one in cells.patches
    )  # blue: better


@law("robustness")
def its_lines_are_the_means_and_its_gains_are_paired(figure):
    """Noise makes all alike worse, so a gain is that of the table at every noise, and its interval leaves the days out."""
    data = drawn_data(figure)
    means = data[data["kind"] == "mean"]
    gains = means[means["panel"].str[0].astype(int) > len(CONTROLLERS_MET)]
    assert len(gains) == len(means) / 2 == len(CONTROLLERS_MET) * len(LOSSES) * len(NOISES_MET)
    lost = gains["series"].str.extract(r"(\d+) %").astype(float)[0] / 100.0
    np.testing.assert_allclose(gains["y"], 2.0 - 0.1 * lost / LOSSES[-1], atol=0.15)
    assert (gains["y_high"] - gains["y_low"]).max() < 0.3
    used = means.drop(gains.index)
    assert (used["y_high"] - used["y_low"]).min() > 0.3  # the days


@law("equal-effort")
def its_searches_are_points_and_its_lines_fall_with_effort(figure):
    """In the made-up table the MPC under wear is on the search's effort at the chosen price, with a tenth less damage."""
    found = drawn_data(figure)
    means = found[found["kind"] == "mean"]
    damage = means[means["panel"].str.startswith("1")]
    line = damage[damage["series"] == f"wear, {MPC}"].sort_values("x")
    assert len(line) == len(PRICES)
    assert line["y"].is_monotonic_increasing
    np.testing.assert_allclose(
        line.loc[line["x"].abs().idxmin(), ["x", "y"]].astype(float), (0.0, -10.0), atol=0.5
    )
    assert len(damage[damage["series"] == f"wear, {SEARCH}"]) == 1


@law("mpc-times")
def its_solvers_are_in_order_and_its_lines_reach_the_slow_periods(figure):
    times = small_figures.solver_times().sort_values("time")
    data = drawn_data(figure)
    for solver, (median, most) in zip(times.index, times.to_numpy(), strict=True):
        line = data[data["series"] == f"{solver}, median to 99 %"]
        assert sorted(line["x"]) == [median, most]
        assert set(line["place"]) == {solver}
    assert [text.get_text() for text in figure.axes[0].get_yticklabels()] == list(times.index)


@law("adhesion-drop")
def its_paths_begin_on_the_curve_before_the_drop_and_end_on_the_lower_one(figure):
    runs, curve = small_figures.drops(), small_figures.curve_of(small_figures.DROP_EVENT)
    used, _, slips, _, torques, _ = figure.axes
    (there,) = (one.get_paths()[0].vertices[:, 1] for one in used.collections)
    for run, name, path in zip(runs, small_figures.DROPPED, figure.axes[1::2], strict=True):
        lines = [
            next(line for line in one.get_lines() if line.get_gid() == name)
            for one in (used, slips, torques)
        ]
        assert {to_hex(line.get_color()) for line in lines} == {CONTROLLERS[name].colour}
        shown = np.isin(run["time"].values, data(lines[0])[0])
        axle = int(np.flatnonzero(run["axle_unit"].values == 0)[0])
        slip = run["slip_velocity"].values[shown, axle]
        np.testing.assert_array_equal(data(lines[1])[1], slip)
        np.testing.assert_array_equal(data(lines[2])[1], run["motor_torque"].values[shown, 0])
        assert data(lines[0])[1].max() <= there.max()
        (own,) = (line for line in path.get_lines() if line.get_gid() == name)
        along, force = data(own)
        limit = run["adhesion_limit"].values[shown, axle]
        for k in (0, -1):  # a rail that stands still
            assert force[k] == pytest.approx(float(curve.coefficient(along[k], limit[k])), abs=2e-3)
        assert limit[-1] < 0.8 * limit[0]


@law("real-line")
def its_run_lies_below_what_is_permitted_and_stops_are_named_as_points_passed_are(figure):
    one = small_figures.line_run()
    upper, strip, _ = figure.axes
    permitted, speed = upper.get_lines()[:2]
    np.testing.assert_allclose(speed.get_xdata(), 1e-3 * one.run["position"].values)
    np.testing.assert_allclose(speed.get_ydata(), 3.6 * one.run["speed"].values)
    allowed = np.interp(speed.get_xdata(), permitted.get_xdata(), permitted.get_ydata())
    assert (speed.get_ydata() - allowed).max() < 2.0  # between two points of the drawn curve
    stops = {stop.point.name for stop in one.stops}
    named = [text.get_text() for text in strip.texts]
    assert stops
    assert stops <= set(named)
    assert len(named) == len(set(named))
    assert not upper.texts  # no name lies over the curve of a braking train


@law("brake-cut-out")
def its_line_is_that_of_the_means_and_each_day_is_off_it_by_what_is_drawn(figure):
    table = brake_table()
    forces, off = figure.axes
    line, means = (np.transpose(one.get_data()) for one in forces.get_lines())
    slope = (line[1, 1] - line[0, 1]) / (line[1, 0] - line[0, 0])
    assert slope == pytest.approx(33.0, abs=0.5)
    drawn = np.transpose(off.containers[0].lines[0].get_data())
    rows = table[table["test"].isin(list(CUT_OUT))]
    expected = rows["mean"] - (line[0, 1] + slope * rows["test"].map(CUT_OUT))
    np.testing.assert_allclose(sorted(drawn[:, 1]), sorted(expected), atol=1e-6)
    # days stand beside each other, nearer to their own number of wagons than to another
    count = means[np.abs(drawn[:, [0]] - means[:, 0]).argmin(axis=1), 0]
    assert sorted(count) == sorted(rows["test"].map(CUT_OUT))
    assert len({round(x, 6) for x in drawn[:, 0]}) == len(drawn)


@law("faulty-car")
def its_bars_are_shortfalls_and_the_accused_stand_out(figure):
    found, axes = small_figures.faulty_stops()[0].shortfalls(), figure.axes[0]
    bars = axes.containers[0]
    np.testing.assert_allclose(
        [bar.get_height() for bar in bars], np.nan_to_num(found.shortfall) / 1e3
    )
    accused = [k for k, bar in enumerate(bars) if to_hex(bar.get_facecolor()) == ACCUSED]
    assert accused == sorted(found.accused)
    assert FAULT.car in accused
    words = " ".join(text.get_text() for text in axes.texts)
    assert f"car {FAULT.car + 1} is accused" in words
    assert words.count("not judged") == np.isnan(found.shortfall).sum()


@law("readhesion-slip", "readhesion-torque")
def its_slip_or_torque_is_that_of_the_runs_in_both_units(figure):
    both = small_figures.cases()
    if len(figure.axes) == 6:
        names, lanes = ("slip", "peak_slip"), (0, 1, 1)
    else:
        names, lanes = (None, "coefficient"), (0, 1)
    for column, runs in zip(np.reshape(figure.axes, (-1, 2)).T, both, strict=True):
        for one, lane in zip(column, lanes, strict=True):
            for line, name in zip(one.get_lines(), names, strict=False):
                if name:
                    np.testing.assert_array_equal(data(line)[1], getattr(runs, name)[:, lane])


@law("readhesion-trajectory")
def its_trajectories_end_before_the_rail_recovers(figure):
    axes = np.reshape(figure.axes, (2, 2)).T
    for column, runs in zip(axes, small_figures.cases(), strict=True):
        shown = (runs.time >= DROP) & (runs.time < RECOVERY - 0.02)
        held = (runs.time > 3.0) & (runs.time < DROP - 0.1)
        for lane, one in enumerate(column):
            slip, torque = data(one.get_lines()[0])
            scaled = on_coefficient_scale(runs, lane)
            np.testing.assert_array_equal(slip, runs.slip[shown, lane])
            np.testing.assert_array_equal(torque, scaled[shown])
            # torque and coefficient lie on each other until the wheel slips
            np.testing.assert_allclose(scaled[held], runs.coefficient[held, lane], rtol=2e-3)


def it_shows_what_readheres_in_both_units(figure, of_margin):
    for axes in figure.axes[:2]:
        good, bad, limits = (data(line) for line in axes.get_lines()[:3])
        for (places, values), readheres in ((good, True), (bad, False)):
            for mu, value in zip(places, values, strict=True):
                least = limit_of(value, 0.2) if of_margin else limit_of(0.4, value)
                assert (mu >= least) == readheres
        assert len(good[0]) + len(bad[0]) == 150
        assert np.isfinite(limits[0]).sum() == (10 if of_margin else 5)


law("margin-sweep")(partial(it_shows_what_readheres_in_both_units, of_margin=True))
law("width-sweep")(partial(it_shows_what_readheres_in_both_units, of_margin=False))


@law("downhill")
def it_shows_the_torque_that_remains_in_both_units(figure):
    rows = sweep_table()[lambda t: t["part"] == "downhill"]
    for axes, (_, own) in zip(figure.axes, rows.groupby("read_in", sort=False), strict=True):
        kept = own.sort_values(["margin", "gradient"])["kept"].to_numpy()
        for drawn in (axes.get_lines()[::2], axes.get_lines()[1::2]):
            np.testing.assert_allclose(
                np.concatenate([data(line)[1] for line in drawn]), 100.0 * kept
            )


def test_a_sweep_shows_between_which_limits_the_members_lie():
    table = sweep_table()
    chosen = (table["unit"] == "m/s2") & (table["member"] == 1)
    table.loc[chosen, "limit_coefficient"] += 0.01
    left, right = (
        [data(line) for line in axes.get_lines()[3:]] for axes in width_sweep(table).axes[:2]
    )
    assert all(np.ptp(mu) == 0.0 for mu, _ in left if mu.size)
    assert all(np.ptp(mu) == pytest.approx(0.009) for mu, _ in right if mu.size)


def test_differences_show_the_quartiles_of_the_problems_and_where_no_event_is():
    table = difference_table()
    table["over"] = np.random.default_rng(1).uniform(0.0, 0.1, len(table))
    chosen = table[(table["part"] == "problem") & (table["rule"] == "greedy")]
    axes, over = differences(table).axes[0], 100 * (chosen["over"] - chosen["short"])
    drawn = [list(line.get_xdata()) for line in axes.get_lines()[:3]]
    for found, ends in zip(drawn, ((0.01, 0.99), (0.25, 0.75), (0.5, 0.5)), strict=True):
        assert [found[0], found[-1]] == pytest.approx(list(np.quantile(over, ends)))
    bare = differences(table[table["part"] == "problem"]).axes[1:4]
    assert [[text.get_text() for text in axes.texts] for axes in bare] == [[NO_EVENT]] * 3


def test_verdicts_are_drawn_over_their_thresholds(monkeypatch):
    """Dots are the estimates in the colour of the verdict; the line is the threshold; the shade the side claimed."""
    for module in ("studies.patent.claims_study", "paper_figs.patent"):
        monkeypatch.setattr(f"{module}.ARMS", (Arm("greedy", "cut-and-ramp"),))
    table = claim_table(
        120, lambda row: row | ({"unit_use_low": 0.8} if row["rule"] == "greedy" else {})
    )
    found = {s.name: s for s in CLAIM_STUDY.statements(table)}
    figure = claim_verdicts(table)
    assert [axes.get_title(loc="left")[1] for axes in figure.axes] == list("abcde")
    for axes, statement in zip(figure.axes, found.values(), strict=True):
        factor, test = 1.0 if statement.name == "d" else 100.0, statement.test
        look = LOOKS[statement.verdict]
        (dot,) = [line for line in axes.lines if line.get_marker() == look["marker"]]
        assert dot.get_xdata()[0] == pytest.approx(factor * test.estimate.value)
        assert dot.get_color() == look["color"]
        threshold = factor * test.threshold
        assert any(list(line.get_xdata()) == [threshold, threshold] for line in axes.lines)
        (shade,) = axes.patches
        ends = sorted((shade.get_x(), shade.get_x() + shade.get_width()))
        assert ends[0 if test.direction == "at least" else 1] == pytest.approx(threshold)
        low, high = axes.get_xlim()
        ends = [factor * end for end in (test.adjusted.low, test.adjusted.high)]
        assert low < min(*ends, threshold)
        assert high > max(*ends, threshold)
        (words,) = axes.texts
        assert words.get_text().startswith(f"{statement.verdict}, n = {test.estimate.count}\n")
    assert found["b"].verdict == FAILS


def test_each_controller_has_its_own_verdicts_and_few_events_say_so():
    """The claims hold under the one, and under the other claim (b) fails, in its own figure alone."""
    table = claim_table(
        120, lambda row: row | ({"unit_use_low": 0.8} if row["controller"] == COMPARED[1] else {})
    )
    for draw, verdict in ((claim_verdicts, HOLDS), (claim_verdicts_search, FAILS)):
        axes = draw(table).axes[1]
        assert [label.get_text() for label in axes.get_yticklabels()] == list(LAYERS)
        assert [words.get_text().partition(",")[0] for words in axes.texts] == [verdict] * len(
            LAYERS
        )
    few = claim_verdicts(claim_table(4))
    assert all(axes.texts[0].get_text().startswith("too few events") for axes in few.axes)


def test_learning_shows_each_series_their_mean_and_how_many_are_within_the_tolerance():
    table = learning_table(falling, trains=3)
    table.loc[(table["train"] == 2) & (table["arm"] == "Gaussian"), "error"] = 0.01
    sound = table[table["case"] == "sound"]
    kinds = list(sound[["rail", "stored"]].drop_duplicates().itertuples(index=False, name=None))
    panels = np.reshape(learning(table).axes, (len(kinds), len(LEARNERS)))
    for (rail, stored), row in zip(kinds, panels, strict=True):
        rows = sound[(sound["rail"] == rail) & (sound["stored"] == stored)]
        for arm, axes in zip(LEARNERS, row, strict=True):
            own = rows[rows["arm"] == arm]
            lines = {line.get_label(): line for line in axes.get_lines()}
            np.testing.assert_allclose(
                lines["_mean"].get_ydata(), own.groupby("station")["error"].mean()
            )
            ends = own[own["station"] == own["station"].max()]["error"]
            series = [line for line in axes.get_lines() if line.get_label() == "_train"]
            assert sorted(line.get_ydata()[-1] for line in series) == sorted(ends)
            within = int((ends <= LEARNT_WITHIN).sum())
            assert f"{within} of {len(ends)} within" in [text.get_text() for text in axes.texts]
            assert set(lines["tolerance"].get_ydata()) == {LEARNT_WITHIN}


def test_a_comparison_without_the_reference_says_so_and_any_number_of_controllers_is_drawn():
    table = comparison_table()
    for draw in (rule_comparison, rule_events):
        axes = draw(table[table["rule"] != REFERENCE]).axes[0]
        assert [text.get_text() for text in axes.texts] == [NO_PAIRS]
    for count in (1, 5):
        names = list(CONTROLLERS)[:count]
        table = comparison_table(tuple(names), scenarios=tuple(f"event {k}" for k in range(14)))
        drawn = rule_events(table)
        assert [axes.get_title("left").split(") ")[-1] for axes in drawn.axes] == names
        assert drawn.get_size_inches()[1] <= 10.0
        (legend,) = rule_comparison(table).legends
        assert [text.get_text() for text in legend.get_texts()] == names


def test_every_figure_has_a_description_small_runs_that_draw_it_and_a_page():
    assert set(DRAWN) == set(FIGURES)
    for entry in FIGURES.values():
        assert callable(entry)
        assert len(entry.description) > 20
    pages = "\n".join(text for page, text in PAGES.items() if page != "CHANGELOG.md")
    shown = re.findall(r"(?:readhesion figures\s|gallery/|FIGURES\[\")([\w\s-]+)", pages)
    named = {name for one in shown for name in one.split()}
    assert set(FIGURES) - named == set()
    for width in (5.0, 3.5, 7.1):
        with pytest.raises(StudyError, match="take COLUMN"):
            new_figure(width, 2.0)


def test_text_that_overlaps_is_found():
    with mpl.rc_context(fname=STYLE_FILE):
        figure = Figure(figsize=(COLUMN.value, 2.0))
        axes = figure.subplots()
        axes.text(0.4, 0.5, "one")
        assert overlapping(words_of(figure)) == []
        axes.text(0.42, 0.5, "other")
        assert overlapping(words_of(figure)) == [("one", "other")]
        axes.text(0.99, 0.2, "beyond the page, far to its right").set_in_layout(False)
        assert cut_off(figure, words_of(figure)) == ["beyond the page, far to its right"]


def test_what_changes_in_a_picture_is_seen(monkeypatch):
    """A mean that moves, a row left out, a side not tinted, another colour."""
    table = small_figures.six_events()
    before = pixels(from_tables("rule-comparison"))
    assert calculate_rms(before, pixels(FIGURES["rule-comparison"](table))) == 0.0
    moved = table.assign(bound_use=table["bound_use"] + 0.02 * (table["rule"] == "greedy"))
    fewer = table[(table["rule"] != "cooperative") | (table["scenario"] != "two")]
    for other in (moved, fewer):
        assert calculate_rms(before, pixels(FIGURES["rule-comparison"](other))) > TOLERANCE
    for name, changed in (
        ("tint_better", lambda axes, better: None),
        ("rule_look", lambda rule: {"color": "red", "marker": "o", "linestyle": "none"}),
    ):
        with monkeypatch.context() as patched:
            patched.setattr(rules, name, changed)
            after = pixels(FIGURES["rule-comparison"](table))
        assert calculate_rms(before, after) > TOLERANCE, name


def test_the_stored_times_of_solvers_are_read_with_their_command_and_missed_in_a_package(
    monkeypatch, tmp_path
):
    source = Source(Store(tmp_path))
    found = controllers.stored_times(source)
    assert {"compiled step", "fatrop", "acados SQP_RTI"} <= set(found.index)
    assert (found["time"] < found["time_p99"]).all()
    assert all("closed_loop" in one.command and one.seeds for one in source.origins)
    monkeypatch.setattr(controllers, "STORED", tmp_path)
    (words,) = FIGURES["mpc-times"](controllers.stored_times(source)).axes[0].texts
    assert "an installed package has none" in words.get_text()
