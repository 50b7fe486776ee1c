"""Whether the MPC comes to rest on rails that do not change."""
