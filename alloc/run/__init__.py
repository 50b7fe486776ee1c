"""A run: the event, the world that it fills, the loop over its instants, the record."""
