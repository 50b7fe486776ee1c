"""Learning the increments of adhesion along the train (JP5484215, embodiment 2)."""
