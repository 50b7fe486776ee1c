"""`readhesion analyse`: slips, wheel damage and brake forces from the logs of a train."""

import json
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from studies.command_line.options import ALL_FAILED, FilePath, command_of, console, progress, said
from studies.files.study_error import StudyError
from studies.files.writable import FIGURE, check_file, check_place, make_folder

if TYPE_CHECKING:
    from alloc.estimation.slip_events import SlipCriterion
    from studies.logs.mapping import Mapping
    from studies.logs.measured_log import MeasuredLog
    from studies.logs.measured_run import Findings
    from studies.logs.train import GradientLine, MeasuredTrain

SLIP_KMH, SLIP_PERCENT = 0.72, 5.0
"""Slip velocity and share of the speed from which on an axle slips."""
BESIDE = "log.toml"
"""Mapping file that is used where it lies beside the log."""


@Parameter(name="*")
@dataclass(frozen=True)
class Further:
    """What is looked at beyond slips."""

    brakes: bool = False
    """Smooth each car's brake force, and name cars that fall short of their share of it: couplers and accelerations of all
    cars must be in the log."""
    resistance: bool = False
    """Learn the running resistance (JP H07-322414, claim 7)."""
    against: str | None = None
    """Compare with a simulated run of the same train: what `readhesion simulate` wrote by `--log` or `--out`, or a
    scenario."""
    draft: Annotated[FilePath | None, Parameter("--map")] = None
    """Write a draft of the mapping file here (.toml), and nothing else; guesses of names and units are marked."""


SLIPS_ALONE = Further()


def analyse(
    *logs: FilePath,
    train: str,
    mapping: FilePath | None = None,
    line: FilePath | None = None,
    start_m: float | None = None,
    out: FilePath | None = None,
    events: FilePath | None = None,
    figure: FilePath | None = None,
    slip_kmh: float = SLIP_KMH,
    slip_percent: float = SLIP_PERCENT,
    further: Further = SLIPS_ALONE,
    as_json: Annotated[bool, Parameter("--json", negative=())] = False,
) -> int | None:
    """Find slips and slides in logs of a train, and what its wheels and brakes did.

    A log is a table of text (any usual separator, decimal and compression), parquet, MDF 3 or 4, TDMS, or MATLAB's .mat.
    Columns with the names that `readhesion list` shows (time_s, speed_kmh, axle1_speed_kmh, axle1_force_kn ...) need nothing
    else. A mapping file says what other columns are (docs/logs.md); --map writes a draft. Without one the log is read by
    this draft, and what was guessed is printed. Axles and cars count from the front; traction and tension are positive.

    Every channel is brought from its own samples to common instants, with an error: the train's speed may be late, rare or
    held, wheels may count pulses. Without it the speed is estimated from speed and force of the axles, of all driven
    ones at least, as on board (docs/reference-speed.md). Gaps and stuck values are reported and cut out.

    It finds slips and slides, and the coefficient of each axle. The true adhesion is unknown; the coefficient at the onset
    of slips estimates it. It also finds wheel damage Q (JP4209318) with its error, and the share of that adhesion used in
    slips. Where the log has coupler forces, it finds the brake force of each car.

    A log that cannot be analysed ends with exit code 2 and a message that names column and row. If several logs
    are given, the others are still analysed, and the exit code is 1 if all failed.

    Parameters
    ----------
    logs
        Files of logs of one train.
    train
        Name of a shipped train, railtoolkit file (.yaml), a scenario's train file (.toml), or TOML
        file with masses, radii and inertias (`readhesion simulate --log` writes one).
    mapping
        TOML file that says which column is what [default: log.toml beside the log, if there is one].
    line
        Railtoolkit running path that has the gradients, by the log's position.
    start_m
        Station at which the log begins [m], where it has no position.
    out
        Folder for a report (JSON) of each log.
    events
        File for the list of all slips (csv).
    figure
        File for a figure of a single log (pdf, png or svg).
    slip_kmh
        Slip velocity from which an axle counts as slipping [km/h] ...
    slip_percent
        ... if it is also this much of the speed [%].
    as_json
        Print everything as JSON instead of tables.
    """
    from alloc.estimation.slip_events import SlipCriterion
    from alloc.sources import write_whole
    from studies.logs.mapping import read_mapping
    from studies.logs.report_tables import write_events
    from studies.logs.train import read_gradients, read_log_train

    for name, value in (("--slip-kmh", slip_kmh), ("--slip-percent", slip_percent)):
        if not 0.0 < value < float("inf"):
            raise StudyError(f"{name} {value}: must be greater than 0")
    if not logs:
        raise StudyError("no log is given; name one file or several")
    for option, path in (("--figure", figure), ("--map", further.draft)):
        if path is not None and len(logs) > 1:
            raise StudyError(f"{option} is for a single log")
    if further.draft is not None:
        _write_draft(logs[0], train, further.draft)
        return None
    check_file(figure, FIGURE)
    check_file(events, (".csv",))
    if out is not None:
        check_place(out)
    setting = _Setting(
        read_log_train(train), None if mapping is None else (read_mapping(mapping), str(mapping)),
        None if line is None else read_gradients(line, start_m),
        SlipCriterion(slip_kmh / 3.6, 1e-2 * slip_percent), further,
    )  # fmt: skip
    failed: dict[str, str] = {}
    if len(logs) == 1:
        command = command_of(
            "analyse", str(logs[0]), train=[train], mapping=said(mapping), line=said(line), start_m=said(start_m),
            slip_kmh=said(slip_kmh, SLIP_KMH), slip_percent=said(slip_percent, SLIP_PERCENT),
        )  # fmt: skip
        reports = [_one(logs[0], setting, figure, command)]
    else:
        reports, failed = _batch(logs, setting)
    if out is not None:
        make_folder(out)
        for report, path in zip(reports, _places(reports, out), strict=True):
            text = json.dumps(report, indent=2, allow_nan=False)
            write_whole(path, partial(Path.write_text, data=text, encoding="utf-8"))
    if events is not None:
        write_events(reports, events)
    _show(reports, failed, as_json, len(logs))
    return ALL_FAILED if failed and not reports else None


def _write_draft(log: Path, train: str, path: Path) -> None:
    """Write the draft of a mapping file; raises `StudyError` where there is a file, which somebody may have corrected."""
    from alloc.sources import write_whole
    from studies.logs.mapping import draft_text
    from studies.logs.recorder_files import read_recording
    from studies.logs.train import read_log_train

    if path.exists():
        raise StudyError(f"--map {str(path)!r}: is there already; name another, or delete it")
    check_file(path, (".toml",))
    text = draft_text(read_recording(log), read_log_train(train))
    write_whole(path, partial(Path.write_text, data=text, encoding="utf-8"))
    guessed = sum("guessed from" in line for line in text.splitlines())
    console().print(f"{str(path)!r} is written; {guessed} columns are guessed: check them")


@dataclass(frozen=True)
class _Setting:
    """What all logs of a call share."""

    train: "MeasuredTrain"
    mapping: "tuple[Mapping, str] | None"
    line: "GradientLine | None"
    criterion: "SlipCriterion"
    further: Further


def _one(
    path: Path, setting: _Setting, figure: Path | None = None, command: str = ""
) -> dict[str, Any]:
    """The report of a log, and its figure, which `command` gives; raises `StudyError`."""
    from studies.logs.mapping import read_mapping
    from studies.logs.measured_log import read_log
    from studies.logs.measured_run import analyse_run
    from studies.logs.report import content

    mapping, owner = setting.mapping or (None, "")
    beside = path.parent / BESIDE
    if mapping is None and beside.is_file():
        mapping, owner = read_mapping(beside), str(beside)
    measured = read_log(path, setting.train, mapping, setting.line, f"mapping file {owner!r}")
    found = analyse_run(measured.run, measured.train, setting.criterion)
    report = content(measured, found, setting.criterion)
    report["mapping"] = owner or None
    report |= _more(measured, found, setting)
    if figure is not None:
        from studies.core.gallery import gallery

        gallery().draw_one("measured-log", figure, measured, found, command=command)
    return report


def _more(measured: "MeasuredLog", found: "Findings", setting: _Setting) -> dict[str, Any]:
    """What was asked for beyond slips."""
    wanted: dict[str, Any] = {}
    if setting.further.brakes:
        from studies.logs.force_reports import brake_report

        wanted["brakes"] = brake_report(measured)
    if setting.further.resistance:
        from studies.logs.force_reports import resistance_report

        wanted["resistance"] = resistance_report(measured, setting.line)
    if setting.further.against is not None:
        from studies.logs.simulated import compared, simulated_log

        other = simulated_log(setting.further.against, measured.train)
        wanted["comparison"] = compared(measured, found, other, setting.criterion)
    return wanted


def _batch(
    logs: tuple[Path, ...], setting: _Setting
) -> tuple[list[dict[str, Any]], dict[str, str]]:
    """Reports of logs, and why others have none."""
    from alloc.errors import InputError

    reports, failed = [], {}
    with progress() as on_row:
        for number, path in enumerate(logs):
            on_row(path.name, number, len(logs))
            try:
                reports.append(_one(path, setting))
            except (StudyError, InputError, OSError) as error:
                failed[str(path)] = " ".join(str(error).split())
    return reports, failed


def _places(reports: list[dict[str, Any]], out: Path) -> list[Path]:
    """A file for each report, of the log's name; logs of one name get a number."""
    places: list[Path] = []
    for report in reports:
        name, k = Path(report["log"]).name, 1
        place = out / f"{name}.json"
        while place in places:
            k += 1
            place = out / f"{name}.{k}.json"
        places.append(place)
    return places


def _show(reports: list[dict[str, Any]], failed: dict[str, str], as_json: bool, count: int) -> None:
    from rich.markup import escape

    from studies.logs.report_tables import overview, tables

    if as_json:
        content: Any = reports[0] if count == 1 else {"reports": reports, "failed": failed}
        print(json.dumps(content, indent=2, allow_nan=False))
        return
    screen = console()
    if count == 1:
        screen.print(
            f"[bold]{escape(reports[0]['log'])}[/bold], train {escape(reports[0]['train'])}"
        )
        for item in tables(reports[0]):
            screen.print(item)
        return
    if reports:
        screen.print(overview(reports))
    for name, reason in failed.items():
        screen.print(f"[red]failed[/red] {escape(name)}: {escape(reason)}", highlight=False)
