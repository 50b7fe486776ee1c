"""Drawn stops with motors and air brakes together: rules, controllers, and what the error of the reference speed costs."""
