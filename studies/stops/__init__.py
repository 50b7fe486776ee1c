"""Stops: motors and air brakes together, slide protection on very low adhesion, and sanders."""
