"""Readhesion controllers: what a traction unit does with its torque when its wheels slip.

A file per controller holds its law, parameters, memory, meaning and colour; `collection` lists those that are built in,
`registry` finds all by name.
"""
