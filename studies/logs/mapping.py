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

[time]
period_s = 0.01                # of the rows, where the time column does not tell it

[forces]
at = "rim"                     # or "contact": those between wheel and rail, which do not accelerate the wheelsets

What is not named is not used; a remark says so where its name tells what it is. Quantities are those of `readhesion
list`, without the unit.
"""

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from alloc.display import displayed
from studies.files.strict import Strict, parse, read_toml
from studies.files.study_error import StudyError, nearest
from studies.logs.assignment import Assigned, stem_of
from studies.logs.channel_units import factor
from studies.logs.columns import QUANTITIES
from studies.logs.guessing import unit_in
from studies.logs.known_train import MeasuredTrain
from studies.logs.raw_channels import Recording


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

    radius_mm: tuple[Annotated[float, Field(ge=200.0, le=800.0)], ...]


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
    wheels: MappedWheels | None = None
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
        if self.wheels is None:
            return train
        radius = 1e-3 * np.array(self.wheels.radius_mm)
        if radius.size != train.radius.size:
            raise StudyError(
                f"{owner}: key 'wheels.radius_mm': {radius.size} radii for {train.radius.size} axles of train {train.name!r}"
            )
        return train.with_radius(radius)

    def assigned(self, recording: Recording, owner: str) -> list[Assigned]:
        """Meaning of the columns of a recording; raises `StudyError` for a column that is not there."""
        found = []
        for name, one in self.columns.items():
            if name not in recording.channels:
                near = nearest(name, recording.channels)
                hint = f"; did you mean {near!r}?" if near else ""
                raise StudyError(f"{owner}: the log has no column {name!r}{hint}")
            found.append(self._assigned(name, one, recording.channels[name].unit, owner))
        return found

    def _assigned(self, name: str, one: MappedColumn, stated: str, owner: str) -> Assigned:
        stem, number = stem_of(one.is_, f"{owner}: column {name!r}")
        kind = QUANTITIES[stem].kind
        unit = one.unit if one.unit is not None else stated or unit_in(name)
        if stem == "time":
            return Assigned(name, stem, 0, 1.0, unit=unit)
        if stem == "axleN_pulses" and one.pulses_per_turn is None:
            raise StudyError(f"{owner}: column {name!r}: give pulses_per_turn")
        scale = factor(unit, kind) if unit or kind == "pulses" else None
        turning = False
        if scale is None and stem == "axleN_speed" and unit:
            scale, turning = factor(unit, "turning"), True
        if unit and scale is None:
            raise StudyError(f"{owner}: column {name!r}: unit {unit!r} is no unit of a {kind}")
        if one.gear_ratio is not None:
            if not (turning or stem == "axleN_torque"):
                raise StudyError(
                    f"{owner}: column {name!r}: gear_ratio is for turning speeds and torques of motors"
                )
            # a motor turns faster than the wheelset, which gets more torque
            scale = (scale or 1.0) * (1.0 / one.gear_ratio if turning else one.gear_ratio)
        per_pascal = None if one.newton_per_kpa is None else 1e-3 * one.newton_per_kpa
        return Assigned(
            name, stem, number, scale, one.sign, turning,
            pulses_per_turn=one.pulses_per_turn, newton_per_pascal=per_pascal,
        )  # fmt: skip


def read_mapping(path: Path) -> Mapping:
    """Read a mapping file; raises `StudyError` naming file, key and reason."""
    data = read_toml(str(path), "mapping", "docs/logs.md has an example")
    return parse(Mapping, data, f"mapping file {str(path)!r}")
