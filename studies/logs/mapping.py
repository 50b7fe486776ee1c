"""The mapping file of a log, `log.toml`: which column is what, its unit and sign, and the wheels of the train.

[columns]
"Zeit"   = { is = "time" }
"v_GPS"  = { is = "speed", unit = "km/h" }
"n_1"    = { is = "axle1_speed", unit = "rpm", sign = -1 }
"imp_2"  = { is = "axle2_pulses", pulses_per_turn = 80 }
"F_1"    = { is = "axle1_force", unit = "kN" }
"p_C2"   = { is = "axle2_pressure", unit = "bar", newton_per_kpa = 60.0 }
"n_M3"   = { is = "axle3_speed", unit = "rpm", gear_ratio = 5.83 }

[wheels]
radius_mm = [430.0, 428.5]     # one of each axle, in place of the train's
partial = true                 # the train has more axles than the log, and they were not measured

[time]
period_s = 0.01                # of the rows, where the time column does not tell it

[forces]
at = "rim"                     # or "contact": those between wheel and rail, which do not accelerate the wheelsets

What is not named is not used; a remark says so where its name tells what it is. Quantities are those of `readhesion
list`, without the unit. `readhesion analyse LOG --map log.toml` writes a draft. A log without a mapping file is read by the
draft that it would get, and what was guessed is said.
"""

import json
import re
from collections.abc import Mapping as Entries
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from alloc.display import displayed
from alloc.estimation.series import excerpt
from alloc.plant.laws import GRAVITY
from studies.files.strict import Strict, parse, read_toml
from studies.files.study_error import StudyError, nearest
from studies.logs.channel_values import numbers
from studies.logs.columns import (
    NEEDS,
    QUANTITIES,
    Assigned,
    Told,
    column_of,
    factor,
    kinds_of,
    stem_of,
    told_by_names,
    unit_in,
)
from studies.logs.known_train import MeasuredTrain
from studies.logs.recorder_files import Recording
from studies.logs.remarks import Remark


class MappedColumn(Strict):
    """Meaning of a column: an entry of `[columns]`."""

    is_: str = Field(alias="is")
    unit: str | None = None
    sign: Literal[-1, 1] = 1
    pulses_per_turn: float | None = Field(None, gt=0.0)
    newton_per_kpa: float | None = Field(None, gt=0.0)
    gear_ratio: float | None = Field(None, gt=0.0)


class MappedWheels(Strict):
    """`[wheels]`."""

    radius_mm: tuple[Annotated[float, Field(ge=200.0, le=800.0)], ...] | None = None
    partial: bool = False


class MappedTime(Strict):
    """`[time]`."""

    period_s: Annotated[float, Field(gt=0.0, le=60.0)] | None = None


class MappedForces(Strict):
    """`[forces]`."""

    at: Literal["rim", "contact"] | None = None


@displayed
class Mapping(Strict):
    """Content of a mapping file."""

    columns: dict[str, MappedColumn]
    wheels: MappedWheels = MappedWheels()
    time: MappedTime = MappedTime()
    forces: MappedForces = MappedForces()

    @model_validator(mode="after")
    def _something(self) -> "Mapping":
        if not self.columns:
            raise ValueError("no column is named")
        return self

    @property
    def at_contact(self) -> bool | None:
        """Whether the forces act between wheel and rail; None: the file does not say."""
        return None if self.forces.at is None else self.forces.at == "contact"

    def train(self, train: MeasuredTrain, owner: str) -> MeasuredTrain:
        """The train with the wheels of the file."""
        if self.wheels.radius_mm is None:
            return train
        radius = 1e-3 * np.array(self.wheels.radius_mm)
        if radius.size != train.radius.size:
            raise StudyError(
                f"{owner}: key 'wheels.radius_mm': {radius.size} radii for {train.radius.size} axles of train {train.name!r}"
            )
        return train.with_radius(radius)


def read_mapping(path: Path) -> Mapping:
    """Read a mapping file; raises `StudyError` naming file, key and reason."""
    data = read_toml(str(path), "mapping", "docs/logs.md has an example")
    return parse(Mapping, data, f"mapping file {str(path)!r}")


def assigned(
    columns: Entries[str, MappedColumn], recording: Recording, train: MeasuredTrain, owner: str
) -> tuple[list[Assigned], list[Remark]]:
    """Meaning of the mapped columns, and remarks on units that nobody states; raises `StudyError` for a column that is not
    there, and for a unit of something else."""
    found, without, remarks = [], {}, []
    for name, one in columns.items():
        if name not in recording.channels:
            near = nearest(name, recording.channels)
            hint = f"; did you mean {near!r}?" if near else ""
            raise StudyError(f"{owner}: the log has no column {name!r}{hint}")
        whose = f"{owner}: column {name!r}"
        stem, number = stem_of(one.is_, whose)
        needed = NEEDS.get(stem)
        if needed and getattr(one, needed) is None:
            raise StudyError(f"{whose}: give {needed}")
        kinds = {QUANTITIES[stem].kind} | ({"turning"} if stem == "axleN_speed" else set())
        stated = (recording.channels[name].unit, unit_in(name)[1])
        unit = (
            next((u for u in stated if kinds_of(u) & kinds), "") if one.unit is None else one.unit
        )
        if unit or stem in ("time", "axleN_pulses"):
            found.append(_assigned(name, one, unit, whose))
        else:
            without[name] = (stem, number, one)
    known = [one for one in found if QUANTITIES[one.quantity].kind == "speed"]
    for name in sorted(without, key=lambda name: without[name][0] != "speed"):
        stem, number, one = without[name]
        unit = _by_size(name, stem, number, known[:1], recording, train)
        found.append(_assigned(name, one, unit, f"{owner}: column {name!r}"))
        known += [found[-1]] if stem == "speed" else []
        remarks.append(Remark("guess", name, f"no unit, read as {unit}"))
    order = {name: k for k, name in enumerate(columns)}
    return sorted(found, key=lambda one: order[one.column]), remarks


def _assigned(name: str, one: MappedColumn, unit: str, whose: str) -> Assigned:
    stem, number = stem_of(one.is_, whose)
    kind = QUANTITIES[stem].kind
    if stem == "time":
        return Assigned(name, stem, unit=unit)
    scale = factor(unit or "1", kind)
    turning = scale is None and stem == "axleN_speed"
    if turning:
        scale = factor(unit, "turning")
    if scale is None:
        raise StudyError(f"{whose}: unit {unit!r} is no unit of a {kind}")
    if one.gear_ratio is not None:
        if not (turning or stem == "axleN_torque"):
            raise StudyError(f"{whose}: gear_ratio is for turning speeds and torques of motors")
        # a motor turns faster than the wheelset, which gets more torque
        scale *= 1.0 / one.gear_ratio if turning else one.gear_ratio
    per_pascal = None if one.newton_per_kpa is None else 1e-3 * one.newton_per_kpa
    return Assigned(name, stem, number, scale, one.sign, turning, "", one.pulses_per_turn, per_pascal)  # fmt: skip


def _size(name: str, recording: Recording) -> float:
    values, _ = numbers(excerpt(recording.channels[name].load()), name, recording.source)
    return float(np.nanquantile(np.abs(values), 0.99)) if np.isfinite(values).any() else 0.0


def _by_size(
    name: str, stem: str, number: int, speeds: list[Assigned], recording: Recording, train: MeasuredTrain
) -> str:  # fmt: skip
    """Unit of a column that nobody states, by the size of its values; `speeds`: one whose unit is known, or none."""
    size, kind = _size(name, recording), QUANTITIES[stem].kind
    if kind == "speed":
        if not speeds:
            return "rpm" if stem != "speed" and size > 350.0 else "km/h"
        radius = float(train.radius[min(max(number, 1), train.radius.size) - 1])
        choices = {"km/h": 1.0 / 3.6, "m/s": 1.0}
        if stem != "speed":
            choices |= {"rad/s": radius, "rpm": 2.0 * np.pi / 60.0 * radius}
        other = _size(speeds[0].column, recording) * speeds[0].factor
        other *= float(train.radius[0]) if speeds[0].turning else 1.0
        return min(choices, key=lambda unit: abs(np.log(max(size * choices[unit], 1e-9) / max(other, 1e-9))))  # fmt: skip
    load = float(train.axle_load.max())
    load = load if stem.startswith("axle") else float(train.car_mass.sum()) * GRAVITY
    load *= float(train.radius.max()) if kind == "torque" else 1.0
    return {
        "force": "N" if size > 2e-3 * load else "kN", "torque": "N*m" if size > 2e-3 * load else "kN*m",
        "slope": "permille" if size > 0.1 else "m/m", "pressure": "bar" if size < 15.0 else "kPa",
        "position": "m", "acceleration": "m/s2",
    }[kind]  # fmt: skip


# ------------------------------------------------------------------------------------------------------------- the draft


class Draft(NamedTuple):
    """What a log's columns are by the table of names."""

    told: dict[str, Told]
    columns: dict[str, MappedColumn]
    """Those that can be used as they are."""

    def said(self) -> list[tuple[str, str]]:
        """What columns are in words, each with its first column: a line for all that differ by their number."""
        alike: dict[tuple[str, str, str], list[str]] = {}
        for name, told in self.told.items():
            alike.setdefault((re.sub(r"\d+", "#", name), told.stem, told.unit), []).append(name)
        lines = []
        for (_, stem, unit), names in alike.items():
            first, last = (self.told[name].number for name in (names[0], names[-1]))
            of, _, what = stem.rpartition("_")
            place = f"{of.rstrip('NK')} {first} " if of else ""
            which = repr(names[0])
            if len(names) > 1:
                which, place = f"{which} to {names[-1]!r}", f"{place}to {last} " if of else ""
            lines.append((names[0], f"{which}: {place}{what}" + (f" in {unit}" if unit else "")))
        return lines


def draft(recording: Recording, train: MeasuredTrain, known: Entries[str, Assigned] = {}) -> Draft:
    """What columns are by their names, beside the `known` ones and what these are."""
    taken = {one.place for one in known.values()}
    told = {
        name: one
        for name, one in told_by_names({n: u for n, u in recording.units.items() if n not in known}, train).items()
        if Assigned("", one.stem, one.number).place not in taken
    }  # fmt: skip
    columns = {
        name: MappedColumn.model_validate({"is": column_of(one.stem, one.number), "unit": one.unit or None})
        for name, one in told.items() if not one.needs
    }  # fmt: skip
    return Draft(told, columns)


def draft_text(recording: Recording, train: MeasuredTrain) -> str:
    """A mapping file that reads a log as it would be read without one; comments say what was guessed, and what is not used.

    Raises `StudyError` for a log of which no column is known.
    """
    source = recording.source
    found = draft(recording, train)
    if not found.columns:
        raise StudyError(
            f"log {source!r}: no column's name is known; docs/logs.md shows a mapping file"
        )
    _, remarks = assigned(found.columns, recording, train, f"log {source!r}")
    by_size = {one.column: one.text.rpartition(" ")[2] for one in remarks}
    lines = [
        f"# Draft for the log {source!r} and the train {train.name!r}. What was guessed is marked: check it.",
        "# Axles and cars count from the front; traction is positive, else add sign = -1.",
        "[columns]",
    ]
    for name, stated in recording.units.items():
        told, unit = found.told.get(name), by_size.get(name, "")
        key = json.dumps(name, ensure_ascii=False).replace("\x7f", "\\u007f")
        if told is None:
            lines.append(f'# {key} = {{ is = "" }}  # not known' + (f", in {stated}" if stated else ""))  # fmt: skip
            continue
        entry = f'{key} = {{ is = "{column_of(told.stem, told.number)}"'
        if told.unit or unit:
            entry += f", unit = {json.dumps(told.unit or unit, ensure_ascii=False)}"
        if told.needs:
            lines.append(f"# {entry}, {told.needs} =  }}  # not used without {told.needs}")
            continue
        how = ["guessed from the name"] if told.guessed else []
        how += ["unit guessed from the size of the values"] if unit else []
        lines.append(f"{entry} }}" + (f"  # {', '.join(how)}" if how else ""))
    return "\n".join([*lines, ""])
