"""Runs of a train over a line: limits and stops, driving style, simulation, and other ways to calculate them."""
