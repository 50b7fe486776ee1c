"""The predictive controller."""
