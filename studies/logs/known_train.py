"""What must be known of a train to analyse its log."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from alloc.display import displayed
from alloc.plant.model import structure_of
from alloc.plant.train import Train

Floats = NDArray[np.float64]


@displayed
@dataclass(frozen=True, eq=False)
class MeasuredTrain:
    """Data of a train that are needed to compute forces from its series; axles and cars from the front."""

    name: str
    car_mass: Floats
    """With load [kg], (cars,)."""
    axle_car: NDArray[np.int64]
    """(axles,)"""
    axle_load: Floats
    """At rest [N], (axles,)."""
    radius: Floats
    """(axles,) [m]"""
    inertia: Floats
    """Of each wheelset with everything geared to it [kg m2], (axles,)."""
    driven: NDArray[np.bool_]
    """(axles,)"""
    resistance: Floats | None = None
    """Running resistance of each car by powers of the speed [N, N s/m, N s2/m2], (cars, 3); None: not known."""
    coupler: Floats | None = None
    """Stiffness, stiffening, damping and slack of each draft gear in SI units, (cars - 1, 4); None: a rigid train."""

    @classmethod
    def of(cls, train: Train) -> "MeasuredTrain":
        """The same of a train of the plant."""
        s, _ = structure_of(train)
        driven = s.axle_unit >= 0
        coupler = s.coupler if s.coupler.size else None
        return cls(
            train.name, s.car_mass, s.axle_car, s.static_load, s.radius, s.inertia, driven,
            s.car_resistance, coupler,
        )  # fmt: skip

    def with_radius(self, radius: Floats) -> "MeasuredTrain":
        """The same with other wheel radii [m], (axles,)."""
        return replace(self, radius=radius)
