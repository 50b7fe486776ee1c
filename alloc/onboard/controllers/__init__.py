"""Readhesion controllers."""
