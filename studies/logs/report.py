"""What the analysis of a log prints: tables for people, the same and all of it as JSON."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from alloc.estimation.measured_run import Findings, train_acceleration
from alloc.estimation.slip_events import SlipCriterion
from studies.logs.measured_log import MeasuredLog

BRAKING = 0.1
"""Deceleration [m/s2] from which on a train counts as braking, and acceleration from which on as driving."""
MOST_ROWS = 40
"""Rows of a printed table of remarks or slips; JSON has all."""


def content(log: MeasuredLog, found: Findings, criterion: SlipCriterion) -> dict[str, Any]:
    """Everything found, for JSON: SI units but where a key says otherwise, None for what is not known."""
    return {
        "log": log.source,
        "train": log.train.name,
        "rows": int(log.run.time.size),
        "duration_s": float(log.run.time[-1] - log.run.time[0]),
        "period_s": log.period,
        "speed_source": "measured" if log.run.speed_deviation is None else "estimated",
        "speed_error_ms": _speed_error(log),
        "parts": int(log.run.part[-1]) + 1,
        "force_window_s": found.window,
        "criterion": {"slip_velocity_ms": criterion.velocity, "slip_ratio": criterion.ratio},
        "remarks": [
            {
                "kind": remark.kind,
                "column": remark.column,
                "row": remark.row,
                "time_s": remark.time,
                "text": remark.text,
            }
            for remark in log.remarks
        ],
        "damage_kj": _number(1e-3 * found.total_damage) if found.covered.any() else None,
        "utilisation": _number(found.utilisation),
        "axles": [_axle(log, found, i) for i in range(log.train.radius.size)],
        "events": [
            {
                "axle": event.axle + 1,
                "car": int(log.train.axle_car[event.axle]) + 1,
                "kind": event.kind,
                "start_s": event.start,
                "end_s": event.end,
                "cut": event.cut,
                "largest_slip_ms": event.largest_slip,
                "slip_ratio": event.slip_ratio,
                "onset_s": _number(event.onset_time),
                "onset_coefficient": _number(event.onset_coefficient),
                "utilisation": _number(event.utilisation),
                "damage_kj": _number(1e-3 * event.damage),
            }
            for event in found.events
        ],
        "cars": _cars(log, found),
        "car_acceleration": None
        if found.car_force is None
        else ("of the train" if log.run.car_acceleration is None else "of each car"),
    }


def _speed_error(log: MeasuredLog) -> dict[str, float] | None:
    """Mean and largest standard deviation of an estimated speed [m/s]."""
    if log.run.speed_deviation is None:
        return None
    known = log.run.speed_deviation[np.isfinite(log.run.speed_deviation)]
    return {"mean": float(known.mean()), "largest": float(known.max())}


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _axle(log: MeasuredLog, found: Findings, axle: int) -> dict[str, Any]:
    own = [event for event in found.events if event.axle == axle]
    onsets = np.array([event.onset_coefficient for event in own])
    onsets = onsets[np.isfinite(onsets)]
    used = np.abs(found.coefficient[:, axle])
    return {
        "axle": axle + 1,
        "car": int(log.train.axle_car[axle]) + 1,
        "driven": bool(log.train.driven[axle]),
        "known_s": float(found.covered[axle]),
        "slips": sum(event.kind == "slip" for event in own),
        "slides": sum(event.kind == "slide" for event in own),
        "slipping_s": float(found.slipping_time[axle]),
        "largest_slip_ms": max((event.largest_slip for event in own), key=abs, default=None),
        "onset_coefficient": float(onsets.mean()) if onsets.size else None,
        "largest_coefficient": float(np.nanmax(used)) if np.isfinite(used).any() else None,
        "damage_kj": _number(1e-3 * found.axle_damage[axle]),
    }


def _cars(log: MeasuredLog, found: Findings) -> list[dict[str, Any]] | None:
    """Mean brake force of each car while the train brakes and while it drives [kN]."""
    if found.car_force is None:
        return None
    rate = train_acceleration(log.run, found.window)
    return [
        {
            "car": car + 1,
            "brake_force_braking_kn": _mean(1e-3 * force, rate < -BRAKING),
            "brake_force_driving_kn": _mean(1e-3 * force, rate > BRAKING),
        }
        for car, force in enumerate(found.car_force.T)
    ]


def _mean(values: NDArray[np.float64], chosen: NDArray[np.bool_]) -> float | None:
    known = values[chosen & np.isfinite(values)]
    return float(known.mean()) if known.size else None


def tables(report: dict[str, Any]) -> list[RenderableType]:
    """The same for a terminal, from what `content` gives."""
    items: list[RenderableType] = []
    error = report["speed_error_ms"]
    if error is not None:
        items.append(
            f"speed source: estimated, stated error {error['mean']:.2g} m/s (largest {error['largest']:.2g} m/s)"
        )
    if report["remarks"]:
        rows = [(r["kind"], r["column"], r["text"]) for r in report["remarks"]]
        items += _limited("remarks on the log", ("what", "column", ""), rows, "")
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
    if report["cars"] is not None:
        cars = [
            (c["car"], _shown(c["brake_force_braking_kn"], ".1f"), _shown(c["brake_force_driving_kn"], ".1f"))
            for c in report["cars"]
        ]  # fmt: skip
        car_heads = ("car", "mean under braking [kN]", "mean under traction [kN]")
        title = f"brake force per car, by the acceleration {report['car_acceleration']}"
        items.append(_table(title, car_heads, cars))
    total, used = report["damage_kj"], report["utilisation"]
    items.append(
        f"{report['rows']} rows in {report['parts']} part{'s' if report['parts'] > 1 else ''}; wheel damage Q "
        + ("not known" if total is None else f"{total:.4g} kJ")
        + ("" if used is None else f"; in slips {100.0 * used:.1f} % of the coefficient seen at their onset was used")
    )  # fmt: skip
    return items


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
