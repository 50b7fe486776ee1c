"""What is said of a recorded run, or of measured series."""
