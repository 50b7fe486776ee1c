"""What computers believe of brake shoes: force by cylinder pressure and rim speed."""

from alloc.compilation import inlined_jit
from alloc.plant.equations import hyperbolic_speed_law


@inlined_jit
def believed_shoe_force(group, g, pressure, rim_speed):
    """Force [N] of the shoes of an axle of brake group `g` at the rim, under `pressure` [Pa] of its cylinders.

    `group`: as in `Equipment`. Shoes rub on the tread, so `rim_speed` [m/s] is the wheel's own: a wheel that slides is
    gripped harder.
    """
    numerator, offset, constant = group.friction[g]
    friction = hyperbolic_speed_law(rim_speed, numerator, offset, constant)
    return group.gain[g] * pressure * friction
