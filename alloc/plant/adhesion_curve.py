"""What all adhesion curves have in common."""

from dataclasses import astuple, dataclass, fields
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.display import displayed
from alloc.plant.adhesion_laws import adhesion_limit, tangential_coefficient


@displayed
@dataclass(frozen=True)
class AdhesionCurve:
    """Common part of the curves: `kind` names the law in compiled code, the fields are its parameters."""

    kind: ClassVar[int] = -1

    @property
    def q(self) -> NDArray[np.float64]:
        """Parameters as the equations take them, (6,): the fields in their order, then zeros."""
        return np.append(astuple(self), np.zeros(6))[:6]

    def with_parameters(self, q: NDArray[np.float64]) -> Self:
        """A curve of this class with the parameters `q` (6,)."""
        return type(self)(*(float(value) for value in q[: len(fields(self))]))

    def contact(self, load: ArrayLike, radius: ArrayLike) -> NDArray[np.float64]:
        """Creep stiffness over that in `q` under the wheel load `load` [N], half an axle's, of wheels of `radius` [m].

        1 where it depends on neither.
        """
        return np.ones(np.broadcast(load, radius).shape)

    def on(self, load: float, radius: float) -> Self:
        """This curve under the wheel load `load` [N], half an axle's, of wheels of `radius` [m]."""
        return self

    def steepest_slope(self, peak: float) -> float:
        """Upper bound of d mu / d slip velocity over all slip velocities and speeds [s/m], for the stable step.

        For the creep stiffness in `q`.
        """
        raise NotImplementedError

    def coefficient(
        self,
        slip: ArrayLike,
        peak: ArrayLike,
        speed: ArrayLike = 0.0,
        contact: ArrayLike = 1.0,
    ) -> NDArray[np.float64]:
        """Tangential force coefficient; `slip` and car `speed` in m/s; all arguments broadcast.

        `contact`: that of the axle, see there."""
        slip, peak, speed, contact = (
            np.asarray(a, dtype=float) for a in (slip, peak, speed, contact)
        )
        return tangential_coefficient(self.kind, self.q, slip, speed, speed + slip, peak, contact)

    def limit(
        self, peak: ArrayLike, speed: ArrayLike = 0.0, contact: ArrayLike = 1.0
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Adhesion coefficient and the slip velocity [m/s] of the curve's maximum, driving at `speed` >= 0 [m/s]."""
        peak, speed, contact = (np.asarray(a, dtype=float) for a in (peak, speed, contact))
        coefficient, slip = adhesion_limit(self.kind, self.q, peak, speed, contact)
        return np.asarray(coefficient), np.asarray(slip)
