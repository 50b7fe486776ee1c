"""Brake force of each car: the running tests of the RTRI report, and a passenger train with a faulty car."""
