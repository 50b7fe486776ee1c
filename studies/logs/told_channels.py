"""What the columns of a recording are, and its channels in SI units, one after another."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.series import spans
from studies.logs.assignment import Assigned, by_name, check_assignment
from studies.logs.channel_values import carried, forwards, numbers, scale_of
from studies.logs.clock import Clock, read_clock
from studies.logs.common_instants import longest
from studies.logs.guessing import described, guess
from studies.logs.known_train import MeasuredTrain
from studies.logs.mapping import Mapping
from studies.logs.own_samples import Samples, own_samples, smoothed_steps
from studies.logs.raw_channels import Recording
from studies.logs.remarks import NAMED, Remark, faulty

Floats = NDArray[np.float64]

FEWEST_ROWS = 10


@dataclass(eq=False)
class Sources:
    """The channels of a log, which are read one after another; remarks grow with them."""

    recording: Recording
    train: MeasuredTrain
    assigned: dict[tuple[str, int], Assigned]
    """By place, see `Assigned.place`."""
    clock: Clock | None
    """Of the rows; None where every channel has its own."""
    remarks: list[Remark] = field(default_factory=list)

    @property
    def source(self) -> str:
        """Name of the log."""
        return self.recording.source

    def numbers_of(self, *places: str) -> list[int]:
        """Numbers that columns of a place have, growing."""
        return sorted(number for name, number in self.assigned if name in places)

    def series(self, place: tuple[str, int]) -> tuple[Floats, Floats]:
        """Instants [s] and values of a channel as the file has them, nan where it has none; for once only."""
        one = self.assigned[place]
        raw = self.recording.channels[one.column]
        time = raw.clock
        values, found = numbers(self.recording.take(one.column), one.column, self.source)
        self.remarks += found
        if time is None:
            assert self.clock is not None
            time, values = self.clock.time, self.clock.of(values)
        order = np.diff(time)
        if order.size and order.min() <= 0.0:
            known = np.isfinite(values)
            time, values = time[known], values[known]
            first = np.concatenate([[True], np.diff(time) > 0.0])
            again = int((~first).sum())
            if again:
                text = (
                    f"{again} instant{'s' if again > 1 else ''} with two values: the first is used"
                )
                if not any(remark.text == text for remark in self.remarks):
                    self.remarks.append(Remark("time", one.column, text))
            time, values = time[first], values[first]
        return time, values

    def scaled(self, place: tuple[str, int], values: Floats, like: Floats | None = None) -> Floats:
        """Values of a channel in SI units; a turning speed becomes that of the rim. `like` [m/s]: another speed."""
        one = self.assigned[place]
        scale, turning = one.factor, one.turning
        if scale is None:
            scale, unit, turning = scale_of(one, values, like, self.train)
            text = f"no unit, read as {unit}"
            self.remarks.append(Remark("guess", one.column, text))
        scale *= one.sign
        if turning:
            scale *= float(self.train.radius[one.number - 1])
        return values if scale == 1.0 else values * scale

    def note_missing(self, name: str, time: Floats, values: Floats, samples: Samples) -> None:
        """Remark on what a channel lacks, and on how its samples are told; long stretches are named, short ones counted."""
        missing = ~np.isfinite(values)
        count = int(missing.sum())
        if count == values.size:
            self.remarks.append(Remark("missing", name, "no value at all"))
            return
        if samples.kind != "sampled":
            words = {
                "held": "held in between",
                "interpolated": "interpolated in between",
                "quantised": "rounded",
            }
            text = f"a value every {samples.period:.4g} s, {words[samples.kind]}"
            self.remarks.append(Remark("sampling", name, text))
        if count == 0:
            return
        reach = longest(samples.period)
        stretches = spans(missing)
        first, last = (
            np.maximum(stretches[:, 0] - 1, 0),
            np.minimum(stretches[:, 1], values.size - 1),
        )
        far = stretches[time[last] - time[first] > reach * (1.0 + 1e-9)]
        for begin, end in far[:NAMED].tolist():
            rows = f"row {begin + 1}" if end == begin + 1 else f"rows {begin + 1} to {end}"
            text = f"no value in {rows}, {time[begin]:.6g} s to {time[end - 1]:.6g} s"
            self.remarks.append(Remark("missing", name, text, begin + 1, float(time[begin])))
        if len(far) > NAMED:
            text = f"no value in {len(far) - NAMED} more stretches"
            self.remarks.append(Remark("missing", name, text))
        if len(far) < len(stretches):
            row = int(np.flatnonzero(missing)[0]) + 1
            share = 100.0 * count / values.size
            rows = (
                f"{share:.0f} % of the rows" if share > 10.0 else f"{count} rows, the first {row}"
            )
            rows = f"row {row}" if count == 1 else rows
            text = f"no value in {rows}, interpolated over up to {reach:.2g} s"
            self.remarks.append(Remark("missing", name, text, row))

    def speed(self, place: tuple[str, int], like: Floats | None = None) -> Samples:
        """Own samples of a speed [m/s] that counts forwards."""
        time, values = self.series(place)
        name = self.assigned[place].column
        values = self.scaled(place, values, like)
        values, found = forwards(name, values, self.source)
        self.remarks += found
        samples = own_samples(time, values, rounded=True)
        if place[0] == "wheel" and samples.kind == "quantised":
            samples = smoothed_steps(time, values, samples)
        self.note_missing(name, time, values, samples)
        return samples

    def force(self, axle: int) -> Samples:
        """Own samples of what acts on an axle, at the rim [N]."""
        place = ("effort", axle)
        one = self.assigned[place]
        time, values = self.series(place)
        if one.quantity == "axleN_pressure":
            # a cylinder only brakes
            values = -self.scaled(place, values) * (one.newton_per_pascal or 0.0)
        else:
            values = self.scaled(place, values)
        if one.quantity == "axleN_torque":
            values = values / float(self.train.radius[axle - 1])
        load = float(self.train.axle_load[axle - 1])
        values, found = carried(one.column, values, load, self.source)
        self.remarks += found
        samples = own_samples(time, values)
        self.note_missing(one.column, time, values, samples)
        return samples

    def plain(self, place: tuple[str, int]) -> Samples:
        """Own samples of any other channel."""
        time, values = self.series(place)
        values = self.scaled(place, values)
        samples = own_samples(time, values)
        self.note_missing(self.assigned[place].column, time, values, samples)
        return samples


def open_sources(
    recording: Recording, train: MeasuredTrain, mapping: Mapping | None, owner: str
) -> Sources:
    """Find out what the columns of a recording are and read its clock; `owner` names the mapping file in messages."""
    source = recording.source
    remarks = [Remark("read", "", note) for note in recording.notes]
    period = None
    if mapping is not None:
        assigned = mapping.assigned(recording, owner)
        unknown: list[str] = []
        remarks += _left_out(recording, train, assigned)
        period = mapping.time.period_s
    else:
        assigned, unknown, guessed = _told_by_names(recording, train)
        remarks += guessed
    own_clocks = all(recording.channels[one.column].clock is not None for one in assigned)
    if own_clocks:
        assigned = [one for one in assigned if one.quantity != "time"]
    named = assigned + ([Assigned("", "time")] if own_clocks else [])
    remarks += check_assignment(named, unknown, train, source)
    assigned = [one for one in assigned if _usable(one, remarks)]
    clock = None
    if not own_clocks:
        column = next(one for one in assigned if one.quantity == "time")
        raw = recording.take(column.column)
        if raw.size < FEWEST_ROWS:
            raise faulty(
                source,
                column.column,
                None,
                f"{raw.size} rows; give {FEWEST_ROWS} or more to be analysed",
            )
        clock = read_clock(raw, column.column, column.unit, source, period)
        remarks += clock.remarks
    by_place = {one.place: one for one in assigned}
    return Sources(recording, train, by_place, clock, remarks)


def _usable(one: Assigned, remarks: list[Remark]) -> bool:
    if one.quantity == "axleN_pressure" and one.newton_per_pascal is None:
        text = "not used: a mapping file gives newton_per_kpa, the brake force at the rim of 1 kPa"
        remarks.append(Remark("unknown", one.column, text))
        return False
    if one.quantity == "axleN_pulses" and one.pulses_per_turn is None:
        text = "not used: a mapping file gives pulses_per_turn"
        remarks.append(Remark("unknown", one.column, text))
        return False
    return True


def _named_and_guessed(
    recording: Recording, train: MeasuredTrain, mapped: list[Assigned]
) -> tuple[dict[str, Assigned], dict[str, Assigned]]:
    """What columns beside the `mapped` ones are by their names, and by guesses of the others."""
    known, taken = {one.column for one in mapped}, {one.place for one in mapped}
    rest = [name for name in recording.channels if name not in known]
    named = {name: one for name in rest if (one := by_name(name)) and one.place not in taken}
    taken |= {one.place for one in named.values()}
    return named, guess([n for n in rest if n not in named], recording.units, taken, train)


def _told_by_names(
    recording: Recording, train: MeasuredTrain
) -> tuple[list[Assigned], list[str], list[Remark]]:
    """What columns are without a mapping file; those that stay unknown; what was guessed."""
    named, guessed = _named_and_guessed(recording, train, [])
    if any(one.place[0] == "wheel" for one in named.values()):
        # beside columns that follow the rules, only what they lack is guessed: time, wheels
        guessed = {n: g for n, g in guessed.items() if g.factor is not None or g.quantity == "time"}
    remarks = [Remark("guess", *line) for line in described(guessed, recording.units)]
    unknown = [name for name in recording.channels if name not in named and name not in guessed]
    return [*named.values(), *guessed.values()], unknown, remarks


def _left_out(recording: Recording, train: MeasuredTrain, mapped: list[Assigned]) -> list[Remark]:
    """Remarks on columns that a mapping file does not name, although their names tell what they are."""
    named, guessed = _named_and_guessed(recording, train, mapped)
    return [
        Remark("unknown", column, f"the mapping file does not name {text}; so it is not used")
        for column, text in described(named | guessed, recording.units)
    ]
