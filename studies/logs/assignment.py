"""Which column of a log is what: by its name, by a mapping file, or by a guess that is printed."""

from dataclasses import dataclass

from studies.files.study_error import StudyError
from studies.logs.columns import (
    EFFORT,
    QUANTITIES,
    TURNING,
    WHEEL,
    column_of,
    near_column,
    parse_column,
)
from studies.logs.known_train import MeasuredTrain
from studies.logs.remarks import Remark, faulty


@dataclass(frozen=True)
class Assigned:
    """What a column is, and how its values become SI units."""

    column: str
    quantity: str
    number: int = 0
    """From 1; 0 for a quantity of the whole train."""
    factor: float | None = 1.0
    """Factor to SI; None: it must be determined from the values."""
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
        for name, group in (("wheel", WHEEL), ("effort", EFFORT)):
            if self.quantity in group:
                return name, self.number
        return self.quantity, self.number


def by_name(name: str) -> Assigned | None:
    """What a column is by its name; None if its name is none of `studies.logs.columns`."""
    column = parse_column(name)
    if column is None:
        return None
    return Assigned(
        name, column.quantity, column.number, QUANTITIES[column.quantity].units[column.unit],
        turning=column.quantity == "axleN_speed" and column.unit in TURNING, unit="s" if column.quantity == "time" else "",
    )  # fmt: skip


def check_assignment(
    assigned: list[Assigned], unknown: list[str], train: MeasuredTrain, source: str
) -> list[Remark]:
    """Remarks on columns that are not used; raises for what the train does not have, is there twice, or is missing."""
    axles, cars = train.radius.size, train.car_mass.size
    most = {"axleN": axles, "couplerK": cars - 1, "carK": cars}
    seen: dict[tuple[str, int], str] = {}
    for one in assigned:
        kind = one.quantity.split("_")[0]
        if kind in most and not 1 <= one.number <= most[kind]:
            raise faulty(
                source, one.column, None, f"train {train.name!r} has {axles} axles and {cars} cars"
            )
        if one.place in seen:
            raise faulty(source, one.column, None, f"is the same as {seen[one.place]!r}; give one")
        seen[one.place] = one.column
    remarks = []
    for name in unknown:
        near = near_column(name)
        hint = f"; did you mean {near!r}?" if near else ""
        remarks.append(Remark("unknown", name, f"is not known and not used{hint}"))
    meant = {name: _quantity_meant(name) for name in unknown}
    for stem, quantity in QUANTITIES.items():
        place = "wheel" if stem == "axleN_speed" else stem
        if any(key[0] == place for key in seen):
            continue
        like = [name for name, own in meant.items() if own == stem]
        # a speed that is only misspelt shall not be estimated
        if quantity.required or (stem == "speed" and like):
            hint = f"; is it {like[0]!r}?" if like else _has(unknown)
            wanted = " or ".join(f"{stem}_{unit}" for unit in quantity.units)
            raise faulty(source, wanted, None, f"is missing: {quantity.description}{hint}")
    return remarks


def _has(unknown: list[str]) -> str:
    """What to do about columns that nobody understands, the first of them named."""
    some = ", ".join(map(repr, unknown[:4])) + (", ..." if len(unknown) > 4 else "")
    told = f"; not understood: {some}" if some else ""
    return f"{told}; say in a mapping file (--mapping, docs/logs.md) which column is what"


def _quantity_meant(name: str) -> str | None:
    """Quantity of the column that a misspelt name resembles."""
    column = parse_column(near_column(name) or "")
    return None if column is None else column.quantity


def stem_of(word: str, owner: str) -> tuple[str, int]:
    """Quantity and number of a word such as "axle3_speed"; raises `StudyError` for any other word."""
    for stem, quantity in QUANTITIES.items():
        column = parse_column(f"{word}_{next(iter(quantity.units))}")
        if column is not None and column.quantity == stem:
            return stem, column.number
    known = ", ".join(column_of(stem, 1, "")[:-1] for stem in QUANTITIES)
    raise StudyError(f"{owner}: {word!r} is no quantity; give one of {known} (numbers from 1)")
