"""The ladder of readhesion controllers; the same on other curves, on rails that rest, beside the joint optimum; broad events."""
