"""Events that are drawn."""
