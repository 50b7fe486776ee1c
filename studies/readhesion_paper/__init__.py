"""The readhesion paper: its cases, findings and grid, the calibration of what it does not print, the limit cycle."""
