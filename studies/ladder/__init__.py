"""The ladder of readhesion controllers; the same on other curves, on rails that rest, and beside the joint optimum; rules over
broad events."""
