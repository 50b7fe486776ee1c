"""Readhesion model predictive control of a traction unit, on the plant's own equations.

`factory` is what `alloc.simulation.simulate` takes as a host controller; `MpcController` takes other `MpcSettings`::

    simulate(event, "greedy", "mpc", {"mpc": factory})
    simulate(event, "greedy", "mpc", {"mpc": lambda context: MpcController(context, settings)})

`MpcError` is raised for settings that cannot be.
"""

from mpc.controller import MpcController, factory
from mpc.settings import CurveBelief, MpcError, MpcSettings, PeakBelief, Weights

__all__ = [
    "CurveBelief",
    "MpcController",
    "MpcError",
    "MpcSettings",
    "PeakBelief",
    "Weights",
    "factory",
]
