"""Figures of the papers and of the comparison: one module each, data in, figure out."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable

    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

    from alloc.estimation.measured_run import Findings
    from studies.core.store import Store
    from studies.lines.line_run import LineRun
    from studies.logs.measured_log import MeasuredLog


class FigureEntry(NamedTuple):
    """A figure: module of this package with a function ``figure(source) -> Figure``, and what it shows."""

    module: str
    description: str
    of_comparison: bool = False
    """Whether it shows the rows of a comparison, and is drawn with one."""


FIGURES: dict[str, FigureEntry] = {
    "adhesion-curve": FigureEntry(
        "adhesion_curve",
        "adhesion curves with regions and peak (JP5484215 Fig. 17, readhesion paper Fig. 1)",
    ),
    "allocation-bars": FigureEntry(
        "allocation_bars", "limits of all rules for high and low adhesion (JP5484215 Fig. 6 a, b)"
    ),
    "slip-event": FigureEntry(
        "slip_event", "one slip event over time: speeds, slip, torque and limit per car"
    ),
    "blended-braking": FigureEntry(
        "blended_braking", "electric and air brake under limits (JP5484215 Fig. 16)"
    ),
    "sharing-wanders": FigureEntry(
        "sharing_wanders", "limits, torque and jerk of dynamic sharing beside the reference rule"
    ),
    "rule-comparison": FigureEntry(
        "rule_comparison", "rules over all events: effort, adhesion used, damage, jerk", True
    ),
    "utilisation-damage": FigureEntry(
        "utilisation_damage", "adhesion used against wheel damage, event by event", True
    ),
    "claim-a": FigureEntry(
        "claim_a",
        "claim (a) of JP5484215 over random events: the plan reached where alone does not",
    ),
    "claim-b": FigureEntry(
        "claim_b", "claim (b) of JP5484215 over random events: in case A every unit at its bound"
    ),
    "claim-c": FigureEntry(
        "claim_c", "claim (c) of JP5484215 over random events: adhesion used under caps too high"
    ),
    "claim-d": FigureEntry(
        "claim_d", "claim (d) of JP5484215 over random events: jerk against dynamic sharing"
    ),
    "claim-e": FigureEntry(
        "claim_e", "claim (e) of JP5484215 over random events: effort and slip against the preset"
    ),
    "differences": FigureEntry(
        "differences", "where greedy and exact level differ: random problems and closed loop"
    ),
    "measured-log": FigureEntry(
        "measured_log",
        "what a train's log tells: slips found, coefficients, Q, brake force per car",
    ),
    "slip-detection": FigureEntry(
        "slip_detection", "acceleration of a unit, thresholds and slip signal (JP5484215 Fig. 5)"
    ),
    "planned-curves": FigureEntry(
        "planned_curves", "planned coefficients over speed (JP5484215 Fig. 10)"
    ),
    "axle-shifts": FigureEntry(
        "axle_shifts", "shift of each axle's coefficient, synthetic counts (JP5484215 Figs. 11, 12)"
    ),
    "unit-increments": FigureEntry(
        "unit_increments", "increments per unit by drive and line (JP5484215 Fig. 13)"
    ),
    "learning": FigureEntry(
        "learning", "error of the increments against stations, by learner (sweep learning)"
    ),
    "ladder": FigureEntry(
        "ladder", "readhesion controllers from none to MPC over random events (sweep ladder)"
    ),
    "curves": FigureEntry(
        "curves",
        "differences of rules and controllers under several adhesion curves (sweep curves)",
    ),
    "torque-table": FigureEntry(
        "torque_table", "torque factor over the deviation of acceleration (readhesion paper Fig. 5)"
    ),
    "adhesion-drop": FigureEntry(
        "adhesion_drop",
        "adhesion curve before and after the rail's change (readhesion paper Fig. 6)",
    ),
    "readhesion-slip": FigureEntry(
        "readhesion_slip", "slip with and without readhesion (readhesion paper Figs. 7, 8, 9)"
    ),
    "readhesion-torque": FigureEntry(
        "readhesion_torque",
        "torque and coefficient with and without readhesion (readhesion paper Figs. 10, 11)",
    ),
    "readhesion-factor": FigureEntry(
        "readhesion_factor",
        "torque factor with and without readhesion (readhesion paper Figs. 12, 13)",
    ),
    "readhesion-trajectory": FigureEntry(
        "readhesion_trajectory",
        "torque and coefficient over slip: limit cycle or none (readhesion paper Figs. 14, 15)",
    ),
    "margin-sweep": FigureEntry(
        "margin_sweep", "readhesion and adhesion used over a_0 (readhesion paper Figs. 16, 17, 18)"
    ),
    "width-sweep": FigureEntry(
        "width_sweep", "readhesion and adhesion used over a_w (readhesion paper Figs. 19, 20, 21)"
    ),
    "half-slip": FigureEntry(
        "half_slip", "slip and torque on a rail just below the plan (readhesion paper Figs. 22, 23)"
    ),
    "limit-cycle": FigureEntry(
        "limit_cycle",
        "limit cycle of the torque table, simulated and predicted; when wheels run away",
    ),
    "calibration": FigureEntry(
        "calibration", "how narrowly the readhesion paper determines what it does not print"
    ),
    "real-line": FigureEntry(
        "real_line",
        "speed, limits and gradients of a minimum-time run (example line; run-line draws yours)",
    ),
    "brake-locomotive-only": FigureEntry(
        "brake_locomotive_only",
        "running test with only the locomotive braked: brake force per car (RTRI report Fig. 4)",
    ),
    "brake-all-cars": FigureEntry(
        "brake_all_cars", "running test with locomotive and wagons braked (RTRI report Fig. 5)"
    ),
    "brake-cut-out": FigureEntry(
        "brake_cut_out",
        "averaged brake force over the number of braked wagons (RTRI report Fig. 6)",
    ),
    "brake-emergency": FigureEntry(
        "brake_emergency",
        "emergency brake of 18 cars: estimate, theory and remedies (RTRI report Fig. 7)",
    ),
    "faulty-car": FigureEntry(
        "faulty_car", "which car did not deliver its allocated brake force (sweep brake-force)"
    ),
    "air-resistance": FigureEntry(
        "air_resistance", "air resistance coefficient, open and tunnel (JP H07-322414 Fig. 3)"
    ),
    "tunnel-mouth": FigureEntry(
        "tunnel_mouth", "acceleration and speed through a tunnel, by case (JP H07-322414 Fig. 9)"
    ),
    "gradient-change": FigureEntry(
        "gradient_change", "acceleration and speed over a climb, by case (JP H07-322414 Fig. 10)"
    ),
    "resistance-weights": FigureEntry(
        "resistance_weights", "convergence of the weights of running resistance, by learner"
    ),
    "slide-adhesion": FigureEntry(
        "slide_adhesion", "adhesion over slip ratio, speed and axle position (JP4209318 Fig. 2)"
    ),
    "slide-control": FigureEntry(
        "slide_control",
        "three cars under slide protection: speeds, pressures, valves (JP4209318 Fig. 3)",
    ),
    "slide-tables": FigureEntry(
        "slide_tables",
        "braking distances and Q beside the source's numbers (JP4209318 Tables 3, 4)",
    ),
    "slide-pareto": FigureEntry(
        "slide_pareto",
        "distance against Q over the sensitivity of slide protection, and thresholds",
    ),
    "slide-electric": FigureEntry(
        "slide_electric", "distance against Q: electric brake by controller beside slide protection"
    ),
}
"""Every figure by name."""


def draw_figures(
    names: Sequence[str],
    out: str | Path,
    results: str | Path,
    jobs: int = 1,
    on_row: "Callable[[str, int, int], None] | None" = None,
) -> list[Path]:
    """Draw figures by name into `out` as PDF and PNG; returns the files.

    What `results` lacks is run first, in `jobs` processes.
    """
    from paper_figs.source import Source

    source = Source.of_folder(results, jobs, on_row)
    written = []
    for name in names:
        figure = import_module(f"paper_figs.{FIGURES[name].module}").figure(source)
        written += save_figure(figure, Path(out) / name)
    return written


def comparison_figures(table: "pd.DataFrame", store: "Store", out: str | Path) -> list[str]:
    """Draw the figures of a comparison from its `table` into `out`; returns their names (none if every row failed)."""
    from paper_figs.source import Source

    source = Source(store, table)
    if source.table.empty:
        return []
    names = [name for name, entry in FIGURES.items() if entry.of_comparison]
    for name in names:
        figure = import_module(f"paper_figs.{FIGURES[name].module}").figure(source)
        save_figure(figure, Path(out) / name)
    return names


def draw_run(run: "xr.Dataset", path: str | Path) -> None:
    """Draw one recorded run over time into a file; its ending (pdf, png, svg) gives the format.

    Of a train without motors it is what its slide protection does.
    """
    if run.sizes["unit"] == 0:
        from paper_figs import slide_control

        _write(slide_control.draw(run), path)
    else:
        from paper_figs import slip_event

        _write(slip_event.draw([run]), path)


def draw_line_run(found: "LineRun", path: str | Path) -> None:
    """Draw a run over a line by position into a file; its ending (pdf, png, svg) gives the format."""
    from paper_figs.real_line import draw

    _write(draw(found), path)


def draw_log(log: "MeasuredLog", found: "Findings", path: str | Path) -> None:
    """Draw what a log tells into a file; its ending (pdf, png, svg) gives the format."""
    from paper_figs.measured_log import draw

    _write(draw(log, found), path)


def _write(figure: "Figure", path: str | Path) -> None:
    import matplotlib as mpl

    from paper_figs.style import STYLE_FILE
    from studies.core.study_error import StudyError

    try:
        with mpl.rc_context(fname=STYLE_FILE):
            figure.savefig(path)
    except ValueError as error:
        raise StudyError(f"figure {str(path)!r}: {error}") from None


def save_figure(figure: "Figure", path: Path) -> list[Path]:
    """Write a figure as `path`.pdf and `path`.png, without the date so that equal figures are equal files."""
    import matplotlib as mpl

    from paper_figs.style import STYLE_FILE
    from studies.core.study_error import StudyError

    files = [path.with_name(path.name + ending) for ending in (".pdf", ".png")]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with mpl.rc_context(fname=STYLE_FILE):
            figure.draw_without_rendering()
            figure.set_layout_engine("none")  # laid out once: both files are the same to the point
            figure.savefig(files[0], metadata={"CreationDate": None})
            figure.savefig(files[1])
    except OSError as error:
        raise StudyError(
            f"figure folder {str(path.parent)!r} cannot be written: {error.strerror}; choose another with --out"
        ) from None
    return files


__all__ = [
    "FIGURES",
    "FigureEntry",
    "comparison_figures",
    "draw_figures",
    "draw_line_run",
    "draw_log",
    "draw_run",
    "save_figure",
]
