"""Readhesion controllers: what a traction unit does with its torque when its wheels slip. One file a family.

    controller   what a controller is, and all by name
    plain        without a search: none, the readhesion paper's table, cut and ramp
    creep        creep control, which holds a slip
    search       creep control whose reference climbs to the peak

The MPC, `mpc.unit`, is registered beside them.
"""

from alloc.onboard.controllers.controller import CONTROLLERS, Controller, register

__all__ = ["CONTROLLERS", "Controller", "register"]
