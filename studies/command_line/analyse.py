"""`readhesion analyse`: what the log of a train tells about its slips."""

import json
from typing import Annotated

from cyclopts import Parameter

from studies.command_line.options import FilePath
from studies.command_line.terminal import console
from studies.files.study_error import StudyError
from studies.files.writable import FIGURE, check_file


def analyse(
    log: FilePath,
    *,
    train: str,
    figure: FilePath | None = None,
    slip_kmh: float = 0.72,
    slip_percent: float = 5.0,
    as_json: Annotated[bool, Parameter("--json", negative=())] = False,
) -> None:
    """Find slips and slides in the log of a train, and what its wheels and brakes did.

    The log is a CSV (decimal points, commas between columns) or parquet table with one row per instant. Its columns carry
    their units: time_s; speed_kmh or speed_ms of the train; axle1_speed_kmh (or _ms, _rads) ...; axle1_torque_nm (or _knm)
    at the wheel or axle1_force_kn (or _n) at the rim ...; if measured coupler1_force_kn ... and car1_acceleration_ms2 ...
    Axles and cars count from the front; traction and tension are positive. `readhesion list` has them all.

    Without a column of the train's speed it is estimated from speed and force of the axles, of all driven ones at least,
    as on board (docs/reference-speed.md), with gradient_permille if there is one; the estimate's error is stated.

    Found are: slips and slides; the coefficient of each axle; its value as slips begin, which estimates the adhesion,
    since the true one is unknown; wheel damage Q (JP4209318); the share of that adhesion used in slips; and the brake
    force of each car where coupler forces are there.

    Gaps, missing and stuck values are reported and cut out, and the parts between are analysed each by itself. A log
    that cannot be analysed ends with exit code 2 and the column and row that are to blame.

    Parameters
    ----------
    log
        File of the log (csv or parquet).
    train
        Name of a shipped train, railtoolkit file (.yaml), or TOML file with masses, radii and
        inertias (`readhesion simulate --log` writes one).
    figure
        File for a figure (pdf, png or svg).
    slip_kmh
        Slip velocity from which on an axle slips [km/h] ...
    slip_percent
        ... if it is also this much of the speed [%].
    as_json
        Print everything as JSON instead of tables.
    """
    from alloc.estimation.measured_run import analyse_run
    from alloc.estimation.slip_events import SlipCriterion
    from studies.logs.measured_log import read_log
    from studies.logs.measured_train import read_log_train
    from studies.logs.report import content, tables

    for name, value in (("--slip-kmh", slip_kmh), ("--slip-percent", slip_percent)):
        if not 0.0 < value < float("inf"):
            raise StudyError(f"{name} {value}: must be greater than 0")
    criterion = SlipCriterion(slip_kmh / 3.6, 1e-2 * slip_percent)
    check_file(figure, FIGURE)
    measured = read_log(log, read_log_train(train))
    found = analyse_run(measured.run, measured.train, criterion)
    report = content(measured, found, criterion)
    if figure is not None:
        from studies.core.gallery import gallery

        gallery().draw_one("measured-log", figure, measured, found)
    if as_json:
        print(json.dumps(report, indent=2, allow_nan=False))
        return
    screen = console()
    screen.print(f"[bold]{measured.source}[/bold], train {measured.train.name}")
    for item in tables(report):
        screen.print(item)
