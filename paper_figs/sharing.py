"""What sharing gains and what it costs, from the rows of studies.

`rules` and `rule-events` show the last comparison, `benchmark` that study's own figure, `answer` and `gains` its stored
rows.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure

from alloc.onboard.controllers import CONTROLLERS
from alloc.rules import RULES
from paper_figs.style import WIDE, Drawing
from studies import StudyError, benchmark
from studies.compare import REFERENCE, check_parts, rank_rules
from studies.standing import DISTRIBUTION, EFFORT, GAIN
from studies.statistics import Interval, draw_forest

FILLS = ("full", "left", "none")
"""How the marker of a rule is filled, by controller."""


def study_figure(name: str) -> Callable[[pd.DataFrame], Figure]:
    """The own figure of a study, which is imported when it is drawn."""

    def draw(rows: pd.DataFrame) -> Figure:
        from studies.runner.catalogue import find_study

        figure = find_study(name).figure
        assert figure is not None
        return figure(rows)

    return draw


def _draw_mark(
    axes: Axes, x: float, number: Interval, rule: str, fill: Any = "full", factor: float = 1.0
) -> None:
    """A mean over `x` with its interval, times a factor, in the look of its rule."""
    look: dict[str, Any] = {"color": RULES[rule].colour, "linewidth": 0.9}
    axes.plot([x, x], [factor * number.low, factor * number.high], **look)
    look |= {"marker": RULES[rule].marker, "fillstyle": fill, "linestyle": "none"}
    axes.plot(x, factor * number.value, label=rule, **look)


# the comparison

COSTS = {
    "gain": (100.0, "bound used\n[points]"),
    "damage": (1.0, "wheel damage\n[kJ]"),
    "slip": (1.0, "slip\n[axle s]"),
}
"""Number of a standing: factor, and label of its panel."""


def check_comparison(rows: pd.DataFrame) -> None:
    """Raise `StudyError` for parts that nobody registered, and without the rule that others are compared with."""
    check_parts(rows)
    if REFERENCE not in set(rows["rule"]):
        raise StudyError(f"rows of {REFERENCE!r} are missing; compare with it among --rules")


def draw_rules(rows: pd.DataFrame) -> Figure:
    """What each rule adds to `REFERENCE`, a column for each rule and a mark for each controller."""
    check_comparison(rows)
    standings = [standing for standing in rank_rules(rows) if standing.rule != REFERENCE]
    controllers = list(dict.fromkeys(standing.controller for standing in standings))
    names = list(dict.fromkeys(standing.rule for standing in standings))
    drawn = Figure(figsize=(WIDE, 4.2), layout="constrained")
    panels = drawn.subplots(len(COSTS), 1, sharex=True)
    for axes, (name, (factor, label)) in zip(panels, COSTS.items(), strict=True):
        for standing in standings:
            k = controllers.index(standing.controller)
            x, fill = names.index(standing.rule) + 0.22 * (k - 1), FILLS[k % 3]
            _draw_mark(axes, x, standing.numbers[name], standing.rule, fill, factor)
        axes.axhline(0.0, color="0.5", linewidth=0.8)
        axes.set_ylabel(label)
    for axes in panels[1:]:
        axes.set_yscale("symlog", linthresh=10.0)  # one rule costs as much as all others
    marked = {standing.rule for standing in standings if "°" in standing.mark}
    labels = [f"{name}°" if name in marked else name for name in names]
    panels[-1].set_xticks(range(len(names)), labels, rotation=35, ha="right")
    panels[-1].set_xlabel(f"rule; numbers are minus those of {REFERENCE}")
    _add_legend(drawn, controllers)
    return drawn


def _add_legend(drawn: Figure, names: Sequence[str]) -> None:
    """A legend of controllers by filling."""
    shown = [
        drawn.axes[0].plot([], [], "o", color="0.3", fillstyle=fill, label=name)[0]
        for name, fill in zip(names, FILLS, strict=False)
    ]
    drawn.legend(handles=shown, loc="outside upper right", ncols=3)


TINTS = LinearSegmentedColormap.from_list("change", ["#d55e00", "#ffffff", "#0072b2"])
"""From worse than the reference through equal to better."""
FULL = 8.0
"""Points of the bound that have the full tint."""


def draw_rule_events(rows: pd.DataFrame) -> Figure:
    """Points of the bound over `REFERENCE` by event and rule, under each controller."""
    check_comparison(rows)
    good = rows[rows["status"] == "ok"]
    controllers = good["controller"].unique()
    used = good.pivot_table(index=["controller", "scenario"], columns="rule", values=EFFORT)
    gain = 100.0 * used.sub(used.pop(REFERENCE), axis=0)
    gain = gain[gain.mean().sort_values(ascending=False).index]
    height = 0.9 + len(controllers) * (0.2 + 0.15 * good["scenario"].nunique())
    drawn = Figure(figsize=(WIDE, height), layout="constrained")
    panels = drawn.subplots(len(controllers), 1, sharex=True, squeeze=False)[:, 0]
    for axes, controller in zip(panels, controllers, strict=True):
        gains = gain.loc[controller]
        axes.imshow(gains, cmap=TINTS, norm=Normalize(-FULL, FULL), aspect="auto")
        for (row, column), value in np.ndenumerate(gains.to_numpy()):
            if np.isfinite(value):
                text = f"{round(value, 1) + 0.0:+.1f}".replace("-", "\N{MINUS SIGN}")
                dark = "white" if abs(value) > 0.8 * FULL else "black"
                axes.text(column, row, text, ha="center", va="center", fontsize=6, color=dark)
        axes.set(title=controller, ylabel="event")
        axes.set_yticks(range(len(gains)), gains.index)
        axes.grid(visible=False)
    panels[-1].set_xticks(range(gain.shape[1]), gain.columns, rotation=35, ha="right")
    panels[-1].set_xlabel(f"rule; numbers are points of the bound over {REFERENCE}")
    return drawn


# the stored rows of the benchmark

TICKS = (-100, -10, -3, -1, -0.3, 0, 0.3, 1, 3, 10)
"""Points at which an axis of gains has numbers."""
SHOWN = ("most", "uniform", "spread", benchmark.SHARING, "preset", "exact", "greedy-printed")
"""Rules of the stored rows that are drawn: of those that differ little one."""


def _scale_gains(axes: Axes, axis: str, ticks: Sequence[float]) -> None:
    """Make an axis, x or y, of gains linear below a third of a point, and logarithmic beyond."""
    labels = [f"{tick:g}".replace("-", "\N{MINUS SIGN}") for tick in ticks]
    getattr(axes, f"set_{axis}scale")("symlog", linthresh=0.3, linscale=0.5)
    getattr(axes, f"set_{axis}ticks")(ticks, labels)


def draw_gains() -> Figure:
    """Gain over units that act alone by event, the least first, a line for each rule and a panel for each controller."""
    rows = benchmark.read_stored()
    drawn = Figure(figsize=(WIDE, 3.4), layout="constrained")
    panels = drawn.subplots(1, len(benchmark.UNDER), sharey=True)
    for axes, controller in zip(panels, benchmark.UNDER, strict=True):
        runs = benchmark.split_runs(rows, controller)
        for rule in [name for name in SHOWN if name in runs]:
            gains = np.sort(benchmark.find_gain(runs, rule, benchmark.BASE))
            share = 100.0 * (np.arange(gains.size) + 0.5) / gains.size
            look = {"color": RULES[rule].colour, "marker": RULES[rule].marker}
            axes.plot(share, gains, label=rule, linewidth=0.9, markevery=0.12, **look)
        axes.axhline(0.0, color="0.5", linewidth=0.8)
        axes.set(title=f"under {controller}", xlabel="event, share of all [%]", xlim=(0, 100))
    _scale_gains(panels[0], "y", TICKS)
    panels[0].set_ylabel(f"gain over {benchmark.BASE} [points]")
    drawn.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=7)
    return drawn


def draw_answer() -> Figure:
    """Controllers where units act alone, and rules under each controller: mean gain with interval, median as a square."""
    rows = benchmark.read_stored()
    drawn = Figure(figsize=(WIDE, 2.6), layout="constrained")
    alone, *panels = drawn.subplots(1, 1 + len(benchmark.UNDER))
    runs = benchmark.split_runs(rows, benchmark.BASE)
    names = sorted(runs, key=lambda name: -runs[name][EFFORT].mean())
    _draw_forest_of(alone, runs, names, benchmark.SEARCH, CONTROLLERS)
    alone.set(title="no sharing", xlabel=f"over {benchmark.SEARCH}\n[points]", ylabel="controller")
    for axes, controller in zip(panels, benchmark.UNDER, strict=True):
        runs = benchmark.split_runs(rows, controller)
        _draw_forest_of(axes, runs, SHOWN, benchmark.BASE, RULES)
        axes.set(title=f"under {controller}", xlabel=f"over {benchmark.BASE}\n[points]")
        if axes is not panels[0]:
            axes.set_yticklabels([])
    panels[0].set_ylabel("rule")
    return drawn


def _draw_forest_of(
    axes: Axes, runs: benchmark.Runs, names: Sequence[str], reference: str, parts: Any
) -> None:
    """Gains of parts over a reference; a part without runs has an empty row."""
    numbers: dict[str, list[Interval]] = {name: [] for name in names if name != reference}
    for name in numbers.keys() & runs.keys():
        shown = GAIN, DISTRIBUTION["median"]
        both = (column.measure(runs[name], runs[reference]) for column in shown)
        numbers[name] = [gain.times(100.0) for gain in both]
    draw_forest(axes, numbers, parts, 0.0)
    _scale_gains(axes, "x", (-100, -10, -1, 0, 1))


FIGURES = {
    "answer": Drawing(
        draw_answer,
        "What controllers add to perturb-observe where units act alone, and what rules add to units that act alone under "
        "three controllers: circles are means over the benchmark's events with 95 % intervals, hollow squares medians.",
    ),
    "gains": Drawing(
        draw_gains,
        "Gains of rules event by event, the least first: most events move by less than a third of a point, so every mean is "
        "made by the tails; rules whose limits may fall below the plan lose in most events under controllers that search.",
    ),
    "rules": Drawing(
        draw_rules,
        "What each rule adds to units that act alone, as means over the events of the comparison with 95 % intervals: under "
        "controllers that search, rules that go by every unit's reports gain about twice what rules gain that infer the "
        "rear from the front; ° knows the rail.",
        study="compare",
    ),
    "rule-events": Drawing(
        draw_rule_events,
        "The events differ more than most rules do: sharing gains most where units fail and where the front is wet, and "
        "nothing where the whole rail falls at once.",
        study="compare",
    ),
    "benchmark": Drawing(
        study_figure("benchmark"),
        "Above: what each rule gains over units that act alone on the benchmark's events, with 95 % intervals; hollow "
        "squares are events with more than 1 point of headroom. Below: bound used by readhesion controllers over the wheel "
        "damage and the jerk that they cause, each with its knob at several values.",
        study="benchmark",
    ),
    "optimum": Drawing(
        study_figure("optimum"),
        "Wheel damage above the least with which drawn starts could reach the same end speed, summed: most is dissipated "
        "while an axle is beyond the peak of its curve, little by the split among units.",
        study="optimum",
    ),
    "assumptions": Drawing(
        study_figure("assumptions"),
        "By how much the gain of cooperative sharing and the lead of the MPC move where an assumed number is halved or "
        "doubled, or an effect is left out: the changes that move one most, with 95 % intervals over the events they reach.",
        study="assumptions",
    ),
}
