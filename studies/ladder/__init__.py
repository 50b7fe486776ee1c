"""The ladder of readhesion controllers; the same on other curves, on rails that rest, and beside the joint optimum.

Also rules over broad events.
"""
