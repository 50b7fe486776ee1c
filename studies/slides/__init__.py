"""Slide protection: the demonstration of JP4209318, its calibration, and an electric brake in its place."""
