"""Running resistance: speed control and learning on routes, JP H07-322414."""
