"""The values of a log's channels in SI units, on their own instants: numbers checked, signs and units that nobody stated."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.series import spans
from studies.logs.clock import Clock, read_clock
from studies.logs.mapping import QUANTITIES, SHARED, Assigned, Mapping, assigned, draft, near_column
from studies.logs.own_samples import BRIDGED, WORDS, Samples, numbers, own_samples, pulse_step
from studies.logs.recorder_files import Recording
from studies.logs.remarks import NAMED, Faulty, Remark, faulty
from studies.logs.train import MeasuredTrain

Floats = NDArray[np.float64]

FASTEST = 160.0
"""Speed [m/s] that no train on wheels has exceeded in service or on test."""
BACKWARDS = -2.0
"""Speed [m/s] down to which a negative one passes: noise at standstill, or a train that rolls back."""
IMPLAUSIBLE = 0.01
"""Share of the values of a channel that may be impossible, and are left out."""
LARGEST_COEFFICIENT = 1.0
"""Force over axle load that no wheel on a rail carries (dry rail: 0.3 to 0.6)."""
MOVING = 1.0
"""Speed [m/s] above which a speed has a sign."""


def forwards(name: str, speed: Floats, source: str) -> tuple[Floats, list[Remark]]:
    """A speed [m/s] that counts forwards, and what was done to it; raises for speeds that no train has."""
    remarks = []
    moving = np.isfinite(speed) & (np.abs(speed) > MOVING)
    if moving.any() and np.mean(speed[moving] < 0.0) > 0.98:
        speed = -speed
        remarks.append(Remark("sign", name, "negative all the time: the direction is turned round"))
    backwards = speed < BACKWARDS
    if backwards.any():
        # one pulse back in a row is no speed: the wheel rolls back a little
        backwards = speed < BACKWARDS - pulse_step(speed[np.isfinite(speed)])
    for bad, reason in (
        (speed > FASTEST, "m/s is faster than any train; wrong unit?"),
        (backwards, "m/s is negative; speeds count forwards, whichever way the train runs"),
    ):
        rows = np.flatnonzero(bad)
        if rows.size > IMPLAUSIBLE * speed.size:
            raise faulty(source, name, int(rows[0]) + 1, f"{speed[rows[0]]:.4g} {reason}")
        if rows.size:
            speed = np.where(bad, np.nan, speed)
            text = f"{rows.size} value{'s' if rows.size > 1 else ''} that no train has left out"
            remarks.append(Remark("faulty", name, text, int(rows[0]) + 1))
    return speed, remarks


def carried(name: str, force: Floats, load: float) -> tuple[Floats, list[Remark]]:
    """A force at the rim [N] without single values that no axle load [N] carries; where many are, its unit is wrong."""
    bad = np.abs(force) > LARGEST_COEFFICIENT * load
    rows = np.flatnonzero(bad)
    if rows.size == 0:
        return force, []
    if rows.size > IMPLAUSIBLE * force.size:
        return force, []
    text = f"{rows.size} value{'s' if rows.size > 1 else ''} beyond the axle load left out"
    return np.where(bad, np.nan, force), [Remark("faulty", name, text, int(rows[0]) + 1)]


FEWEST_ROWS = 10


@dataclass(eq=False)
class Channels:
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
        time = self.recording.channels[one.column].clock
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
            text = f"{again} instant{'s' if again > 1 else ''} with two values: the first is used"
            if again and not any(remark.text == text for remark in self.remarks):
                self.remarks.append(Remark("time", one.column, text))
            time, values = time[first], values[first]
        return time, values

    def scaled(self, place: tuple[str, int], values: Floats) -> Floats:
        """Values of a channel in SI units; a turning speed becomes that of the rim."""
        one = self.assigned[place]
        scale = one.factor * one.sign
        if one.turning:
            scale *= float(self.train.radius[one.number - 1])
        return values if scale == 1.0 else values * scale

    def note_missing(self, name: str, time: Floats, values: Floats, samples: Samples) -> None:
        """Remark on what a channel lacks, and on how its samples are told; long stretches are named, short ones counted."""
        missing = ~np.isfinite(values)
        count = int(missing.sum())
        if count == values.size:
            self.remarks.append(Remark("missing", name, "no value at all"))
            return
        if samples.kind not in ("sampled", "counted"):
            text = f"a value every {samples.period:.4g} s, {WORDS[samples.kind]}"
            self.remarks.append(Remark("sampling", name, text))
        if count == 0:
            return
        reach = max(BRIDGED, 1.5 * samples.period)
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

    def speed(self, place: tuple[str, int]) -> Samples:
        """Own samples of a speed [m/s] that counts forwards."""
        time, values = self.series(place)
        name = self.assigned[place].column
        values = self.scaled(place, values)
        values, found = forwards(name, values, self.source)
        self.remarks += found
        samples = own_samples(time, values, speed=True)
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
        values, found = carried(one.column, values, load)
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


def open_channels(
    recording: Recording, train: MeasuredTrain, mapping: Mapping | None, owner: str
) -> Channels:
    """Find out what the columns of a recording are and read its clock; `owner` names the mapping file in messages.

    Without a mapping the log is read by its draft. Raises `Faulty` for what the train does not have, is there twice, or is
    missing.
    """
    source = recording.source
    remarks = [Remark("read", "", note) for note in recording.notes]
    if mapping is None:
        owner, partial, period = f"log {source!r}", False, None
        found = draft(recording, train)
        known, of_size = assigned(found.columns, recording, train, owner)
        guessed = {name: found.told[name] for name in found.columns if found.told[name].guessed}
        remarks += [Remark("guess", *line) for line in found._replace(told=guessed).said()]
        for name, told in found.told.items():
            if told.needs:
                text = f"not used: a mapping file gives {told.needs}"
                remarks.append(Remark("unknown", name, text))
    else:
        partial, period = mapping.wheels.partial, mapping.time.period_s
        known, of_size = assigned(mapping.columns, recording, train, owner)
        found = draft(recording, train, {one.column: one for one in known})
        for column, text in found.said():
            left = f"the mapping file does not name {text}; so it is not used"
            remarks.append(Remark("unknown", column, left))
    remarks += of_size
    own_clocks = all(recording.channels[one.column].clock is not None for one in known)
    if own_clocks:
        known = [one for one in known if one.quantity != "time"]
    by_place = _by_place(known, train, source)
    unknown = [] if mapping else [n for n in recording.channels if n not in found.told]
    remarks += _lacking(by_place, unknown, own_clocks, source)
    all_told = [(one.quantity, one.number) for one in known]
    all_told += [(told.stem, told.number) for told in found.told.values()]
    axles = {number for stem, number in all_told if stem.startswith("axle")}
    count, first_car = len(axles), int((train.axle_car == 0).sum())
    # axles come in pairs: as many from the front, more than some of the first car, are another train
    alone = axles == set(range(1, count + 1)) and count % 2 == 0 and count >= first_car
    if alone and count < train.radius.size and not partial:
        raise Faulty(
            f"log {source!r}: {count} axles, the train has {train.radius.size}; give the log's own train, or say in a "
            "mapping file that the others were not measured: [wheels] partial = true"
        )
    clock = None
    if not own_clocks:
        time = by_place["time", 0]
        raw = recording.take(time.column)
        if raw.size < FEWEST_ROWS:
            text = f"{raw.size} rows; give {FEWEST_ROWS} or more to be analysed"
            raise faulty(source, time.column, None, text)
        clock = read_clock(raw, time.column, time.unit, source, period)
        remarks += clock.remarks
    return Channels(recording, train, by_place, clock, remarks)


def _by_place(
    known: list[Assigned], train: MeasuredTrain, source: str
) -> dict[tuple[str, int], Assigned]:
    axles, cars = train.radius.size, train.car_mass.size
    most = {"axleN": axles, "couplerK": cars - 1, "carK": cars}
    found: dict[tuple[str, int], Assigned] = {}
    for one in known:
        kind = one.quantity.split("_")[0]
        if kind in most and not 1 <= one.number <= most[kind]:
            text = f"train {train.name!r} has {axles} axles and {cars} cars"
            raise faulty(source, one.column, None, text)
        if one.place in found:
            text = f"is the same as {found[one.place].column!r}; give one"
            raise faulty(source, one.column, None, text)
        found[one.place] = one
    return found


def _lacking(
    known: dict[tuple[str, int], Assigned], unknown: list[str], own_clocks: bool, source: str
) -> list[Remark]:
    """Remarks on columns that are not used; raises for what is missing, with the name that may be misspelt."""
    near = {name: near_column(name) for name in unknown}
    places = {place for place, _ in known} | ({"time"} if own_clocks else set())
    for stem, quantity in QUANTITIES.items():
        like = [name for name, column in near.items() if column and column.quantity == stem]
        # a speed that is only misspelt shall not be estimated
        if SHARED.get(stem, stem) in places or not (quantity.required or (stem == "speed" and like)):  # fmt: skip
            continue
        wanted = " or ".join(f"{stem}_{unit}" for unit in quantity.units)
        hint = f"; is it {like[0]!r}?" if like else ""
        if not like:
            some = ", ".join(map(repr, unknown[:4])) + (", ..." if len(unknown) > 4 else "")
            hint = f"; not understood: {some}" if some else ""
            hint += "; say in a mapping file (--mapping, docs/logs.md) which column is what; --map drafts one"
        raise faulty(source, wanted, None, f"is missing: {quantity.description}{hint}")
    return [
        Remark("unknown", name, "is not known and not used"
               + (f"; did you mean {column.name!r}?" if column else ""))
        for name, column in near.items()
    ]  # fmt: skip
