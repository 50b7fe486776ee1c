"""Slip events as files: TOML keys with units, checked, turned into what the simulation runs."""
