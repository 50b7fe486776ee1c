"""The MPC on rails of other curves than it was built on, with noise and computing time."""
