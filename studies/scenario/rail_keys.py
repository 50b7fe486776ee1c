"""Keys of a scenario file on rail and line."""

from collections.abc import Mapping
from dataclasses import MISSING, fields, replace
from typing import Annotated, Any, ClassVar, Literal, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, model_validator

from alloc.errors import PlantError, number_fault
from alloc.plant.adhesion import CURVES, AdhesionCurve
from alloc.plant.rail import (
    CURVE_LAWS,
    GROWTH_OFFSET,
    GROWTH_SLOPE,
    SPEED_LAWS,
    Line,
    Patch,
    Rail,
    Receptivity,
    logarithmic_increments,
)
from alloc.records import Meaning, meanings, meant
from alloc.units import unit_of
from studies.files.json_schema import Names, Schema, add, bound_numbers, in_unit
from studies.files.strict import Strict
from studies.files.study_error import nearest
from studies.files.units import range_fault, si
from studies.scenario.record_keys import built, keys_of

# Keys of a scenario file on the growth of adhesion along the train.

MOST_COEFFICIENT = 1.0
"""No dry or sanded rail carries a force as large as the wheel's load: measured coefficients stay below 0.7."""
Increment = Annotated[float, Field(ge=-MOST_COEFFICIENT, le=MOST_COEFFICIENT)]
"""Of the coefficient, at one axle or unit."""


class IncrementKeys(Strict):
    """Growth of adhesion along the train: none, the law (15) of JP5484215, or a value per axle.

    Source: JP5484215 (15), Shinkansen.
    """

    law: Literal["none", "logarithmic", "given"]
    """Law of the growth: none, slope ln j + offset for axle j (1 = foremost), or given by values."""
    slope: float = Field(default=GROWTH_SLOPE, ge=-MOST_COEFFICIENT, le=MOST_COEFFICIENT)
    """Slope of the law logarithmic."""
    offset: float = Field(default=GROWTH_OFFSET, ge=-MOST_COEFFICIENT, le=MOST_COEFFICIENT)
    """Offset of the law logarithmic; with the default the mean over the first four axles is zero."""
    values: tuple[Increment, ...] | None = None
    """Increment of the coefficient per axle from the front, with the law given. Left out: another law is meant. Source: the
    file's."""

    @model_validator(mode="after")
    def _fits(self) -> "IncrementKeys":
        if (self.values is not None) != (self.law == "given"):
            raise ValueError('values go with law = "given", and only with it')
        if self.law != "logarithmic" and (self.slope, self.offset) != (
            GROWTH_SLOPE,
            GROWTH_OFFSET,
        ):
            raise ValueError('slope and offset go with law = "logarithmic", and only with it')
        return self

    def increments(self, axles: int) -> tuple[float, ...] | None:
        """One increment per axle from the front, None for none."""
        if self.law == "none":
            return None
        if self.law == "given":
            return self.values
        return tuple(logarithmic_increments(axles, self.slope, self.offset).tolist())


SpeedLaw = Annotated[str, Names(lambda: SPEED_LAWS)] | tuple[float, float, float]
ONE_LEVEL: Schema = {
    "allOf": [
        {
            "oneOf": [
                {
                    "required": ["level"],
                    "properties": {"speed_law": {"const": "none"}},
                    "not": {"required": ["law_factor"]},
                },
                {
                    "required": ["speed_law", "law_factor"],
                    "properties": {"speed_law": {"not": {"const": "none"}}},
                    "not": {"required": ["level"]},
                },
            ]
        }
    ]
}
"""In the schema: a rail has a coefficient, or a law with a factor."""


_Patch: Any = keys_of(Patch)


class PatchKeys(_Patch):
    """A stretch of rail, or a span of time, with another adhesion: `[[rail.patches]]`. Source: assumed."""

    def patch(self) -> Patch:
        """The plant's patch."""
        return built(self, Patch)


def _curve_schema(name: str) -> Schema:
    """Keys of an adhesion curve: the fields of its class."""
    curve: Any = CURVES[name]
    told, stated = meanings(curve), get_type_hints(curve)
    keys: Schema = {"kind": {"const": name}}
    for item in fields(curve):
        meaning = told.get(item.name, Meaning())
        keys[item.name] = TypeAdapter(stated[item.name]).json_schema()
        default = in_unit(item.default, 1.0)
        add(keys[item.name], meaning, meaning.unit, default)
        bound_numbers(keys[item.name], unit_of(item.name))
    about = meant((curve.__doc__ or "").strip().partition("\n")[0]).text
    known = {"title": name, "description": about, "type": "object", "properties": keys}
    required = [
        item.name
        for item in fields(curve)
        if item.default is MISSING and item.default_factory is MISSING
    ]
    kind = [] if name == CurveKeys.model_fields["kind"].default else ["kind"]
    return known | {"required": kind + required, "additionalProperties": False}


class CurveKeys(BaseModel):
    """Adhesion curve by kind, a name in `alloc.plant.adhesion.CURVES`, with the parameters that differ from its default."""

    model_config = ConfigDict(frozen=True, extra="allow")

    kind: str = "piecewise"
    """Name of the adhesion curve; the other keys are its parameters. Source: piecewise: readhesion paper (1)-(6)."""

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

    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any, handler: Any) -> Schema:
        reference: Schema = handler(core)
        schema = handler.resolve_ref_schema(reference)
        schema.clear()
        about = (cls.__doc__ or "").partition(",")[0] + ", with the parameters that differ."
        schema |= {"description": about, "oneOf": [_curve_schema(name) for name in CURVES]}
        for one in schema["oneOf"]:
            told = one["properties"]["kind"] = {"type": "string"} | one["properties"]["kind"]
            is_default = told["const"] == cls.model_fields["kind"].default
            add(told, meanings(cls)["kind"], "", told["const"] if is_default else None)
        return reference

    @property
    def _given(self) -> dict[str, Any]:
        return {key: value for key, value in (self.model_extra or {}).items() if value is not None}

    def curve(self) -> AdhesionCurve:
        """The plant's curve."""
        return CURVES[self.kind](**self._given)


class RailKeys(Strict):
    """The rail as it truly is: `[rail]`. Either `level`, or `speed_law` with its factor `law_factor`. Source: assumed."""

    record = Rail
    fields_of_keys: ClassVar[Mapping[str, str]] = {"law_factor": "level"}
    model_config = ConfigDict(json_schema_extra=ONE_LEVEL)

    level: float | None = Field(default=None, le=MOST_COEFFICIENT)
    """Coefficient, where it is the same at every speed. Left out: `speed_law` and `law_factor` are given."""
    speed_law: SpeedLaw = "none"
    """Coefficient over the speed V: a name, or a, b and c of a / (V + b) + c with V in km/h; none: the same at every speed.
    Source: shinkansen: JP5484215 (12); curtius-kniffler: Curtius and Kniffler, 1950."""
    law_factor: float | None = Field(default=None, le=10.0)
    """Factor on the coefficient that `speed_law` gives; 1 is the law itself. Left out: `level` is given."""
    rear_speed_law: tuple[float, float, float] | None = None
    rear_axles: float | None = None
    increments: IncrementKeys
    """Growth of the coefficient along the train. It is always said: law = "none", or law = "logarithmic" for that of
    JP5484215 (15). Source: JP5484215 (15)."""
    patches: tuple[PatchKeys, ...] = Field(default=(), max_length=1000)
    scatter: float = Field(default=0.0, le=MOST_COEFFICIENT)
    scatter_length_m: float | None = None
    conditioning: float = Field(default=0.0, le=10.0)
    conditioning_slip: float | None = None
    sanded_coefficient: float | None = Field(default=None, le=MOST_COEFFICIENT)
    sand_saturation_g_per_m: float | None = None
    sand_decay: float | None = None
    recovered_coefficient: float | None = Field(default=None, le=MOST_COEFFICIENT)
    recovery_energy_j_per_m: float | None = None
    recovery_time_s: float | None = None
    recovery_left: float | None = None
    presliding_m: float | None = None
    curve: CurveKeys = CurveKeys()

    @model_validator(mode="after")
    def _fits(self) -> "RailKeys":
        if self.speed_law == "none":
            if self.law_factor is not None:
                raise ValueError(
                    "law_factor goes with speed_law; without it say level, the coefficient"
                )
            if self.level is None:
                raise ValueError("level is missing; or give speed_law and law_factor")
            if self.rear_speed_law is not None:
                raise ValueError("rear_speed_law goes with speed_law, the law of the front")
        elif self.level is not None:
            raise ValueError(
                "level is a coefficient, the same at every speed; with speed_law say law_factor in its place"
            )
        elif self.law_factor is None:
            raise ValueError("law_factor is missing; 1.0 is the speed_law itself")
        return self

    def rail(self, axles: int, seed: int) -> Rail:
        """The plant's rail for a train with this number of axles; `seed` draws the scatter."""
        values = si(self) | {"patches": tuple(patch.patch() for patch in self.patches)}
        values["level"] = values.pop("law_factor", self.level)
        rail = Rail(
            **values,
            increments=self.increments.increments(axles),
            curve=self.curve.curve(),
            seed=seed,
        )
        bare = replace(
            rail, increments=None, scatter=0.0, conditioning=0.0, recovered_coefficient=0.0
        )
        if (most := bare.greatest_peak()) > MOST_COEFFICIENT:
            scale = "level" if self.law_factor is None else "law_factor"
            value = self.level if self.law_factor is None else self.law_factor
            raise PlantError(
                f"rail: {scale} = {value!r} gives a coefficient of {most:.3g} with speed law and patches; "
                f"it must be at most {MOST_COEFFICIENT:g}"
            )
        return rail


class SectionKeys(Strict):
    """Gradient from a position on: `[[line.sections]]`. Source: the line's."""

    start_m: float
    """Position where the section begins; sections stand in growing order."""
    grade_permille: float
    """Gradient, positive uphill."""


class _Stretch(Strict):
    """A part of the line from one position to another."""

    @model_validator(mode="after")
    def _ends_beyond_its_start(self) -> "_Stretch":
        start, end = (getattr(self, name) for name in ("start_m", "end_m"))
        if not start < end:
            raise ValueError(f"end_m = {end!r} must lie beyond start_m = {start!r}")
        return self


class TunnelKeys(_Stretch):
    """A tunnel: `[[line.tunnels]]`. Source: the line's."""

    start_m: float
    """Position where it begins."""
    end_m: float
    """Position where it ends."""


class LineCurveKeys(_Stretch):
    """A curve of the line, straight on either side: `[[line.curves]]`. Source: the line's."""

    start_m: float
    """Position where it begins."""
    end_m: float
    """Position where it ends."""
    radius_m: float
    """Radius."""


class LineKeys(Strict):
    """The line: sections, tunnels and curves, or in `file` a line of its own in place of the sections: `[line]`.

    Source: the line's.
    """

    record = Line

    file: str | None = None
    """Path of a line in place of the sections, counted from the scenario's folder: a line file in TOML, or a
    railtoolkit running path. Left out: the sections count."""
    sections: tuple[SectionKeys, ...] = Field(default=(), max_length=50_000)
    """Sections of constant gradient; before the first and beyond the last the nearest applies. Left out: a level line."""
    tunnels: tuple[TunnelKeys, ...] = Field(default=(), max_length=1000)
    """Tunnels. Left out: none."""
    tunnel_factor: float = Field(default=1.0, le=100.0)
    curves: tuple[LineCurveKeys, ...] = Field(default=(), max_length=50_000)
    """Curves; where they overlap the sharpest counts. Left out: none."""
    curve_law: Annotated[str, Names(lambda: CURVE_LAWS)] = "600/R"

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


_Receptivity: Any = keys_of(Receptivity)


class ReceptivityKeys(_Receptivity):
    """How much regenerated power the line takes up: `[receptivity]`; the phase is drawn from the seed. Source: assumed."""

    def receptivity(self, phase: float) -> Receptivity:
        """The plant's receptivity with a `phase` [rad]; what is constant has none."""
        return built(self, Receptivity, phase=phase if self.amplitude else 0.0)
