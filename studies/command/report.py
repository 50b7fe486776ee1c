"""The last comparison as one page that opens offline: answer, forests, numbers, events, replays, sources.

Python gives tables and data to the template `report.html`. Plotly's JavaScript draws; the page holds it.
"""

from collections.abc import Sequence
from functools import partial
from html import escape
from inspect import getsource
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from alloc.evaluation import metrics
from alloc.evaluation.metrics import METRICS
from alloc.files import write_whole
from alloc.onboard.controllers import CONTROLLERS
from alloc.plant import curves
from alloc.rules import RULES
from studies import StudyError, compare
from studies.benchmark import summarise_stored
from studies.command.citations import Citation, find_uses
from studies.compare import REFERENCE, Standing
from studies.files.scenario import Scenario
from studies.files.scenario_files import load_scenario, shipped_names
from studies.files.toml_keys import suggest_name
from studies.run_cell import recorded
from studies.runner.progress import show_progress
from studies.runner.provenance import describe_origin
from studies.standing import EFFORT

SHOWN_EVENTS = 3
"""Events that are replayed where nobody names them."""
FRAMES = 100
"""Instants of a replay, at most."""
MOST_NUMBERS = 1_300_000
"""In all replays together, about 5 bytes each: with plotly's 4.8 MB the page stays below 12 MB."""


def write_report(folder: Path, out: Path, events: Sequence[str] = ()) -> None:
    """Write the page of the comparison whose rows are in `folder` to `out`, with replays of `events`.

    Events are scenarios that ship, or TOML files. Raises `StudyError` where there is no comparison, where a part of it is
    not registered, or where jinja2 or plotly is missing.
    """
    try:
        from jinja2 import Environment, StrictUndefined
        from markupsafe import Markup
        from plotly.offline import get_plotlyjs
    except ImportError:
        needs = "a report needs jinja2 and plotly: pip install 'readhesion[report]'"
        raise StudyError(needs) from None
    rows = _read_rows(folder)
    places = compare.rank_rules(rows)
    by_name = compare.group_by_controller(places)
    replays, left_out = _compute_replays(rows, places, _choose_events(rows, events))
    environment = Environment(autoescape=True, undefined=StrictUndefined)
    environment.policies["json.dumps_kwargs"] = {"separators": (",", ":")}  # names in our order
    text = environment.from_string(Path(__file__).with_suffix(".html").read_text("utf-8")).render(
        plotly=Markup(get_plotlyjs()),
        reference=REFERENCE if REFERENCE in rows["rule"].values else "",
        answer=[
            *filter(None, [summarise_stored(rows)]),
            *compare.summarise_standings(places).splitlines(),
        ],
        about={kind: rows[kind].nunique() for kind in ("scenario", "rule", "controller", "seed")},
        runs=len(rows),
        forests=[_forest_of(controller, under) for controller, under in by_name.items()],
        informed=compare.list_information([place.rule for place in places]),
        numbers=Markup(_number_table(places)),
        metrics=Markup(_metric_table(rows)),
        failed=Markup(_failure_table(rows)),
        events={name: Markup(_event_table(rows[rows["controller"] == name])) for name in by_name},
        replays=replays,
        left_out=left_out,
        computed=pd.to_datetime(rows["batch"].max()).strftime("%d %B %Y, %H:%M UTC"),
        provenance=describe_origin(),
        sources=_cited_sources(places),
    )
    write_whole(out, partial(Path.write_text, data=text, encoding="utf-8"))


def _read_rows(folder: Path) -> pd.DataFrame:
    path = folder / "rows.parquet"
    if not path.is_file():
        raise StudyError(f"{folder} has no comparison: run readhesion compare first")
    rows = pd.read_parquet(path)
    compare.check_parts(rows)
    if not (rows["status"] == "ok").any():
        raise StudyError(f"every run of {folder} failed, such as by: {rows['reason'].iloc[0]}")
    return rows


# tables and forests


def _forest_of(controller: str, places: Sequence[Standing]) -> dict[str, Any]:
    """Gains over the reference [points] under a controller, for the page to draw; the best last, which is on top."""
    drawn = [place for place in places if place.rule != REFERENCE][::-1]
    gains = [place.numbers["gain"] for place in drawn]
    spans = [
        (gain.value - gain.low, gain.high - gain.value) if gain.low < gain.high else (0.0, 0.0)
        for gain in gains
    ]
    return {
        "controller": controller,
        "labels": [escape(place.name) for place in drawn],  # plotly reads labels as HTML
        "gain": [100.0 * gain.value for gain in gains],
        "less": [100.0 * less for less, _ in spans],
        "more": [100.0 * more for _, more in spans],
        "colours": [RULES[place.rule].colour for place in drawn],
        "symbols": ["circle-open" if place.mark else "circle" for place in drawn],
    }


def _number_table(places: Sequence[Standing]) -> str:
    """Standings in words that sort by their first number."""
    rows = [
        {
            "rule": place.name,
            "controller": place.controller,
            "bound used [%]": place.numbers["used"].text(1, 100.0),
            f"points over {REFERENCE}": place.numbers["gain"].text(2, 100.0, sign=True),
            "wheel damage [kJ]": place.numbers["damage"].text(1, sign=True),
            "slip [axle s]": place.numbers["slip"].text(1, sign=True),
            "beyond the plan [%]": f"{100.0 * place.over_delivery:.2f}",
        }
        for place in places
    ]
    return _html_table(pd.DataFrame(rows))


def _metric_table(rows: pd.DataFrame) -> str:
    """Mean of every metric over the runs that succeeded."""
    good = rows[rows["status"] == "ok"]
    names = [name for name in METRICS if name in good and good[name].notna().any()]
    means = good.groupby(["rule", "controller"], sort=False)[names].mean().reset_index()
    titles = {name: f"{name} [{METRICS[name].unit}]" for name in names}
    return _html_table(means.rename(columns=titles), float_format="{:.4g}".format)


def _failure_table(rows: pd.DataFrame) -> str:
    bad = rows[rows["status"] != "ok"]
    causes = bad.groupby(["rule", "controller", "status", "reason"], sort=False).size()
    return "" if bad.empty else _html_table(causes.reset_index(name="runs"))


def _event_table(rows: pd.DataFrame) -> str:
    """Bound used [%] by the reference, and points that the others add, event by rule; the best rule first."""
    good = rows[rows["status"] == "ok"]
    used = 100.0 * good.pivot_table(index="scenario", columns="rule", values=EFFORT, sort=False)
    used = used[used.mean().sort_values(ascending=False).index]
    if REFERENCE in used:
        base = used.pop(REFERENCE)
        gains = used.sub(base, axis=0).map(_tint_points)
        used = pd.concat([base.map("{:.1f}".format), gains], axis=1)
    used = used.rename(index=escape, columns=escape).rename_axis(columns=None)
    return _html_table(used.reset_index(names="event"), escape=False, float_format="{:.1f}".format)


def _tint_points(points: float) -> str:
    """A cell, tinted the stronger the more the rule gains or loses; five points have the full tint."""
    if np.isnan(points):
        return "–"
    side, strength = "gain" if points > 0.0 else "loss", min(100.0, 20.0 * abs(points))
    text = f"{round(points, 1) + 0.0:+.1f}".replace("-", "−")
    return f'<span class="{side}" style="--strength:{strength:.0f}%">{text}</span>'


def _html_table(data: pd.DataFrame, **options: Any) -> str:
    return str(data.to_html(index=False, border=0, na_rep="–", justify="inherit", **options))


# replays


def _choose_events(rows: pd.DataFrame, events: Sequence[str]) -> list[Scenario]:
    """The named events; else those that ship in which the best rule gains most over the reference."""
    names = [str(name) for name in rows["scenario"].unique()]
    chosen = [load_scenario(name) for name in events]
    for event in chosen:
        if event.name not in names:
            hint = suggest_name(event.name, names)
            raise StudyError(f"event {event.name!r} is not in this comparison{hint}")
    good = rows[(rows["status"] == "ok") & rows["scenario"].isin(shipped_names())]
    used = good.pivot_table(index="scenario", columns="rule", values=EFFORT)
    gain = used.max(axis=1) - (used[REFERENCE] if REFERENCE in used else used.min(axis=1))
    return chosen or [load_scenario(str(name)) for name in gain.nlargest(SHOWN_EVENTS).index]


def _compute_replays(
    rows: pd.DataFrame, places: Sequence[Standing], events: Sequence[Scenario]
) -> tuple[dict[str, Any], int]:
    """Event -> its title, and controller -> rule -> run; beside it the number of runs that found no room.

    First the reference, then what cannot be told from the best, then the other rules.
    """
    tied = [place.rule for place in places if place.tied]
    rules = list(dict.fromkeys([REFERENCE, *tied, *(place.rule for place in places)]))
    seeds = {event.name: event.first_seed for event in events}
    good = rows[(rows["status"] == "ok") & (rows["seed"] == rows["scenario"].map(seeds))]
    stored = good.set_index(["scenario", "controller", "rule"])[EFFORT].to_dict()
    replays: dict[str, Any] = {event.name: {"title": event.title, "runs": {}} for event in events}
    size, left_out = 0, 0
    cases = [
        (rule, event, controller)
        for rule, event, controller in product(rules, events, compare.group_by_controller(places))
        if (event.name, controller, rule) in stored
    ]
    with show_progress("replays", len(cases), quiet=False) as advance:
        for rule, event, controller in cases:
            advance(1)
            if size > MOST_NUMBERS:
                left_out += 1
                continue
            series = _replay_series(recorded(event, rule, controller, seeds[event.name]))
            if abs(series["used"] - 100.0 * stored[event.name, controller, rule]) > 0.1:
                fault = f"{event.name} under {rule} and {controller} is not as its stored row says"
                raise StudyError(f"{fault}: sources changed; run readhesion compare again")
            size += sum(array.size for array in series.values())
            lists = {name: array.tolist() for name, array in series.items()}
            shown = lists | {"colour": RULES[rule].colour}
            replays[event.name]["runs"].setdefault(controller, {})[rule] = shown
    return {name: replay for name, replay in replays.items() if replay["runs"]}, left_out


def _replay_series(run: xr.Dataset) -> dict[str, np.ndarray]:
    """What a replay shows of a run: coefficients of each unit and of all together, (instants, units + 1); slip [km/h].

    Of each axle it is the largest slip until the next instant: no short slip is passed over.
    """
    starts = np.arange(0, run.sizes["time"], -(-run.sizes["time"] // FRAMES))
    at = run.isel(time=starts)
    of_unit = run["axle_unit"].values[:, None] == np.arange(run.sizes["unit"])
    member = np.column_stack([of_unit, of_unit.any(axis=1)]).astype(float)
    load = at["axle_load"].values @ member
    share = run["unit_static_load"].values / run["unit_static_load"].values.sum()
    slip = np.maximum.reduceat(3.6 * np.abs(run["slip_velocity"].values), starts)
    offered = (at["adhesion_limit"].values * at["axle_load"].values) @ member / load
    return {
        "used": np.round(100.0 * METRICS[EFFORT].function(run), 1),
        "time": at["time"].values.round(2),
        "speed": (3.6 * at["speed"].values).round(1),
        "offered": offered.round(3),
        "limit": np.column_stack([at["limit"].values, at["limit"].values @ share]).round(3),
        "force": (np.abs(at["rail_force"].values @ member) / load).round(3),
        "slip": slip.round(1),
    }


def _cited_sources(places: Sequence[Standing]) -> list[tuple[Citation, str]]:
    """Publications that rules, controllers, metrics and curves name, and which of them do."""
    texts = {"metrics": getsource(metrics), "adhesion curves": getsource(curves)}
    for place in places:
        rule, controller = RULES[place.rule], CONTROLLERS[place.controller]
        sources = [column.source for column in controller.memory.columns.values()]
        texts[place.rule] = f"{rule.description} {rule.share.__doc__}"
        texts[place.controller] = f"{controller.meaning} {controller.control.__doc__} {sources}"
    return [(citation, ", ".join(things)) for citation, things in find_uses(texts).items()]
