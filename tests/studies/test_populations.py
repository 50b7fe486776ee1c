"""Populations of random events: an event follows from its seed and number, and a small run of each of their studies."""

from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

from alloc.evaluation.metrics import METRICS
from paper_figs.sharing import FIGURES
from readhesion import simulate
from studies import braking, claims
from studies.compare import choose_grid
from studies.files.scenario_files import load_scenario
from studies.population import draws as events
from studies.population import population
from studies.run_cell import cell, run
from studies.runner.rows import BOOKKEEPING, markdown_table
from studies.runner.study import run_study
from studies.statistics import statement_table

STYLE = Path(__file__).parents[2] / "paper_figs" / "readhesion.mplstyle"
# module -> a seed, hashes of its first events, and what its draws lie between
POPULATIONS = {
    claims: (
        0,
        "c50789cde3036720 c8169aeb767e5ff4 9abe1f576a5acf86",
        {"level": (0.06, 0.2), "slope": (0.0, 0.0332), "scatter": (0.0, 0.012),
         "patch_factor": (0.6, 1.0), "patch_start_m": (5.0, 40.0), "patch_length_m": (20.0, 60.0)},
    ),
    braking: (
        90,
        "cad44c0c394b33cb 9457f4876ca620d2 129a03f7553991a8",
        {"residual_ratio": (0.3, 0.98), "peak_slip": (0.15, 0.8), "share": (0.4, 1.1),
         "end_kmh": (0.0, 35.0), "patch_factor": (0.5, 1.6), "grade_permille": (-20.0, 20.0),
         "radius_error": (0.0, 0.005), "failed_at_s": (0.0, 6.0), "day": (1, 2**31)},
    ),
    population: (
        65,
        "fed6fa84b0eb3f75 e3470b178c970b28 db040890f5716a6f",
        {"units": (2.0, 20.0), "lag_s": (0.005, 0.1), "adhesion": (0.08, 0.22), "offered": (0.7, 1.3),
         "growth": (-0.05, 0.25), "speed_noise_kmh": (0.0, 0.1), "telegram_loss": (0.0, 0.1)},
    ),
}  # fmt: skip
modules = pytest.mark.parametrize(
    "module", list(POPULATIONS), ids=lambda module: module.__name__.rpartition(".")[2]
)


def event_of(module, seed, k):
    """Event `k` on its day."""
    return module.event(seed, k).event(module.draw(seed, k).get("day", k))


@modules
def test_events_stay_what_they_were(module):
    seed, hashes, _ = POPULATIONS[module]
    wanted = hashes.split()
    assert [event_of(module, seed, k).hash for k in range(len(wanted))] == wanted


@modules
def test_draws_lie_within_their_bounds_and_fill_them(module):
    *_, bounds = POPULATIONS[module]
    drawn = [module.draw(5, k) for k in range(300)]
    for name, (low, high) in bounds.items():
        values = np.array([event[name] for event in drawn], dtype=float)
        assert low <= values.min() <= values.max() <= high, name
        assert np.ptp(values) > 0.6 * (high - low), name


@modules
def test_what_is_drawn_is_not_what_is_measured(module):
    """A column of both names would be one of them."""
    assert not {*METRICS, *BOOKKEEPING} & {*module.draw(5, 0)}


@modules
def test_an_event_depends_on_seed_and_number(module):
    hashes = [event_of(module, seed, k).hash for seed in (1, 2) for k in range(3)]
    assert len(set(hashes)) == len(hashes)
    assert event_of(module, 1, 2).hash == hashes[2]


def test_a_draw_is_as_likely_as_it_says():
    draws = [events.Draw(3, k, 1) for k in range(2000)]
    assert np.mean([draw.mixture(0.3, 1.0, 2.0, 0.0) > 0.0 for draw in draws]) == pytest.approx(
        0.3, abs=0.03
    )
    assert np.mean([draw.choose("ab", [0.2, 0.8]) == "a" for draw in draws]) == pytest.approx(
        0.2, abs=0.03
    )
    logs = np.log10([draw.log_uniform(0.1, 10.0) for draw in draws])
    assert np.histogram(logs, 4, (-1.0, 1.0))[0] == pytest.approx(500, abs=80)


def test_all_deviations_taken_back_are_the_printed_patent(monkeypatch):
    monkeypatch.setattr(braking, "DURATION", 8.0)
    stop, printed_cell = (
        braking.event(90, 0),
        cell(braking.event(90, 0), claims.CORRECTED, "cut-and-ramp", 0),
    )
    for arm, keys in braking.AS_PRINTED.items():
        printed_cell = claims.change_cell(printed_cell, arm, keys)
    arms = (
        (printed_cell.args[0], claims.CORRECTED),
        (stop, claims.PRINTED),
        (stop, claims.CORRECTED),
    )
    together, printed, corrected = (run(*both, "cut-and-ramp", 0)["damage"] for both in arms)
    assert together == printed != corrected


@pytest.mark.parametrize("module", [claims, braking])
def test_a_small_run(module, tmp_path, monkeypatch):
    """Rows of two short events under two rules, and all that is made of them, though most rules are missing."""
    monkeypatch.setattr(module, "DURATION", 6.0)
    study, whole = module.STUDY, ("alone", "cooperative")

    def cells(number, seed):
        chosen = [cell for cell in study.cells(number, seed) if cell.columns["rule"] in whole]
        return [cell for cell in chosen if cell.columns["controller"] in claims.CONTROLLERS]

    rows = run_study(replace(study, cells=cells), tmp_path, 2, POPULATIONS[module][0])
    assert list(rows["status"]) == ["ok"] * 4 * len(whole)
    assert set(rows["rule"]) == set(whole)
    assert rows["bound_use"].between(0.2, 1.01).all()
    table = study.table(rows)
    assert len(markdown_table(table).splitlines()) == len(table) + 2 < 40
    assert not table.astype(str).stack().str.contains("nan").any()
    verdicts = statement_table(study.statements(rows))
    assert set(verdicts["verdict"]) == {"too few events"}
    assert verdicts["name"].is_unique
    figure = study.figure or (lambda rows: FIGURES[study.name].draw(rows))
    with mpl.rc_context(fname=STYLE):
        figure(rows).savefig(tmp_path / "figure.pdf")


def test_a_drawn_event_runs_by_its_name_as_its_row_was_made():
    assert load_scenario("random-0-0012") == claims.event(0, 12)
    assert load_scenario("population-65-0002") == population.event(65, 2)
    assert simulate("population-65-0002", "alone", "none").attrs["seed"] == 2
    cells = choose_grid([load_scenario("population-65-0002")], ["alone"], ["none"], 2).cells()
    assert [cell.args[3] for cell in cells] == [2, 3]
