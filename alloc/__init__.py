"""Plant, computers on board, allocation rules, runs and what is said of them. Read it in this order:

    schema       what a table, a column, a parameter, a registry is
    plant        what is true: rail, wheelsets, cars, drives, cylinders, and their motion
    onboard      what is known: readings, beliefs, limits, the torque of each unit, the brakes
    rules        how the units share the effort
    run          an event; the loop; the wire between plant and board; the recorded run
    evaluation   figures of merit of a recorded run

`plant` and `onboard` do not import each other: what is true and what is known meet in `run` alone.
"""
