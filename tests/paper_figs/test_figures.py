"""Figures show what was computed, on axes that say what and in which unit, and look alike."""

import re
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from alloc.estimation.measured_run import MeasuredTrain, analyse_run
from alloc.estimation.slide_counts import SYNTHETIC_TABLE, read_slide_counts
from alloc.onboard.controllers.registry import CONTROLLERS
from alloc.onboard.parameters import Detector
from alloc.plant.adhesion import PiecewiseCurve
from alloc.plant.sets.jp4209318_3car import rail as wet_rail
from alloc.plant.train import Coupler
from alloc.rules import RULES
from paper_figs.adhesion import PEAK, adhesion_curve, adhesion_drop, planned_curves
from paper_figs.allocation import HIGH, LOW, SHOWN, UNITS, allocate, allocation_bars
from paper_figs.brake_force import (
    FAULT,
    brake_all_cars,
    brake_cut_out,
    brake_emergency,
    brake_locomotive_only,
    faulty_car,
)
from paper_figs.claims import (
    claim_a,
    claim_b,
    claim_c,
    claim_d,
    claim_e,
    claim_verdicts,
    claim_verdicts_search,
)
from paper_figs.comparison import rule_comparison, utilisation_damage
from paper_figs.differences import differences
from paper_figs.drawing import draw_comparison, draw_run, save_figure
from paper_figs.events import blended_braking, sharing_wanders, slip_detection, slip_event
from paper_figs.headroom import headroom
from paper_figs.increments import axle_shifts, learning, unit_increments
from paper_figs.ladder import curves, ladder
from paper_figs.line_position import late_passages, line_position
from paper_figs.lines import real_line
from paper_figs.logs import measured_log
from paper_figs.mismatch import mismatch
from paper_figs.open_rails import open_rails
from paper_figs.readhesion_paper import (
    CASES,
    HALF_SLIP,
    SETS,
    half_slip,
    readhesion_factor,
    readhesion_slip,
    readhesion_torque,
    readhesion_trajectory,
    torque_table,
)
from paper_figs.readhesion_sweeps import calibration, limit_cycle, margin_sweep, width_sweep
from paper_figs.registry import FIGURES
from paper_figs.resistance import (
    air_resistance,
    gradient_change,
    resistance_weights,
    tunnel_mouth,
)
from paper_figs.sanders import sanders
from paper_figs.slide_runs import member_runs, slide_adhesion, slide_control
from paper_figs.slides import (
    slide_electric,
    slide_pareto,
    slide_tables,
)
from paper_figs.style import CONTROLLER_FILL, STYLE_FILE, rule_colour
from paper_figs.wsp_acceptance import wsp_acceptance
from studies.brake_force.faulty_car import allocated_stops
from studies.brake_force.running_tests import run_test
from studies.comparison.summary import summarise
from studies.core.job import Job, simulate_job
from studies.files.study_error import StudyError
from studies.lines.line_run import run_line
from studies.logs.export import log_table
from studies.logs.measured_log import check_log
from studies.readhesion_paper.limit_cycle_comparison import compare_cycles
from studies.readhesion_paper.paper import CALIBRATED, RIVAL, run_cases
from studies.resistance.driven_cases import CONTROLS, FEEDBACK, RIGHT, drive_case
from studies.resistance.learners import convergence
from studies.scenario.loading import load_scenario
from studies.slides.jp4209318 import CALIBRATED as DEMONSTRATION
from studies.slides.jp4209318 import brake, brake_event
from tests.simulation.slides import TRAIN, braked, readhering
from tests.studies.acceptance_tables import acceptance_table
from tests.studies.brake_tables import brake_table
from tests.studies.example_line import EXAMPLE_PATH, example_stock
from tests.studies.headroom_tables import headroom_table
from tests.studies.ladder_tables import curve_table, ladder_table
from tests.studies.learning_tables import falling, synthetic
from tests.studies.mismatch_tables import mismatch_table
from tests.studies.position_tables import position_table
from tests.studies.readhesion_tables import calibration_table, sweep_table
from tests.studies.sander_tables import sander_table
from tests.studies.short_route import short_route
from tests.studies.slide_tables import slide_table
from tests.studies.sweep_tables import claim_table, difference_table

OTHER = replace(DEMONSTRATION, front_adhesion=0.1)
CLAIMS = {"a": claim_a, "b": claim_b, "c": claim_c, "d": claim_d, "e": claim_e}
UNIT = re.compile(r"\[(–|%|s|m|km|kg/m|m/s|m/s²|m/s³|km/h|km/h/s|N m|kN|kPa|kJ|‰)\]$")
COUNTED = {
    "unit", "traction unit (1 = foremost)", "car (1 = foremost)", "axle from the front", "slides", "signal", "stations",
    "cars", "sensitivity", "adhesion curve", "kind of stop, the worst of each",
    "first half ahead of car", "second half ahead of car",
}  # fmt: skip
"""Labels of axes that count things, which have no unit."""


@pytest.fixture(scope="module")
def runs():
    scenario = load_scenario("very-low-adhesion").changed(duration_s=3.0)
    return [simulate_job(Job(scenario, rule, "cut-and-ramp", 0)) for rule in ("alone", "exact")]


@pytest.fixture(scope="module")
def stop():
    scenario = load_scenario("wet-stop").changed(duration_s=6.0)
    return simulate_job(Job(scenario, "greedy", "cut-and-ramp", 0))


@pytest.fixture(scope="module")
def cases():
    """Cases A and B of the readhesion paper in both units at a tenth of its resolution."""
    return [
        run_cases(one, tuple(CASES.values()), recovers=True, step=5e-4) for one in SETS.values()
    ]


@pytest.fixture(scope="module")
def half_slips():
    """The case just below the plan under each set."""
    return [
        run_cases(unprinted, [HALF_SLIP], recovers=True, step=5e-4) for unprinted in SETS.values()
    ]


@pytest.fixture(scope="module")
def logged():
    """A log with a gap, of coupled cars that slide."""
    train = TRAIN.coupled(Coupler())
    table = log_table(braked(readhering, train=train, rail=wet_rail(), duration=10.0), train, 5)
    log = check_log(table.drop(index=range(60, 80)), MeasuredTrain.of(train), "log")
    return log, analyse_run(log.run, log.train)


@pytest.fixture(scope="module")
def line_run():
    return run_line(EXAMPLE_PATH, example_stock())


@pytest.fixture(scope="module")
def passages():
    """Two cases under both speed controls on a short route."""
    return {
        (control, case): drive_case(short_route(), case, control)
        for control in CONTROLS
        for case in (FEEDBACK, RIGHT)
    }


@pytest.fixture(scope="module")
def drawn(source, runs, stop, cases, half_slips, line_run, logged, passages) -> dict[str, Figure]:
    """Every figure, from small runs."""
    return {
        "adhesion-curve": adhesion_curve(),
        "allocation-bars": allocation_bars(SHOWN),
        "slip-event": slip_event(*runs),
        "rule-comparison": rule_comparison(source.table),
        "utilisation-damage": utilisation_damage(source.table),
        **{f"claim-{claim}": draw(claim_table(60)) for claim, draw in CLAIMS.items()},
        "claim-verdicts": claim_verdicts(claim_table(60)),
        "claim-verdicts-search": claim_verdicts_search(claim_table(60)),
        "differences": differences(difference_table()),
        "blended-braking": blended_braking(stop),
        "sharing-wanders": sharing_wanders(*runs),
        "slip-detection": slip_detection(runs[0], Detector()),
        "planned-curves": planned_curves(),
        "open-rails": open_rails(),
        "axle-shifts": axle_shifts(read_slide_counts(SYNTHETIC_TABLE)),
        "unit-increments": unit_increments(),
        "learning": learning(synthetic(falling, trains=2)),
        "headroom": headroom(headroom_table()),
        "ladder": ladder(ladder_table()),
        "curves": curves(curve_table()),
        "mismatch": mismatch(mismatch_table()),
        "torque-table": torque_table(),
        "adhesion-drop": adhesion_drop(),
        "readhesion-slip": readhesion_slip(*cases),
        "readhesion-torque": readhesion_torque(*cases),
        "readhesion-factor": readhesion_factor(*cases),
        "readhesion-trajectory": readhesion_trajectory(*cases),
        "margin-sweep": margin_sweep(sweep_table()),
        "width-sweep": width_sweep(sweep_table()),
        "half-slip": half_slip(*half_slips),
        "limit-cycle": limit_cycle(
            {
                one.unit: compare_cycles((0.1, 0.3), (0.13, 0.15), 1, one)
                for one in (CALIBRATED, RIVAL)
            },
            (0.3, 0.5),
        ),
        "calibration": calibration(calibration_table()),
        "real-line": real_line(line_run),
        "measured-log": measured_log(*logged),
        "brake-locomotive-only": brake_locomotive_only(run_test("locomotive", 0)),
        "brake-all-cars": brake_all_cars(run_test("all", 0)),
        "brake-cut-out": brake_cut_out(brake_table()),
        "brake-emergency": brake_emergency(run_test("emergency", 0)),
        "faulty-car": faulty_car(
            allocated_stops(FAULT, 0),
            brake_table()[lambda t: t["part"] == "driven"],
        ),
        "air-resistance": air_resistance(short_route()),
        "tunnel-mouth": tunnel_mouth(short_route(), passages),
        "gradient-change": gradient_change(short_route(), passages),
        "line-position": line_position(
            short_route(), late_passages(short_route()), position_table()
        ),
        "resistance-weights": resistance_weights(convergence(short_route(), 1)),
        "slide-adhesion": slide_adhesion((DEMONSTRATION, OTHER)),
        "slide-control": slide_control(
            brake(brake_event(DEMONSTRATION)), member_runs((DEMONSTRATION, OTHER))
        ),
        "slide-tables": slide_tables(slide_table()),
        "slide-pareto": slide_pareto(slide_table()),
        "slide-electric": slide_electric(slide_table()),
        "wsp-acceptance": wsp_acceptance(acceptance_table()),
        "sanders": sanders(sander_table()),
    }


def lines_of(axes):
    """Lines that carry data; error bars have theirs among them."""
    return [line for line in axes.get_lines() if len(line.get_xdata()) > 0]


def test_every_figure_is_drawn(drawn):
    assert set(drawn) == set(FIGURES)


def test_every_figure_of_the_register_has_its_function():
    for entry in FIGURES.values():
        assert callable(entry)
        assert len(entry.description) > 20


@pytest.mark.parametrize("name", FIGURES)
def test_axes_carry_quantity_and_unit(drawn, name):
    labels = [
        label
        for axes in drawn[name].axes
        if axes.get_visible()
        for label in (axes.get_xlabel(), axes.get_ylabel())
        if label
    ]
    assert len(labels) >= 2
    for label in labels:
        assert UNIT.search(label) or label in COUNTED, label


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_fits_a_page_and_nothing_is_cut_off(drawn, name):
    figure = drawn[name]
    width, height = figure.get_size_inches()
    assert width <= 7.2
    assert height <= 10.0
    with mpl.rc_context(fname=STYLE_FILE):  # as files are written
        figure.draw_without_rendering()
        whole = figure.get_tightbbox()
    assert min(whole.x0, whole.y0) >= -0.01
    assert whole.x1 <= width + 0.01
    assert whole.y1 <= height + 0.01
    notes = [text for axes in figure.axes for text in axes.texts]  # some stand outside the layout
    for box in (note.get_window_extent() for note in notes):
        assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1
        assert figure.bbox.y0 <= box.y0 < box.y1 <= figure.bbox.y1


@pytest.mark.parametrize("name", FIGURES)
def test_pdf_and_png_are_written_and_equal_figures_are_equal_files(drawn, name, tmp_path):
    pdf, png = save_figure(drawn[name], tmp_path / name)
    assert pdf.read_bytes().startswith(b"%PDF")
    assert png.read_bytes().startswith(b"\x89PNG")
    again = save_figure(drawn[name], tmp_path / "again" / name)
    assert pdf.read_bytes() == again[0].read_bytes()


def test_every_rule_and_controller_has_a_look_of_its_own():
    for parts in (RULES, CONTROLLERS):
        assert len({part.colour for part in parts.values()}) == len(parts)
        assert len({part.marker for part in parts.values()}) == len(parts)
    assert set(CONTROLLER_FILL) < set(CONTROLLERS)
    assert len(set(CONTROLLER_FILL.values())) == len(CONTROLLER_FILL)


def test_a_rule_has_the_same_colour_in_every_figure(drawn, source):
    rules = list(dict.fromkeys(source.table["rule"]))
    for name in ("rule-comparison", "utilisation-damage"):
        shown = {to_hex(line.get_color()) for axes in drawn[name].axes for line in lines_of(axes)}
        assert {rule_colour(rule) for rule in rules} <= shown
        (legend,) = drawn[name].legends
        of_label = {
            text.get_text(): to_hex(handle.get_color())
            for text, handle in zip(legend.get_texts(), legend.legend_handles, strict=True)
        }
        assert {rule: of_label[rule] for rule in rules} == {r: rule_colour(r) for r in rules}
    columns = drawn["allocation-bars"].axes[: len(SHOWN)]
    for rule, axes in zip(SHOWN, columns, strict=True):
        assert axes.get_title() == rule
        assert to_hex(axes.patches[0].get_facecolor()) == rule_colour(rule)
    titles = drawn["slip-event"].axes[:2]
    assert [to_hex(axes.title.get_color()) for axes in titles] == ["#000000", "#000000"]
    left = [axes._left_title for axes in titles]
    assert [to_hex(t.get_color()) for t in left] == [rule_colour("alone"), rule_colour("exact")]


def test_the_curve_drawn_is_the_plants(drawn):
    curve, left = PiecewiseCurve(), drawn["adhesion-curve"].axes[0]
    for line in left.get_lines()[:3]:
        slip, mu = line.get_xdata(), line.get_ydata()
        np.testing.assert_allclose(mu, curve.coefficient(np.asarray(slip), PEAK))
    peak, top = curve.limit(PEAK)
    marked = left.get_lines()[3]
    assert (marked.get_xdata()[0], marked.get_ydata()[0]) == (float(top), float(peak))


def test_the_bars_are_the_rules_answers(drawn):
    for k, rule in enumerate(SHOWN):
        for row, found in enumerate((HIGH, LOW)):
            axes = drawn["allocation-bars"].axes[row * len(SHOWN) + k]
            heights = [bar.get_height() for bar in axes.patches[:UNITS]]
            np.testing.assert_allclose(heights, allocate(rule, found).limit)


def test_the_log_is_drawn_with_its_gap_and_what_was_found(drawn, logged):
    log, found = logged
    axes = drawn["measured-log"].axes
    train = next(line for line in axes[0].get_lines() if line.get_label() == "train")
    assert np.isnan(train.get_ydata()).sum() == 1
    np.testing.assert_allclose(train.get_ydata()[:60], 3.6 * log.run.speed[:60])
    (slips,) = (line for line in axes[1].get_lines() if line.get_marker() == "o")
    largest = [abs(event.largest_slip) for event in found.events]
    np.testing.assert_allclose(np.abs(slips.get_ydata()), largest, atol=1e-9)
    forces = {line.get_label(): line for line in axes[4].get_lines()}
    np.testing.assert_allclose(forces["car 2"].get_ydata()[:60], 1e-3 * found.car_force[:60, 1])


def test_high_and_low_adhesion_are_the_cases_that_the_figure_names():
    assert allocate("exact", HIGH).case == "B"
    assert allocate("exact", LOW).case == "A"


def test_the_event_shows_the_recorded_run(drawn, runs):
    axes = np.array(drawn["slip-event"].axes[:8]).reshape(4, 2)
    for column, run in enumerate(runs):
        for unit, line in enumerate(lines_of(axes[2, column])):
            np.testing.assert_array_equal(line.get_ydata(), run["motor_torque"].values[:, unit])
        train = next(line for line in lines_of(axes[0, column]) if line.get_label() == "train")
        np.testing.assert_allclose(train.get_ydata(), 3.6 * run["speed"].values)


def test_the_line_shows_the_run_below_what_is_permitted(drawn, line_run):
    permitted, speed = drawn["real-line"].axes[0].get_lines()[:2]
    np.testing.assert_allclose(speed.get_xdata(), 1e-3 * line_run.run["position"].values)
    np.testing.assert_allclose(speed.get_ydata(), 3.6 * line_run.run["speed"].values)
    allowed = np.interp(speed.get_xdata(), permitted.get_xdata(), permitted.get_ydata())
    assert (speed.get_ydata() - allowed).max() < 2.0  # between two points of the drawn curve


def test_the_comparison_shows_the_means_of_the_table(drawn, source):
    axes = drawn["rule-comparison"].axes[2]
    shown = {round(float(line.get_xdata()[0]), 6) for line in lines_of(axes)}
    means = {round(line.metrics["damage"].value, 6) for line in summarise(source.table)}
    assert means <= shown


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


@pytest.mark.parametrize("cars", [1, 2])
def test_a_run_without_motors_is_drawn(cars, tmp_path):
    run = brake(replace(brake_event(DEMONSTRATION, cars), duration=3.0))
    draw_run(run, tmp_path / "run.png")
    assert (tmp_path / "run.png").stat().st_size > 10_000
