"""What is judged afterwards: recorded runs, and measured series.

Runs: `recorded_run` gives the arrays of one, `metrics` the figures of merit, `least_damage` the least wheel damage for its
effort. Measurements: `measured_series` checks them, `brake_force` and `wheel_damage` estimate from couplers and from wheels.
"""
