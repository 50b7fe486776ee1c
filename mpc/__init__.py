"""Model predictive control on the plant's own equations; `mpc.unit` registers the controller "mpc" of one traction unit."""
