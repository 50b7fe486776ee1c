"""Scenarios, the grid that compares rules and controllers over them, its table, and the command line."""
