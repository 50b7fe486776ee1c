"""The plant: the train's equations, stated once, their parameters and the integrator."""
