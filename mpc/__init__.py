"""Readhesion model predictive control of a traction unit, a car or a train, on the plant's own equations.

`mpc.factories` has what `alloc.simulation.simulate` takes as host controllers, with default settings. The classes take
`mpc.settings.MpcSettings`::

    simulate(event, "greedy", "mpc", {"mpc": each_unit(factory)})
    simulate(event, "alone", "mpc-train", {"mpc-train": lambda contexts: TrainMpc(contexts, settings)})
"""
