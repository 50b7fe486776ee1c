"""What the train remembers of its line: open or tunnel, and gradient, by position (JP H07-322414 Figs. 2, 5)."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.errors import OnboardError
from alloc.plant.equations import gradient_force
from alloc.plant.model import Floats


@dataclass(frozen=True)
class LineMemory:
    """Section memory 72 and gradient memory 75.

    `stations` [m] are the starts of sections with `gradients` [%] (the source's Y: rise per run times 100), before the first
    and beyond the last the nearest holds; `tunnels`: start and end of each [m]. `offsets` [m]: where along the train the
    memory is read, relative to the position that is reported. The source reads at one position, (0.0,); the middle of every
    car is nearer to a long train, which passes a tunnel mouth gradually (not in the source): `air_shares` of the air
    resistance and `mass_shares` of the mass belong to each of `offsets`, equal ones where none are given. Without feedback,
    a change of d [m/s2] met by a train of length L at speed V changes the speed for a while. The change is d L / (2 V) if
    the memory is read at the front, d L / (8 V) if it is read in the middle.
    """

    stations: tuple[float, ...] = (0.0,)
    gradients: tuple[float, ...] = (0.0,)
    tunnels: tuple[tuple[float, float], ...] = ()
    offsets: tuple[float, ...] = (0.0,)
    air_shares: tuple[float, ...] = ()
    mass_shares: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if len(self.stations) != len(self.gradients) or not self.stations:
            raise OnboardError(
                f"line memory: {len(self.stations)} stations and {len(self.gradients)} gradients; give as "
                "many of each, at least one"
            )
        for name in ("stations", "gradients", "offsets"):
            values = getattr(self, name)
            if not values or not np.all(np.isfinite(values)):
                raise OnboardError(f"line memory: {name} = {values} must be finite, at least one")
        if any(b < a for a, b in zip(self.stations, self.stations[1:], strict=False)):
            raise OnboardError(f"line memory: stations {self.stations} must not fall")
        for start, end in self.tunnels:
            if not start < end:
                raise OnboardError(f"line memory: tunnel from {start} to {end} m must end later")
        for name in ("air_shares", "mass_shares"):
            shares = getattr(self, name)
            if shares and not (
                len(shares) == len(self.offsets)
                and min(shares) >= 0.0
                and abs(sum(shares) - 1.0) < 1e-9
            ):
                raise OnboardError(
                    f"line memory: {name} = {shares} must be one per offset, 0 or greater, of the sum 1"
                )

    @cached_property
    def _slopes(self) -> Floats:
        """g sin(theta) [m/s2] of each section; sin(theta) = (Y/100) / sqrt(1 + (Y/100)^2), (1)."""
        return np.array([float(gradient_force(1.0, y / 100.0)) for y in self.gradients])

    @cached_property
    def _pieces(self) -> tuple[Floats, Floats, Floats]:
        """Places [m] of changes; share in tunnels (0 or 1) and g sin(theta) [m/s2] before, between and behind them."""
        mouths = [mouth for tunnel in self.tunnels for mouth in tunnel]
        places = np.unique(np.array([*self.stations, *mouths]))
        at = np.append(places[0] - 1.0, places)
        inside = np.zeros(at.size)
        for start, end in self.tunnels:
            inside[(at >= start) & (at < end)] = 1.0
        section = np.clip(np.searchsorted(self.stations, at, side="right") - 1, 0, None)
        return places, inside, self._slopes[section]

    def read(self, position: ArrayLike) -> tuple[Floats, Floats]:
        """Share in tunnels (0 or 1 where the memory is read at one point) and g sin(theta) [m/s2] at `position` [m]."""
        places, inside, slopes = self._pieces
        x = np.asarray(position, dtype=float)[..., None] + np.asarray(self.offsets)
        piece = places.searchsorted(x, side="right")
        return _over(inside[piece], self.air_shares), _over(slopes[piece], self.mass_shares)

    @cached_property
    def changes(self) -> tuple[float, ...]:
        """Positions [m] at which section or gradient change."""
        mouths = [mouth for tunnel in self.tunnels for mouth in tunnel]
        grades = zip(self.stations[1:], self.gradients, self.gradients[1:], strict=False)
        return tuple(sorted([*mouths, *(x for x, before, after in grades if before != after)]))

    def straddled(self, position: ArrayLike, length: float) -> NDArray[np.bool_]:
        """Whether one of the `changes` lies under the train, whose `length` [m] is behind `position` [m]."""
        x = np.asarray(position, dtype=float)
        changes = np.array(self.changes)
        return changes.searchsorted(x, side="right") > changes.searchsorted(
            x - length, side="right"
        )


def _over(values: Floats, shares: tuple[float, ...]) -> Floats:
    """Mean of `values` (..., offsets) by `shares`, the plain mean where there are none; (...)."""
    if shares:
        found: Floats = values @ np.array(shares)
        return found
    return np.add.reduce(values, axis=-1) / values.shape[-1]
