"""Speed control with compensation of running resistance by position, and with learning of it (JP H07-322414)."""
