"""What there is to choose from, by kind and name."""

import sys

from alloc.metrics import METRICS
from alloc.onboard.host import CONTROLLERS
from alloc.plant.adhesion import CURVES
from alloc.plant.sets import SETS, find_set
from alloc.rules import RULES
from studies.core.collection import all_studies
from studies.core.gallery import gallery
from studies.lines.named_files import LINES, TRAINS, shipped
from studies.logs.mapping import column_names
from studies.scenario.loading import SCENARIOS, load_scenario


def catalogue() -> dict[str, dict[str, str]]:
    """Kind -> name -> one line of meaning, of all that a command can be told."""
    scenarios = {name: load_scenario(name) for name in SCENARIOS}
    return {
        "scenarios": {name: item.title for name, item in scenarios.items()},
        "rules": {name: _first_line(rule) for name, rule in RULES.items()},
        "controllers": {name: found.meaning for name, found in CONTROLLERS.items()},
        "adhesion curves": {name: _first_line(curve) for name, curve in CURVES.items()},
        "trains": {name: _train(name) for name in SETS},
        "lines (run-line)": shipped(LINES),
        "trains (run-line)": shipped(TRAINS),
        "sweeps": {
            name: f"{study.question}{''.join(f' [--{own}]' for own in study.settings).replace('_', '-')}"
            for name, study in all_studies().items()
        },
        "figures": dict(gallery().descriptions()),
        "metrics": {
            name: m.description + ("" if m.unit == "1" else f" [{m.unit}]")
            for name, m in METRICS.items()
        },
        "columns of a log": column_names(),
    }


def _train(name: str) -> str:
    """Meaning of a train set: what its file says, or the module of one that a package or a plug-in brings, and its size."""
    train = find_set(name)
    cars = len(train.cars)
    said = getattr(SETS[name], "description", None) or _first_line(sys.modules[SETS.origin(name)])
    return f"{said} {cars} car{'s' if cars > 1 else ''}, {train.mass / 1e3:.0f} t."


def _first_line(item: object) -> str:
    text = getattr(item, "description", None) or item.__doc__ or ""
    return str(text).strip().splitlines()[0] if str(text).strip() else ""
