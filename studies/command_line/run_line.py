"""The command `readhesion run-line`: a train's minimum running time over a line, both given as railtoolkit files."""

import json
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from studies.command_line.options import FilePath
from studies.command_line.terminal import console, progress
from studies.files.study_error import StudyError
from studies.files.writable import FIGURE, RUN, check_file

if TYPE_CHECKING:
    from studies.lines.line_run import LineRun


def run_line(
    *,
    line: FilePath,
    train: FilePath,
    load: float = 1.0,
    out: FilePath | None = None,
    figure: FilePath | None = None,
    as_json: Annotated[bool, Parameter("--json", negative=())] = False,
) -> None:
    """Run a train over a line in minimum time and print running time, energy and points passed.

    Parameters
    ----------
    line
        Railtoolkit running path: sections with speed limit and gradient, points of interest.
    train
        Railtoolkit rolling stock; the train brakes by its `a_braking`.
    load
        Share of the vehicles' `load_limit` on board, 0 to 1.
    out
        File for the recorded run (netCDF, .nc).
    figure
        File for a figure of the run (pdf, png or svg).
    as_json
        Print JSON instead of tables.
    """
    from alloc.recording import save
    from studies.lines import line_run
    from studies.railtoolkit.reading import read_path, read_rolling_stock

    if not 0.0 <= load <= 1.0:
        raise StudyError(f"--load {load:g}: give a share of the load limit, 0 to 1")
    path, stock = read_path(line), read_rolling_stock(train, load)
    check_file(out, RUN)
    check_file(figure, FIGURE)
    with progress() as on_row:
        found = line_run.run_line(
            path, stock, on_progress=lambda share: on_row(path.name, round(100 * share), 100)
        )
    if out is not None:
        save(found.run, out)
    if figure is not None:
        from studies.core.gallery import gallery

        gallery().draw_one("real-line", figure, found)
    content = summary(found)
    if as_json:
        print(json.dumps(content, indent=2, allow_nan=False))
    else:
        _print(content)


def summary(found: "LineRun") -> dict[str, Any]:
    """What a run over a line comes to, in the units people use."""
    start, end = found.path.span
    return {
        "line": found.path.name,
        "train": found.stock.train.name,
        "length_m": end - start,
        "mass_t": 1e-3 * found.stock.train.mass,
        "running_time_s": found.running_time,
        "running_time_by_distance_steps_s": found.distance_time,
        "mean_speed_kmh": 3.6 * (end - start) / found.running_time,
        "highest_speed_kmh": 3.6 * float(found.run["speed"].max()),
        "energy_kWh": {name: joule / 3.6e6 for name, joule in found.energy().items()},
        "stops": [
            {
                "station_m": end,
                "time_s": found.running_time,
                "error_m": found.stop_error,
            }
        ],
        "points_of_interest": [
            {
                "name": p.point.name,
                "station_m": p.point.station,
                "measure": p.point.measure,
                "time_s": p.time,
                "speed_kmh": None if p.speed is None else 3.6 * p.speed,
            }
            for p in found.passings
        ],
    }


def clock(seconds: float) -> str:
    """Time as min:s with tenths."""
    tenths = round(10.0 * seconds)
    return f"{tenths // 600}:{tenths % 600 / 10:04.1f}"


def _print(content: dict[str, Any]) -> None:
    from rich.markup import escape
    from rich.table import Table

    screen = console()
    screen.print(escape(f"{content['train']} on {content['line']}"), highlight=False)
    table = Table(show_header=False)
    table.add_column()
    table.add_column(justify="right")
    for label, shown in (
        ("running time", f"{clock(content['running_time_s'])} min"),
        ("… by distance steps of 20 m", f"{clock(content['running_time_by_distance_steps_s'])} min"),
        ("length", f"{1e-3 * content['length_m']:.3f} km"),
        ("mass of the train", f"{content['mass_t']:.1f} t"),
        ("mean speed", f"{content['mean_speed_kmh']:.1f} km/h"),
        ("highest speed", f"{content['highest_speed_kmh']:.1f} km/h"),
        ("work of the motors at the wheels", f"{content['energy_kWh']['motors']:.1f} kWh"),
        ("… against resistance and gradient",
         f"{content['energy_kWh']['resistance_and_gradient']:.1f} kWh"),
        ("… lost in brake shoes", f"{content['energy_kWh']['brake_shoes']:.1f} kWh"),
        ("… lost in creep", f"{content['energy_kWh']['creep']:.2f} kWh"),
        *(
            (f"stop at {stop['station_m']:.1f} m", f"{clock(stop['time_s'])} min")
            for stop in content["stops"]
        ),
    ):  # fmt: skip
        table.add_row(label, shown)
    screen.print(table)
    if not content["points_of_interest"]:
        return
    table = Table(title="points of interest", title_justify="left")
    for heading in ("station, m", "point", "passed by", "time, min", "speed, km/h"):
        table.add_column(heading, justify="left" if heading in ("point", "passed by") else "right")
    for row in content["points_of_interest"]:
        never = row["time_s"] is None
        table.add_row(
            f"{row['station_m']:.1f}",
            escape(row["name"]),
            row["measure"],
            "never" if never else clock(row["time_s"]),
            "–" if never else f"{row['speed_kmh']:.1f}",
        )
    screen.print(table)
