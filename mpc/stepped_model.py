"""The plant's right side on symbols in three steps: slips, coefficients, rates; so derivatives of a step are made once."""

from typing import Any, NamedTuple

import casadi as cs

from alloc.plant.adhesion_laws import tangential_coefficient
from alloc.plant.array_model import ArrayModel
from alloc.plant.equations import slip_velocity


class Steps(NamedTuple):
    """The right side in steps, for derivatives that are computed once and used several times."""

    slip: cs.SX
    """Slip velocities by the state."""
    slip_symbol: cs.SX
    coefficient: cs.SX
    """Tangential coefficients by `slip_symbol` and the state."""
    coefficient_symbol: cs.SX
    rate: cs.SX
    """Right side by `coefficient_symbol` and the state."""

    def whole(self, expressions: list[cs.SX]) -> list[cs.SX]:
        """The expressions by state and torque alone."""
        pairs = (self.coefficient_symbol, self.coefficient), (self.slip_symbol, self.slip)
        for symbol, expression in pairs:
            expressions = cs.substitute(expressions, [symbol], [expression])
        return list(cs.cse(expressions))

    def jacobian(self, point: cs.SX) -> cs.SX:
        """Derivatives of the right side by `point`: a contact is differentiated once, whatever moves its slip."""
        slip = cs.jacobian(self.slip, point)
        coefficient = cs.jacobian(self.coefficient, self.slip_symbol) @ slip
        coefficient += cs.jacobian(self.coefficient, point)
        rate = cs.jacobian(self.rate, self.coefficient_symbol) @ coefficient
        rate += cs.jacobian(self.rate, self.slip_symbol) @ slip + cs.jacobian(self.rate, point)
        return cs.sparsify(self.whole([rate])[0])


class SteppedModel(ArrayModel):
    """The plant with slips and coefficients as symbols. Nothing sticks, so deflections stay zero."""

    def _contacts(self, state: Any, peak: Any) -> tuple[Any, Any, Any]:
        n, s = self.layout, self.structure
        speed, omega = self.body_of_axle @ state[n.speed], state[n.omega]
        self.slip = slip_velocity(omega, s.radius, speed)
        self.slip_symbol = cs.SX.sym("slip", n.axles)
        self.coefficient = tangential_coefficient(
            self.curve_kind,
            self.curve,
            self.slip_symbol,
            speed,
            s.radius * omega,
            peak,
            self.contact,
        )
        self.coefficient_symbol = cs.SX.sym("coefficient", n.axles)
        return self.slip_symbol, self.coefficient_symbol, cs.SX.zeros(n.axles)

    def steps(self, rate: cs.SX) -> Steps:
        """The right side `rate`, which came from `derivative`, in steps."""
        first = self.slip, self.slip_symbol, self.coefficient, self.coefficient_symbol
        return Steps(*first, rate)
