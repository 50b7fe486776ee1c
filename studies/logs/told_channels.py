"""Own samples of a log's channels, as the stages that bring them to common instants take them."""

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.series import spans
from studies.logs.channel_values import carried, forwards
from studies.logs.common_instants import longest
from studies.logs.known_train import MeasuredTrain
from studies.logs.mapping import Mapping
from studies.logs.own_samples import Samples, own_samples, smoothed_steps
from studies.logs.raw_channels import FEWEST_ROWS, RawChannels, open_channels
from studies.logs.recorder_files import Recording
from studies.logs.remarks import NAMED, Remark

__all__ = ["FEWEST_ROWS", "Sources", "open_sources"]

Floats = NDArray[np.float64]


class Sources(RawChannels):
    """The channels of a log, with their own samples."""

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
        values = self.scaled(place, values)
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
    """`open_channels`, for the stages."""
    return Sources(**vars(open_channels(recording, train, mapping, owner)))
