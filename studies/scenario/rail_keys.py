"""What a scenario file says about rail and line."""

from dataclasses import fields, replace
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from alloc.errors import number_fault
from alloc.plant.adhesion import CURVES, AdhesionCurve
from alloc.plant.rail import Line, Patch, Rail, Receptivity, logarithmic_increments
from studies.files.strict import Strict
from studies.files.study_error import nearest
from studies.files.units import range_fault, si


class PatchKeys(Strict):
    """A stretch of rail, or a span of time, with another adhesion: `[[rail.patches]]`."""

    factor: float
    start_m: float | None = None
    end_m: float | None = None
    edge_m: float | None = None
    begin_s: float | None = None
    until_s: float | None = None
    fade_s: float | None = None

    def patch(self) -> Patch:
        """The plant's patch."""
        return Patch(**si(self))


class IncrementKeys(Strict):
    """Growth of adhesion along the train: none, the law (15) of JP5484215, or a value per axle."""

    law: Literal["none", "logarithmic", "given"] = "logarithmic"
    slope: float = 0.0083
    offset: float = -0.0066
    values: tuple[float, ...] | None = None

    @model_validator(mode="after")
    def _fits(self) -> "IncrementKeys":
        if (self.values is not None) != (self.law == "given"):
            raise ValueError('values go with law = "given", and only with it')
        return self

    def increments(self, axles: int) -> tuple[float, ...] | None:
        """One increment per axle from the front, None for none."""
        if self.law == "none":
            return None
        if self.law == "given":
            return self.values
        return tuple(logarithmic_increments(axles, self.slope, self.offset).tolist())


class CurveKeys(BaseModel):
    """Adhesion curve by kind, a name in `alloc.plant.adhesion.CURVES`, with the parameters that differ from its default."""

    model_config = ConfigDict(frozen=True, extra="allow")

    kind: str = "piecewise"

    @model_validator(mode="after")
    def _fits(self) -> "CurveKeys":
        allowed = [item.name for item in fields(CURVES.find(self.kind))]
        for key, value in self._given.items():
            if key not in allowed:
                near = nearest(key, allowed)
                hint = f"; did you mean {near!r}?" if near else ""
                raise ValueError(f"{key} does not belong to the {self.kind} curve{hint}")
            fault = number_fault(value, negative=True) or range_fault(key, value)
            if fault is not None:
                raise ValueError(f"{key} = {value!r} {fault}")
        return self

    @property
    def _given(self) -> dict[str, Any]:
        return {key: value for key, value in (self.model_extra or {}).items() if value is not None}

    def curve(self) -> AdhesionCurve:
        """The plant's curve."""
        return CURVES[self.kind](**self._given)


class RailKeys(Strict):
    """The rail as it truly is: `[rail]`.

    `level` is the coefficient where `speed_law` is "none", else a factor on the law; a law is a name, or a, b and c of
    a / (V + b) + c with V in km/h. `rear_speed_law` takes over from the front to the rear within `rear_axles`.
    """

    level: float = Field(le=10.0)
    speed_law: str | tuple[float, float, float] = "none"
    rear_speed_law: tuple[float, float, float] | None = None
    rear_axles: float | None = None
    increments: IncrementKeys = IncrementKeys()
    patches: tuple[PatchKeys, ...] = Field(default=(), max_length=1000)
    scatter: float = 0.0
    scatter_length_m: float | None = None
    conditioning: float = 0.0
    conditioning_slip: float | None = None
    sanded_coefficient: float | None = None
    sand_saturation_g_per_m: float | None = None
    sand_decay: float | None = None
    presliding_m: float | None = None
    curve: CurveKeys = CurveKeys()

    def rail(self, axles: int, seed: int) -> Rail:
        """The plant's rail for a train of so many axles; `seed` draws the scatter."""
        values = si(self) | {"patches": tuple(patch.patch() for patch in self.patches)}
        return Rail(
            **values,
            increments=self.increments.increments(axles),
            curve=self.curve.curve(),
            seed=seed,
        )


class SectionKeys(Strict):
    """Gradient from a position on: `[[line.sections]]`."""

    start_m: float
    grade_permille: float


class TunnelKeys(Strict):
    """A tunnel: `[[line.tunnels]]`."""

    start_m: float
    end_m: float


class LineCurveKeys(Strict):
    """A curve of the line, straight on either side: `[[line.curves]]`."""

    start_m: float
    end_m: float
    radius_m: float


class LineKeys(Strict):
    """The line: sections, tunnels and curves, or in `file` a line of its own in place of the sections: `[line]`.

    The file is TOML as `studies.scenario.line_file` reads it, or a railtoolkit running path.

    `curve_law`, the curves' resistance, is a name in `alloc.plant.rail.CURVE_LAWS`.
    """

    file: str | None = None
    sections: tuple[SectionKeys, ...] = Field(default=(), max_length=50_000)
    tunnels: tuple[TunnelKeys, ...] = Field(default=(), max_length=1000)
    tunnel_factor: float = 1.0
    curves: tuple[LineCurveKeys, ...] = Field(default=(), max_length=50_000)
    curve_law: str = "600/R"

    @model_validator(mode="after")
    def _fits(self) -> "LineKeys":
        if self.file is not None and self.sections:
            raise ValueError("give either file or sections, not both")
        return self

    def line(self) -> Line:
        """The plant's line."""
        from studies.scenario.line_file import read_line

        line = Line()
        if self.file is not None:
            line = read_line(self.file).line()
        elif self.sections:
            sections = [si(section) for section in self.sections]
            line = Line(tuple(s["start"] for s in sections), tuple(s["grade"] for s in sections))
        return replace(
            line,
            tunnels=tuple((t.start_m, t.end_m) for t in self.tunnels),
            tunnel_factor=self.tunnel_factor,
            curves=tuple((c.start_m, c.end_m, c.radius_m) for c in self.curves),
            curve_law=self.curve_law,
        )


class ReceptivityKeys(Strict):
    """How much regenerated power the line takes up: `[receptivity]`; the phase is drawn from the seed."""

    mean: float = 1.0
    amplitude: float = 0.0
    period_s: float = 3.0

    def receptivity(self, phase: float) -> Receptivity:
        """The plant's receptivity with a `phase` [rad]; what is constant has none."""
        return Receptivity(**si(self), phase=phase if self.amplitude else 0.0)
