"""What runs on board: sensing, slip detection, estimates, readhesion control, telegrams.

It never reads the plant's state."""
