"""What a column probably is, by the words of its name and by its unit, where no mapping file says it.

Words of English and German that loggers use; the kind of the unit decides where the words leave it open.
"""

import re
import unicodedata
from itertools import groupby

from studies.logs.assignment import Assigned
from studies.logs.channel_units import SPELT, clean, factor, kinds_of
from studies.logs.columns import QUANTITIES
from studies.logs.known_train import MeasuredTrain

WORDS: dict[str, set[str]] = {
    "time": {"time", "zeit", "timestamp", "t", "datetime", "date", "utc", "epoch", "uhrzeit", "zeitstempel", "seconds",
             "timestamps", "temps", "clock"},
    "axle": {"axle", "axles", "achse", "ax", "wheelset", "wheel", "radsatz", "rad", "ws", "essieu", "rs", "axis",
             "whl", "wheelspeed"},
    "car": {"car", "wagen", "coach", "vehicle", "veh", "wagon", "fahrzeug", "wg", "wag", "w", "voiture"},
    "coupler": {"coupler", "kupplung", "coupling", "drawbar", "cpl", "draft"},
    "speed": {"speed", "v", "vel", "velocity", "geschwindigkeit", "geschw", "vitesse", "n", "rpm", "drehzahl", "omega",
              "rotation", "rot", "spd", "tempo", "kmh", "rads"},
    "force": {"force", "kraft", "f", "effort", "te", "zugkraft", "bremskraft", "fx", "frc",
              "laengskraft"},
    "torque": {"torque", "moment", "drehmoment", "m", "tq", "trq", "couple"},
    "acceleration": {"acceleration", "acc", "accel", "beschleunigung", "a", "ax"},
    "slope": {"gradient", "grade", "slope", "neigung", "steigung", "inclination", "laengsneigung",
              "pente", "rampe"},
    "position": {"position", "pos", "distance", "weg", "chainage", "mileage", "station", "kilometer", "dist"},
    "pressure": {"pressure", "druck", "p", "bc", "bcp", "bremszylinder", "pc", "cyl", "cylinder",
                 "pression"},
    "pulses": {"pulse", "pulses", "count", "counts", "impulse", "impuls", "imp", "ticks", "encoder", "cnt"},
}  # fmt: skip
"""Words by what they mean."""
JAPANESE = {
    "列車速度": "train speed", "対地速度": "ground speed", "車速": "train speed", "加速度": "acceleration", "速度": "speed",
    "周速": "speed", "回転数": "rpm", "回転速度": "rpm", "時刻": "time", "時間": "time",
    "輪軸": "axle", "車軸": "axle", "軸": "axle", "号車": "car", "車両": "car",
    "連結器": "coupler", "トルク": "torque", "シリンダ": "cylinder",
    "圧力": "pressure", "圧": "pressure", "力": "force", "勾配": "gradient", "キロ程": "position", "位置": "position",
    "パルス": "pulses", "主電動機": "motor", "電動機": "motor",
}  # fmt: skip
"""Japanese words, the longer before those that they contain."""
MOTOR = {"motor", "mot", "tm", "fahrmotor", "moteur"}
"""Words of what turns with the motor, whose gear ratio nobody can guess."""
GROUND = ("ground", "gps", "gnss", "radar", "doppler", "train", "zug", "v")
"""Words of a train's speed, the surest first."""
AMBIGUOUS = {"m", "n", "t", "a", "p", "f", "v", "w", "rad", "ax", "bc"}
"""Words that count only if no longer one says anything."""


def guess(
    names: list[str], units: dict[str, str], taken: set[tuple[str, int]], train: MeasuredTrain
) -> dict[str, Assigned]:
    """What columns with these `names` and stated `units` are; nothing that is `taken` or that nothing tells."""
    found: dict[str, Assigned] = {}
    speeds: list[tuple[int, str, Assigned]] = []
    places = _places(names, train)
    for name in names:
        one = _guess(name, units.get(name, ""), places.get(name))
        if one is None or one.place in taken:
            continue
        if one.quantity == "speed":
            tokens, _ = _tokens(name)
            rank = next((k for k, word in enumerate(GROUND) if word in tokens), len(GROUND))
            speeds.append((rank, name, one))
        elif one.place not in {other.place for other in found.values()}:
            found[name] = one
    for _, name, one in sorted(speeds, key=lambda item: item[0])[:1]:
        found[name] = one
    return found


def described(guessed: dict[str, Assigned], units: dict[str, str]) -> list[tuple[str, str]]:
    """Guesses in words, each with the first column that it is of: a line for all columns that differ by their number."""
    alike: dict[tuple[str, str, str], list[Assigned]] = {}
    for name, one in guessed.items():
        key = (_without_numbers(name), one.quantity, units.get(name, "") or unit_in(name))
        alike.setdefault(key, []).append(one)
    lines = []
    for (_, quantity, unit), group in alike.items():
        first, last = group[0], group[-1]
        numbers = str(first.number) if len(group) == 1 else f"{first.number} to {last.number}"
        names = repr(first.column) if len(group) == 1 else f"{first.column!r} to {last.column!r}"
        stem, _, what = quantity.rpartition("_")
        place = f"{stem.rstrip('NK')} {numbers} " if stem else ""
        text = f"{names}: {place}{what}" + (f" in {unit}" if unit else "")
        lines.append((first.column, text))
    return lines


def _tokens(name: str) -> tuple[list[str], str]:
    """Words and numbers of a name, and the unit in its brackets or at its end."""
    plain = name.strip()
    unit = ""
    bracket = re.search(r"[\[({]\s*([^\])}]+?)\s*[\])}]\s*$", plain)
    if bracket:
        unit, plain = bracket.group(1), plain[: bracket.start()]
    stated = plain
    for word, english in JAPANESE.items():
        plain = plain.replace(word, f"_{english.replace(' ', '_')}_")
    # BremsKraft are two words, kN is one
    plain = re.sub(r"(?<=[a-z])(?=[A-Z][a-z])|(?<=[a-z]{2})(?=[A-Z])", "_", plain)
    letters = unicodedata.normalize("NFKD", plain.replace("ß", "ss").lower())
    for umlaut, pair in (("a\u0308", "ae"), ("o\u0308", "oe"), ("u\u0308", "ue")):
        letters = letters.replace(umlaut, pair)
    tokens = re.findall(r"[a-z]+|\d+", letters)
    if not unit and len(tokens) > 1:
        for count in (2, 1):
            tail = re.split(r"[_\s.]+", stated)[-count:]
            spelt = "/".join(tail) if count == 2 else tail[-1]
            if (
                clean(spelt).lower() in SPELT
                and not spelt.isdigit()
                and len(clean(spelt)) > (count == 1)
            ):
                unit = spelt
                break
    return tokens, unit


def unit_in(name: str) -> str:
    """The unit that a column's name states, "" if none."""
    return _tokens(name)[1]


def _meanings(tokens: list[str]) -> set[str]:
    sure = {
        m for m, words in WORDS.items() if any(t in words and t not in AMBIGUOUS for t in tokens)
    }
    unsure = {m for m, words in WORDS.items() if any(t in words and t in AMBIGUOUS for t in tokens)}
    kinds = {
        "speed",
        "force",
        "torque",
        "acceleration",
        "slope",
        "position",
        "pressure",
        "pulses",
        "time",
    }
    places = {"axle", "car", "coupler"}
    found = set(sure)
    if not found & kinds:
        found |= unsure & kinds
    if not found & places:
        found |= unsure & places
    return found


def _guess(name: str, stated: str, told: int | None) -> Assigned | None:
    tokens, written = _tokens(name)
    unit = stated or written
    meanings = _meanings(tokens)
    kinds = set(kinds_of(unit)) if clean(unit) else set()
    place = next((p for p in ("axle", "coupler", "car") if p in meanings), None)
    kind = _kind(meanings, kinds)
    if kind is None:
        return None
    if (
        place is None
        and kind in ("speed", "turning", "force", "torque", "pulses")
        and _numbers(tokens)
    ):
        place = None if any(word in tokens for word in GROUND[:-1]) else "axle"
    if place is None:
        stem = {"time": "time", "speed": "speed", "slope": "gradient", "position": "position"}.get(
            kind
        )
        number = 0
    else:
        prefix = {"axle": "axleN", "car": "carK", "coupler": "couplerK"}[place]
        stem = f"{prefix}_{'speed' if kind == 'turning' else kind}"
        if told is None:
            return None
        number = told if place != "coupler" else _numbers(tokens)[0]
    if place == "axle" and kind in ("turning", "torque") and any(t in MOTOR for t in tokens):
        return None
    if stem not in QUANTITIES:
        return None
    scale = factor(unit, kind) if clean(unit) else None
    return Assigned(
        name, stem, number, scale, turning=kind == "turning", unit=unit if stem == "time" else ""
    )


def _kind(meanings: set[str], kinds: set[str]) -> str | None:
    """The kind of quantity, by its words and by its unit, which decides."""
    said = meanings - {"axle", "car", "coupler"}
    if "speed" in said:
        said = said | {"turning"}
    both = said & kinds
    if both:
        return sorted(both, key=lambda k: k == "turning")[0]
    real = kinds - {"pulses", "slope"}
    if real:
        return next(iter(real)) if len(real) == 1 else None
    said -= {"turning"}
    if len(said) > 1:
        said -= {"time", "position"}
    return next(iter(said)) if len(said) == 1 else None


def _numbers(tokens: list[str]) -> list[int]:
    return [int(t) for t in tokens if t.isdigit()]


def _places(names: list[str], train: MeasuredTrain) -> dict[str, int]:
    """The number of an axle, car or coupler in each name, by all names that differ in nothing but numbers.

    Axles may count through the train, within their car, or within the bogies of their cars; from 0 or from 1; cars may have
    letters.
    """
    zero_based = _zero_based(names)
    groups: dict[str, dict[str, list[int]]] = {}
    for name in names:
        tokens, _ = _tokens(name)
        numbers = _numbers(_with_letters(tokens))
        if numbers:
            key = " ".join("#" if t.isdigit() else t for t in _with_letters(tokens))
            groups.setdefault(key, {})[name] = [n + (1 if zero_based else 0) for n in numbers]
    found = {}
    for key, group in groups.items():
        of_cars = any(t in WORDS["car"] for t in key.split())
        last = [numbers[-1] for numbers in group.values()]
        through = len(set(last)) == len(last)
        bogies = max((numbers[1] for numbers in group.values() if len(numbers) > 2), default=1)
        for name, numbers in group.items():
            if len(numbers) == 1 or not of_cars or (through and max(last) > 4):
                found[name] = numbers[-1]
                continue
            car, own = numbers[0], numbers[-1]
            in_car = {tuple(n): n[-1] for n in group.values() if n[0] == car}
            if len(numbers) > 2 and len(set(in_car.values())) < len(in_car):
                own += (numbers[1] - 1) * int((train.axle_car == car - 1).sum()) // bogies
            found[name] = int((train.axle_car < car - 1).sum()) + own
    return found


def _with_letters(tokens: list[str]) -> list[str]:
    """Words with the letter after a car's word as a number: car A is car 1."""
    return [
        str(ord(t) - ord("a") + 1)
        if len(t) == 1
        and "a" <= t <= "h"
        and k
        and tokens[k - 1] in WORDS["car"]
        and len(tokens[k - 1]) > 1
        else t
        for k, t in enumerate(tokens)
    ]


def _zero_based(names: list[str]) -> bool:
    """Whether axles count from 0."""
    for _, group in groupby(sorted(names, key=_without_numbers), key=_without_numbers):
        found = [_numbers(_tokens(name)[0]) for name in group]
        last = [numbers[-1] for numbers in found if numbers]
        if len(last) > 1 and min(last) == 0:
            return True
    return False


def _without_numbers(name: str) -> str:
    return re.sub(r"\d+", "#", name)
