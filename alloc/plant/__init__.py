"""What is true: curves, rail, train, and their motion. Nothing on board reads it."""
