"""The command `readhesion run-line`: a train over a line, both by name or as files."""

import json
import warnings
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from studies.command_line.options import (
    FilePath,
    Names,
    command_of,
    console,
    progress,
    said,
    split_names,
)
from studies.files.study_error import FileWarning, StudyError
from studies.files.writable import FIGURE, RUN, check_file

if TYPE_CHECKING:
    from studies.lines.line_run import LineRun

DEFAULT_LINE, DEFAULT_TRAIN = Path("dresden-goerlitz"), Path("br-642")
MOST_DWELL = 3600.0


def run_line(
    *,
    line: FilePath = DEFAULT_LINE,
    train: FilePath = DEFAULT_TRAIN,
    load: float = 1.0,
    stops: Names = None,
    dwell: float | None = None,
    effort: float = 1.0,
    coasting: float = 0.0,
    out: FilePath | None = None,
    figure: FilePath | None = None,
    as_json: Annotated[bool, Parameter("--json", negative=())] = False,
) -> None:
    """Run a train over a line and print running time, stops, energy, wear of the brake and points passed.

    Parameters
    ----------
    line
        Name of a line that ships, or file: TOML, or railtoolkit running path (.yaml).
    train
        Name of a train that ships with the lines, or file: TOML, or railtoolkit rolling stock
        (.yaml).
    load
        Share of its load on board, 0 to 1.
    stops
        Points of the line to stop at, one by one or with commas: names, stations in m, all or none
        [default: those that have a dwell in the line's file].
    dwell
        Time at each stop in s [default: what the line's file says, else 30].
    effort
        Share of the tractive effort that is used at most.
    coasting
        Time in s before each braking curve from which the train rolls without effort.
    out
        File for the recorded run (netCDF, .nc, or MATLAB, .mat).
    figure
        File for a figure of the run (pdf, png or svg).
    as_json
        Print JSON instead of tables.
    """
    from alloc.recording import save
    from alloc.sources import write_whole
    from studies.lines import line_run
    from studies.lines.named_files import find_line, find_stock
    from studies.lines.speed_profile import DrivingStyle, with_stops

    if not 0.0 <= load <= 1.0:
        raise StudyError(f"--load {load:g}: give a share of the load limit, 0 to 1")
    if dwell is not None and not 0.0 <= dwell <= MOST_DWELL:
        raise StudyError(f"--dwell {dwell:g}: give a time from 0 to {MOST_DWELL:g} s")
    style, wanted = DrivingStyle(effort, coasting), split_names(stops)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", FileWarning)
        path, stock = find_line(str(line)), find_stock(str(train), load)
    for one in told:
        warnings.showwarning(one.message, one.category, one.filename, one.lineno)
    if wanted is not None or dwell is not None:
        own = [stop.name for stop in path.stops()]
        path = with_stops(path, own if wanted is None else wanted, dwell)
    check_file(out, RUN)
    check_file(figure, FIGURE)
    with progress() as on_row:
        found = line_run.run_line(
            path, stock, style, on_progress=lambda share: on_row(path.name, round(100 * share), 100)
        )
    if out is not None:
        write_whole(out, partial(save, found.run))
    if figure is not None:
        from studies.core.gallery import gallery

        command = command_of(
            "run-line", line=said(line), train=said(train), load=said(load, 1.0), stops=wanted, dwell=said(dwell),
            effort=said(effort, 1.0), coasting=said(coasting, 0.0),
        )  # fmt: skip
        gallery().draw_one("real-line", figure, found, command=command)
    content = summary(found) | {"remarks": [str(one.message) for one in told]}
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
        "share_of_effort": found.style.effort,
        "coasting_s": found.style.coasting,
        "energy_kWh": {name: joule / 3.6e6 for name, joule in found.energy().items()},
        "brake_wear_cm3": 1e6 * found.pad_wear(),
        "stops": [
            {
                "name": stop.point.name,
                "station_m": stop.point.station,
                "time_s": stop.arrival,
                "dwell_s": stop.departure - stop.arrival,
                "error_m": stop.error,
            }
            for stop in found.stops
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


def _or_never(seconds: float | None) -> str:
    return "never: a mass point stalls" if seconds is None else f"{clock(seconds)} min"


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
        ("… by distance steps of 20 m", _or_never(content["running_time_by_distance_steps_s"])),
        ("length", f"{1e-3 * content['length_m']:.3f} km"),
        ("mass of the train", f"{content['mass_t']:.1f} t"),
        ("mean speed", f"{content['mean_speed_kmh']:.1f} km/h"),
        ("highest speed", f"{content['highest_speed_kmh']:.1f} km/h"),
        ("work of the motors at the wheels", f"{content['energy_kWh']['motors']:.1f} kWh"),
        ("… against resistance and gradient",
         f"{content['energy_kWh']['resistance_and_gradient']:.1f} kWh"),
        ("… taken back by the electric brake", f"{content['energy_kWh']['electric_brake']:.1f} kWh"),
        ("… lost in brake shoes", f"{content['energy_kWh']['brake_shoes']:.1f} kWh"),
        ("… lost in creep", f"{content['energy_kWh']['creep']:.2f} kWh"),
        ("brake pads or blocks worn off, assumed 0.3 cm³/MJ", f"{content['brake_wear_cm3']:.0f} cm³"),
        *(
            (f"stop at {stop['station_m']:.1f} m, {stop['name']}" +
             (f", for {stop['dwell_s']:.0f} s" if stop["dwell_s"] else ""),
             f"{clock(stop['time_s'])} min")
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
