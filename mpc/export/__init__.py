"""The compiled controller of a unit as C: translated from the Python source of its functions, which stays the only one."""
