"""The ladder of readhesion controllers, from none to MPC."""
