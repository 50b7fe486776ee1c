"""Readhesion model predictive control of a traction unit, a car or a train, on the plant's own equations.

`mpc.hosted` offers the controllers by name: "mpc", every unit for itself; "mpc-car", the units of a car as one problem;
"mpc-train", the train over telegrams; "mpc-train-ideal", the train without delay. Classes take other settings::

    simulate(event, "greedy", "mpc")
    simulate(event, "alone", HostedController("mine", "", lambda contexts: TrainMpc(contexts, settings)))

`MpcError` is raised for settings that cannot be.
"""
