"""Names and units of a log's columns.

Axles and cars count from 1, the foremost; coupler k joins the cars k and k + 1. Traction is positive, braking negative,
tension positive. The mapping file (`studies.logs.mapping`) says what columns of other names are; its draft comes from
`told_by_names`.
"""

import json
import re
import unicodedata
from collections.abc import Mapping as Entries
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from alloc.display import displayed
from alloc.estimation.series import excerpt
from alloc.plant.laws import GRAVITY
from studies.files.strict import Strict, parse, read_toml
from studies.files.study_error import StudyError, nearest
from studies.logs.own_samples import numbers
from studies.logs.recorder_files import Recording
from studies.logs.remarks import Remark
from studies.logs.train import MeasuredTrain

if TYPE_CHECKING:
    from pint import UnitRegistry


SI = {
    "time": "s", "speed": "m/s", "turning": "rad/s", "force": "N", "torque": "N*m", "acceleration": "m/s**2",
    "slope": "1", "position": "m", "pressure": "Pa", "pulses": "1",
}  # fmt: skip
"""Unit of the analysis by kind of quantity."""


class Quantity(NamedTuple):
    """A measured quantity: unit by the ending of its column, what it is, its kind, and whether a log must have it."""

    units: dict[str, str]
    description: str
    kind: str
    """A speed of an axle may be a turning speed too."""
    required: bool = False


FORCE, PRESSURE = {"n": "N", "kn": "kN"}, {"kpa": "kPa", "bar": "bar"}
QUANTITIES: dict[str, Quantity] = {
    "time": Quantity({"s": "s"}, "time since any origin, an epoch, or a time stamp", "time", True),
    "speed": Quantity(
        {"kmh": "km/h", "ms": "m/s"},
        "speed of the train over ground, not of a wheel; without it the speed is estimated from speed and torque or "
        "force of the axles, of all driven ones at least",
        "speed",
    ),
    "gradient": Quantity({"permille": "permille"}, "rise per run where the train is", "slope"),
    "position": Quantity(
        {"m": "m", "km": "km"}, "station of the train's front on the line of --line", "position"
    ),
    "axleN_speed": Quantity(
        {"kmh": "km/h", "ms": "m/s", "rads": "rad/s", "rpm": "rpm"},
        "circumferential or turning speed of the wheels of axle N; of one axle at least",
        "speed",
        True,
    ),
    "axleN_pulses": Quantity(
        {"1": "1"},
        "pulses of a wheel sensor counted so far, or since the row before; the mapping file has the pulses of a turn",
        "pulses",
    ),
    "axleN_torque": Quantity(
        {"nm": "N*m", "knm": "kN*m"},
        "torque of motor and brake together on the wheelset of axle N (motor torque times gear ratio)",
        "torque",
    ),
    "axleN_force": Quantity(FORCE, "the same as a force at the rim, in place of the torque", "force"),
    "axleN_pressure": Quantity(
        PRESSURE,
        "pressure of the brake cylinder of axle N; with the mapping file's newton_per_kpa in place of a force",
        "pressure",
    ),
    "couplerK_force": Quantity(
        FORCE, "force between the cars K and K + 1; of all couplers or none", "force"
    ),
    "carK_acceleration": Quantity(
        {"ms2": "m/s**2", "kmhs": "km/h/s"}, "acceleration of car K; of all cars or none", "acceleration"
    ),
    "carK_pressure": Quantity(
        PRESSURE, "pressure of the brake cylinders of car K, for all its axles", "pressure"
    ),
}  # fmt: skip
"""Quantity by the stem of its column; N and K represent numbers. A turning speed uses the train's radius."""
PLACES = {"axle": "axleN", "coupler": "couplerK", "car": "carK"}
OF_AXLES = ("speed", "turning", "force", "torque", "pulses")
"""What a number alone makes one of an axle."""
NEEDS = {"axleN_pulses": "pulses_per_turn", "axleN_pressure": "newton_per_kpa"}
"""Quantities that are of no use without a number that only the mapping file has."""
SHARED = {
    "axleN_speed": "wheel", "axleN_pulses": "wheel",
    "axleN_torque": "effort", "axleN_force": "effort", "axleN_pressure": "effort",
}  # fmt: skip
"""Quantities from which the speed of a wheel follows, or the force on it: an axle has one of each."""
SPELT = {
    "1/s": "turn/s", "s-1": "turn/s", "Hz": "turn/s", "1/min": "rpm", "U/min": "rpm", "u/min": "rpm", "r/min": "rpm",
    "min-1": "rpm", "min^-1": "rpm", "kmh": "km/h", "ms": "m/s", "kmhs": "km/h/s", "ms**2": "m/s**2", "g": "g_0",
    "n": "N", "kn": "kN", "mn": "MN", "dan": "daN", "nm": "N*m", "knm": "kN*m", "kp": "kgf", "kg/cm**2": "kgf/cm**2",
    "mpa": "MPa", "hpa": "hPa", "kpa": "kPa", "pa": "Pa", "pulses": "1", "imp": "1", "impulse": "1", "-": "1", "": "1",
    "rads": "rad/s", "umin": "rpm", "promille": "permille", "millis": "ms", "hz": "turn/s", "S": "s", "M": "m",
}  # fmt: skip
"""What loggers write and the library does not know, or takes for something else."""
IN_NAMES = {*SPELT, *re.findall(r"\S+", """
    km/h m/s mph kph knots kts rad/s rpm 1/min u/min r/min kn dan mn lbf kgf nm knm m/s2 km/h/s permille percent km mm mi ft
    s ms us ns sec msec min bar mbar psi kpa mpa hpa pa""")}  # fmt: skip
"""Units that stand at the end of a name without brackets; the library would take many a word for one."""
SCALED = re.compile(r"(\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)[*·]?([^\d/*.^+-].*)")
"""A number and a unit: the worth of a digit, such as 0.01 km/h."""


@lru_cache(maxsize=1)
def registry() -> "UnitRegistry[Any]":
    """The library's units."""
    import pint

    return pint.UnitRegistry()


@lru_cache(maxsize=4096)
def factor(unit: str, kind: str) -> float | None:
    """What a value in `unit` is multiplied with to be in the unit of `SI[kind]`; None for a unit of something else."""
    text = re.sub(r"[\s\[\](){}<>]", "", unit)
    scaled = SCALED.fullmatch(text)
    if scaled:
        whole = factor(scaled[2], kind)
        return None if whole is None else float(scaled[1]) * whole
    text = re.sub(r"(?<=[a-zA-Z])([23])$", r"**\1", text)
    if re.search(r"\d(\*\*|\^)", text) or len(text) > 60:
        return None  # the library would compute powers of numbers
    always = SPELT.get(text) if kind in ("turning", "pulses") else None
    small = text.lower() if len(text) > 1 else text  # A is no year
    for spelt in (always, text, SPELT.get(text), SPELT.get(small), small):
        try:
            if spelt:
                return float(registry().Quantity(1.0, spelt).to(SI[kind]).magnitude)
        except Exception:
            continue
    return None


def kinds_of(unit: str) -> set[str]:
    """Kinds of quantities that a unit can be of."""
    return {kind for kind in SI if unit and factor(unit, kind) is not None}


def unit_in(name: str) -> tuple[str, str]:
    """A column's name without its unit, and the unit in brackets or at its end, "" if none."""
    bracket = re.search(r"[\[({]\s*([^\])}]+?)\s*[\])}]\s*$", name)
    if bracket and not bracket[1].isdigit():
        return name[: bracket.start()], bracket[1]
    # of a matrix, the number of the column stands behind the unit
    words, number = re.findall(r"^(.*?)([_\s.]+\d+)?$", name.strip().replace("\n", " "))[0]
    parts = re.split(r"[_\s.]+", words)
    for count in (2, 1):
        unit = "/".join(parts[-count:])
        if len(parts) > count and len(unit) > (count == 1) and unit.lower() in IN_NAMES:
            return "_".join(parts[:-count]) + number, unit
    return name, ""


class Column(NamedTuple):
    """Meaning of a column's name."""

    name: str
    quantity: str
    number: int
    """From 1; 0 for a quantity of the whole train."""
    unit: str


@dataclass(frozen=True)
class Assigned:
    """What a column is, and how its values become SI units."""

    column: str
    quantity: str
    number: int = 0
    """From 1; 0 for a quantity of the whole train."""
    factor: float = 1.0
    sign: int = 1
    turning: bool = False
    """Whether it is a turning speed [rad/s], which takes the wheel's radius."""
    unit: str = ""
    """As stated, for the time alone."""
    pulses_per_turn: float | None = None
    newton_per_pascal: float | None = None

    @property
    def place(self) -> tuple[str, int]:
        """Quantity and number; two that exclude each other share one."""
        return SHARED.get(self.quantity, self.quantity), self.number


def column_names() -> dict[str, str]:
    """Every column that a log may have, its units by |, and its meaning."""
    return {
        f"{stem}_{'|'.join(quantity.units)}": quantity.description
        + (" (required)" if quantity.required else "")
        for stem, quantity in QUANTITIES.items()
    }


def parse_column(name: str) -> Column | None:
    """Meaning of a column's name; None if it is none of `QUANTITIES`."""
    word, _, unit = name.rpartition("_")
    found = _stem(word)
    return Column(name, *found, unit) if found and unit in QUANTITIES[found[0]].units else None


def _stem(word: str) -> tuple[str, int] | None:
    number = re.search(r"(?<=[a-z])[1-9]\d*(?=_)", word)
    place = "" if number is None else word[: number.start()]
    stem = word if number is None else f"{PLACES.get(place, '')}{word[number.end() :]}"
    if stem not in QUANTITIES or ("_" in stem and number is None):
        return None
    return stem, int(number[0]) if number else 0


def stem_of(word: str, owner: str) -> tuple[str, int]:
    """Quantity and number of a word such as "axle3_speed"; raises `StudyError` for any other word."""
    found = _stem(word)
    if found is None:
        known = ", ".join(column_of(stem, 1) for stem in QUANTITIES)
        raise StudyError(f"{owner}: {word!r} is no quantity; give one of {known} (numbers from 1)")
    return found


def column_of(stem: str, number: int, unit: str = "") -> str:
    """Name of the column of a quantity, its number and its unit."""
    return re.sub(r"(?<=[a-z])[NK](?=_)", str(number), stem) + (f"_{unit}" if unit else "")


def near_column(name: str) -> Column | None:
    """The column that a misspelt name resembles most; None if it resembles none."""
    digits = re.search(r"\d+", name)
    number = max(int(digits.group()), 1) if digits else 1
    known = [column_of(stem, number, u) for stem, q in QUANTITIES.items() for u in q.units]
    return parse_column(nearest(name, known) or "")


# ------------------------------------------------------------------------ the table of names, and the code that reads it

WORDS = {
    "time": "time zeit timestamp timestamps datetime date utc epoch uhrzeit zeitstempel seconds temps clock t 時刻 時間",
    "axle": "axle axis achse achs wheelset wheel whl radsatz essieu roue rs ws rad ax 輪軸 車軸 軸",
    "car": "car wagen coach vehicle veh wagon wag wg fahrzeug voiture w 号車 車両",
    "coupler": "coupler coupling kupplung drawbar cpl draft attelage 連結器",
    "motor": "motor mot tm fahrmotor moteur 主電動機 電動機",
    "train": "ground gps gnss radar doppler train zug 対地 列車 車速 v",
    "speed": "speed vel velocity geschwindigkeit geschw vitesse drehzahl rpm omega rotation rot spd tempo kmh rads v n "
             "速度 周速 車速 回転数 回転速度",
    "force": "force kraft effort frc fx te f 力",
    "torque": "torque drehmoment moment couple tq trq m トルク",
    "acceleration": "acceleration accel acc beschleunigung a 加速度",
    "slope": "gradient grade slope inclination neigung steigung pente rampe 勾配",
    "position": "position pos distance dist chainage mileage station kilometer weg キロ程 位置",
    "pressure": "pressure pression druck cylinder cyl bremszylinder bcp pc bc p 圧力 圧 シリンダ",
    "pulses": "pulses pulse counts count cnt impulse impuls imp ticks encoder パルス",
}  # fmt: skip
"""Words by what they mean. Those of one letter, and `AMBIGUOUS`, count only if no longer one says anything."""
AMBIGUOUS = {"rad", "ax", "bc"}
EVERY = {word for words in WORDS.values() for word in words.split()}
MEANINGS = {word: {m for m, words in WORDS.items() if word in words.split()} for word in EVERY}
LONG = sorted((w for w in EVERY if len(w) > 4 or w > "z"), key=lambda w: (-len(w), w))
"""Words that are found within a longer one: Zuggeschwindigkeit."""
TOKEN = re.compile("|".join(w for w in LONG if w > "z") + r"|[a-z]+|\d+")


class Told(NamedTuple):
    """What a column is by its name."""

    stem: str
    number: int
    unit: str
    """"" where neither file nor name states it."""
    guessed: bool
    needs: str = ""
    """Key of the mapping file without which the column is of no use."""


def _tokens(name: str) -> list[str]:
    """Words and numbers of a name; car A is car 1."""
    # BremsKraft are two words, kN is one
    plain = re.sub(r"(?<=[a-z])(?=[A-Z][a-z])|(?<=[a-z]{2})(?=[A-Z])", "_", name)
    letters = unicodedata.normalize("NFKC", plain.replace("ß", "ss").lower())
    letters = letters.translate({ord("ä"): "ae", ord("ö"): "oe", ord("ü"): "ue"})
    letters = re.sub("[\u0300-\u0302]", "", unicodedata.normalize("NFD", letters))
    found: list[str] = []
    for token in TOKEN.findall(unicodedata.normalize("NFC", letters)):
        before = found[-1] if found else ""
        if token in set("abcdefgh") and len(before) > 1 and "car" in MEANINGS.get(before, ()):
            token = str(ord(token) - 96)
        found += ([] if token in EVERY else re.findall("|".join(LONG), token)) or [token]
    return found


def _meaning(tokens: list[str], unit: str) -> tuple[str, str, bool]:
    """Place and kind of quantity, "" where nothing tells it, and whether a word does; the unit decides."""
    short = {t for t in tokens if t in AMBIGUOUS or (len(t) == 1 and t < "z")}
    sure = {m for t in tokens if t not in short for m in MEANINGS.get(t, ())}
    unsure = {m for t in short for m in MEANINGS.get(t, ())}
    said = sure & set(SI) or unsure & set(SI)
    places = sure & set(PLACES) or unsure & set(PLACES)
    place = next((one for one in PLACES if one in places), "")
    kinds, known = kinds_of(unit), bool(sure & set(SI))
    both = (said | ({"turning"} if "speed" in said else set())) & kinds
    if both:
        return place, min(both, key=lambda k: (k == "turning", k)), known
    if len(said) > 1:
        said -= {"time", "position"}
    said = kinds - {"pulses", "slope"} or said
    return place, said.pop() if len(said) == 1 else "", known


def _numbers_of(names: dict[str, list[str]], train: MeasuredTrain) -> dict[str, int]:
    """Number of the axle, car or coupler in each name, by all names that differ in nothing but numbers.

    Axles count through the train, within their car, or within bogies; from 0 or from 1.
    """
    groups: dict[str, dict[str, list[int]]] = {}
    for name, tokens in names.items():
        if digits := [int(t) for t in tokens if t.isdigit()]:
            groups.setdefault(" ".join("#" if t.isdigit() else t for t in tokens), {})[name] = digits  # fmt: skip
    from_zero = any(len(g) > 1 and min(d[-1] for d in g.values()) == 0 for g in groups.values())
    found = {}
    for key, group in groups.items():
        of_car = any("car" in MEANINGS.get(t, ()) for t in key.split())
        last = [digits[-1] + from_zero for digits in group.values()]
        apart = len(set(last)) == len(last)
        for name, digits in group.items():
            car, *bogie, own = (
                [n + from_zero for n in digits] if len(digits) > 1 else [0, digits[0] + from_zero]
            )
            if any("coupler" in MEANINGS.get(t, ()) for t in key.split()):
                own = digits[0]
            elif car and of_car and not (apart and max(last) > 4):
                in_car = [d[-1] for d in group.values() if d[0] == digits[0]]
                if bogie and len(set(in_car)) < len(in_car):
                    own += (bogie[0] - 1) * (max(in_car) + from_zero)
                own += int((train.axle_car < car - 1).sum())
            elif car and not apart:
                own += (car - 1) * max(last)
            found[name] = own
    return found


def told_by_names(units: dict[str, str], train: MeasuredTrain) -> dict[str, Told]:
    """What columns are, whose stated units are given by name; those that nothing tells are not in the result."""
    found: dict[str, Told] = {}
    rest: dict[str, tuple[list[str], str]] = {}
    for name, stated in units.items():
        if own := parse_column(name):
            unit = QUANTITIES[own.quantity].units[own.unit]
            found[name] = Told(own.quantity, own.number, unit, False, NEEDS.get(own.quantity, ""))
        else:
            plain, unit = unit_in(name)
            rest[name] = (_tokens(plain), stated if kinds_of(stated) else unit)
    taken = {Assigned("", told.stem, told.number).place for told in found.values()}
    ruled = any(place == "wheel" for place, _ in taken)
    numbers = _numbers_of({name: tokens for name, (tokens, _) in rest.items()}, train)
    guesses = []
    for order, (name, (tokens, unit)) in enumerate(rest.items()):
        place, kind, known = _meaning(tokens, unit)
        rank = next((k for k, word in enumerate(WORDS["train"].split()) if word in tokens), 99)
        if not place and (rank == 99 or "v" in tokens) and name in numbers and kind in OF_AXLES:
            place = "axle"
        of_wheel = kind == "turning" and place == "axle"
        what = "speed" if of_wheel else "gradient" if kind == "slope" else kind
        stem, number = (f"{PLACES[place]}_{what}", numbers.get(name, 0)) if place else (what, 0)
        if kind == "time" and not known and name in numbers:
            continue  # T_1 is no time
        unit = unit if kind in kinds_of(unit) else ""
        # beside columns that follow the rules, only what they lack is guessed: time, wheels
        if stem in QUANTITIES and bool(place) == bool(number) and (unit or stem == "time" or not ruled):  # fmt: skip
            motor = kind in ("turning", "torque") and any("motor" in MEANINGS.get(t, ()) for t in tokens)  # fmt: skip
            needs = "gear_ratio" if motor else NEEDS.get(stem, "")
            told = Told(stem, number, unit, True, needs)
            guesses.append((rank if stem == "speed" else not known, order, name, told))
    for _, _, name, told in sorted(guesses):
        place_of = Assigned("", told.stem, told.number).place
        if place_of not in taken:
            found[name] = told
            taken |= set() if told.needs else {place_of}
    return {name: found[name] for name in units if name in found}


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
