"""Printed tables of the analysis of logs, from the result of `studies.logs.report.content`."""

from pathlib import Path
from typing import Any

import pandas as pd
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from alloc.sources import write_whole
from studies.files.study_error import StudyError
from studies.files.writable import as_csv
from studies.logs.remarks import KINDS, NAMED
from studies.logs.simulated import QUANTITIES

MOST_ROWS = 40
"""Rows of a printed table of slips; JSON has all."""


def tables(report: dict[str, Any]) -> list[RenderableType]:
    """The report of one log."""
    items: list[RenderableType] = []
    items.append(_speed_line(report))
    if report["remark_groups"]:
        rows = [
            (KINDS.get(g["kind"], g["kind"]), g["count"], _few(g["columns"]), g["text"])
            for g in report["remark_groups"]
        ]
        items.append(_table("remarks on the log", ("what", "times", "column", ""), rows))
    axles = [
        (
            a["axle"], a["car"], "yes" if a["driven"] else "", _shown(a["known_s"], ".1f"),
            a["slips"] or "", a["slides"] or "", _shown(a["slipping_s"] or None, ".2f"),
            _shown(a["largest_slip_ms"], "+.2f"), _shown(a["onset_coefficient"], ".3f"),
            _shown(a["largest_coefficient"], ".3f"), _shown(a["damage_kj"], ".2f"),
        )
        for a in report["axles"]
    ]  # fmt: skip
    axle_heads = (
        "axle", "car", "driven", "known [s]", "slips", "slides", "slipping [s]", "largest slip [m/s]",
        "coefficient at onsets", "largest coefficient", "Q [kJ]",
    )  # fmt: skip
    items.append(_table("axles", axle_heads, axles))
    events = [
        (
            e["axle"], e["car"], e["kind"] + (" (cut)" if e["cut"] else ""), f"{e['start_s']:.2f}",
            f"{e['end_s']:.2f}", f"{e['largest_slip_ms']:+.2f}", f"{100.0 * e['slip_ratio']:.1f}",
            _shown(e["onset_coefficient"], ".3f"), _shown(e["utilisation"], ".2f"),
            _shown(e["damage_kj"], ".2f"),
        )
        for e in report["events"]
    ]  # fmt: skip
    event_heads = (
        "axle", "car", "", "from [s]", "to [s]", "largest slip [m/s]", "slip ratio [%]",
        "coefficient at onset", "used of it", "Q [kJ]",
    )  # fmt: skip
    items += _limited("slips and slides", event_heads, events, "no axle slipped by this criterion")
    least = [value for value in report["small_criterion"]["slip_velocity_ms"] if value is not None]
    if least:
        small = report["small_events"]
        where = sorted({e["axle"] for e in small})
        low, high = (f"{one:.2g}" for one in (min(least), max(least)))
        bounds = low if low == high else f"{low} to {high}"
        ratio = 100.0 * report["small_criterion"]["slip_ratio"]
        items.append(
            f"slips below that, from {ratio:.0f} % and {bounds} m/s on "
            f"(4 standard deviations of the slip velocity): {len(small)}"
            + (f", axles {_few([str(axle) for axle in where])}" if small else "")
        )
    if report["cars"] is not None:
        cars = [
            (c["car"], _shown(c["brake_force_braking_kn"], ".1f"), _shown(c["brake_force_driving_kn"], ".1f"))
            for c in report["cars"]
        ]  # fmt: skip
        car_heads = ("car", "mean under braking [kN]", "mean under traction [kN]")
        title = f"brake force per car, by the acceleration {report['car_acceleration']}"
        items.append(_table(title, car_heads, cars))
    items += _further(report)
    total, used = report["damage_kj"], report["utilisation"]
    items.append(
        f"{report['rows']} rows in {report['parts']} part{'s' if report['parts'] > 1 else ''}; wheel damage Q "
        + ("not known" if total is None else f"{total:.4g} kJ{_error(report)}")
        + ("" if used is None else f"; in slips {100.0 * used:.1f} % of the coefficient seen at their onset was used")
    )  # fmt: skip
    return items


def overview(reports: list[dict[str, Any]]) -> Table:
    """A row for each of several logs."""
    heads = ("log", "time [s]", "speed", "slips", "slides", "smaller", "Q [kJ]", "±", "remarks", "")
    rows = []
    for r in reports:
        error, delay = r["damage_error_kj"], r["speed_delay"]
        rows.append(
            (
                Path(r["log"]).name, f"{r['duration_s']:.0f}", r["speed_source"], _count(r, "slip"), _count(r, "slide"),
                len(r["small_events"]) or "", _shown(r["damage_kj"], ".4g"),
                "–" if error is None else f"{error['total']:.2g}", len(r["remarks"]) or "",
                "FLAGGED: delay" if delay is not None and delay["flagged"] else "",
            )
        )  # fmt: skip
    return _table("logs", heads, rows)


def _count(report: dict[str, Any], kind: str) -> int | str:
    return sum(event["kind"] == kind for event in report["events"]) or ""


def _further(report: dict[str, Any]) -> list[RenderableType]:
    """Brakes, resistance and comparison, where they were asked for."""
    items: list[RenderableType] = []
    for key, missing in (
        (
            "brakes",
            "brake forces are not smoothed: coupler forces and accelerations of all cars are needed, and a braking",
        ),
        ("resistance", "running resistance is not learnt: no axle has a force"),
    ):
        if key in report and (report[key] is None or "reason" in report[key]):
            items.append(missing if report[key] is None else f"{key}: {report[key]['reason']}")
        elif key in report:
            items.append(_brakes(report[key]) if key == "brakes" else _resistance(report[key]))
    if "comparison" in report:
        items += _comparison(report["comparison"])
    return items


def _brakes(brakes: dict[str, Any]) -> Table:
    heads = ("car", "brake force [kN]", "±", "shortfall [kN]", "accused from [kN]", "")
    rows = [
        (
            c["car"], f"{c['brake_force_kn']:.2f}", f"{c['deviation_kn']:.2f}", f"{c['shortfall_kn']:+.2f}",
            f"{c['threshold_kn']:.2f}", "falls short" if c["accused"] else "",
        )
        for c in brakes["cars"]
    ]  # fmt: skip
    title = f"brake force per car, smoothed, {brakes['start_s']:.1f} to {brakes['end_s']:.1f} s"
    return _table(title, heads, rows)


def _resistance(found: dict[str, Any]) -> Table:
    units = {"W1": "kg/m", "W2": "kg/m", "W3": "kg", "A": "N", "B": "N s/m"}
    rows = [
        (name, f"{w['value']:.5g}", f"{w['deviation']:.2g}", units[name], "yes" if w["learnt"] else "no")
        for name, w in found["weights"].items()
    ]  # fmt: skip
    title = f"running resistance (JP H07-322414), gradient {found['gradient']}"
    return _table(title, ("weight", "value", "±", "unit", "told by this log"), rows)


def _comparison(found: dict[str, Any]) -> list[RenderableType]:
    rows = [
        (label, _shown(found["log"][name], ".4g"), _shown(found["simulated"][name], ".4g"))
        for name, label in QUANTITIES.items()
    ]
    items: list[RenderableType] = [
        _table(f"beside the simulated run {found['run']}", ("what", "log", "simulated"), rows)
    ]
    if found["damage_differs"] is not None:
        items.append(
            "Q differs by more than twice its errors"
            if found["damage_differs"]
            else "Q differs by no more than twice its errors"
        )
    return items


def _speed_line(report: dict[str, Any]) -> str:
    """Where the train's speed is from, with its error and its delay."""
    error, delay = report["speed_error_ms"], report["speed_delay"]
    text = f"speed source: {report['speed_source']}"
    if error is not None:
        text += f", stated error {error['mean']:.2g} m/s (largest {error['largest']:.2g} m/s)"
    if delay is not None:
        text += f"; {delay['delay_s']:+.3f} ± {delay['deviation_s']:.2g} s late"
        text += ", made up for" if delay["made_up_for"] else ""
        text += "; FLAGGED: see remarks" if delay["flagged"] else ""
    return text


def _error(report: dict[str, Any]) -> str:
    error = report["damage_error_kj"]
    if error is None:
        return ""
    return f" ± {error['total']:.2g} kJ, and {error['per_permille_of_radius']:+.2g} kJ per 1 ‰ of wheel radius"


def _few(names: list[str]) -> str:
    """Names, the first few of many."""
    if len(names) <= NAMED:
        return ", ".join(names)
    return f"{', '.join(names[:NAMED])} and {len(names) - NAMED} more"


def _shown(value: float | None, form: str) -> str:
    return "–" if value is None else format(value, form)


def _limited(
    title: str, heads: tuple[str, ...], rows: list[tuple[Any, ...]], none: str
) -> list[RenderableType]:
    if not rows:
        return [none]
    items: list[RenderableType] = [_table(title, heads, rows[:MOST_ROWS])]
    if len(rows) > MOST_ROWS:
        items.append(f"and {len(rows) - MOST_ROWS} more; --json has all")
    return items


def _table(title: str, heads: tuple[str, ...], rows: list[tuple[Any, ...]]) -> Table:
    table = Table(title=escape(title), title_justify="left")
    for head in heads:
        table.add_column(
            escape(head), justify="left" if head in ("", "what", "column") else "right"
        )
    for row in rows:
        table.add_row(*(escape(str(cell)) for cell in row))
    return table


COLUMNS = (
    "log", "axle", "car", "kind", "small", "start_s", "end_s", "cut", "largest_slip_ms", "slip_ratio", "onset_s",
    "onset_coefficient", "utilisation", "damage_kj",
)  # fmt: skip


def event_table(reports: list[dict[str, Any]]) -> pd.DataFrame:
    """A row per slip or slide of the logs whose `studies.logs.report.content` is given; small ones are marked."""
    rows = [
        {"log": report["log"], "small": small, **event}
        for report in reports
        for small, key in ((False, "events"), (True, "small_events"))
        for event in report[key]
    ]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def write_events(reports: list[dict[str, Any]], path: Path) -> None:
    """Write the table as CSV; raises `StudyError` if that fails."""
    try:
        write_whole(
            path, lambda aside: aside.write_text(as_csv(event_table(reports)), "utf-8", newline="")
        )
    except OSError as error:
        raise StudyError(f"file {str(path)!r} cannot be written: {error.strerror}") from None
