"""Readhesion model predictive control of a traction unit, a car or a train, on the plant's own equations.

`mpc.old.hosted` offers the controllers by name: "mpc", every unit for itself; "mpc-car", the units of a car as one problem;
"mpc-train", the train over telegrams; "mpc-train-ideal", the train without delay. Classes take other settings::

    simulate(event, "greedy", "mpc")
    simulate(event, "alone", HostedController("mine", "", lambda contexts: TrainMpc(contexts, settings)))

"mpc-opti" is "mpc" with every problem solved by CasADi, as `mpc.old.reference` states it: to read and to check with, slow.
`mpc.old.solve(problem, solver)` solves one `Problem` by the loop's solver or by one of CasADi's and returns a `Plan`.
`MpcError` is raised for settings that cannot be.
"""

from typing import TYPE_CHECKING

from alloc.old.registry import names_of

if TYPE_CHECKING:
    from mpc.old.period import HorizonProblem, Plan, Problem
    from mpc.old.reference import solve
    from mpc.old.settings import MpcError, MpcSettings
else:
    __getattr__ = names_of(
        __name__,
        period="HorizonProblem Plan Problem",
        reference="solve",
        settings="MpcError MpcSettings",
    )

__all__ = ["HorizonProblem", "MpcError", "MpcSettings", "Plan", "Problem", "solve"]
