"""Logs of measured trains: files, checks, export, analysis."""
