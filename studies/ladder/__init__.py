"""The ladder of readhesion controllers; other curves, rails that rest, the joint optimum, and broad events."""
