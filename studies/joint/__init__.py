"""Rules against the joint optimum of allocation and readhesion."""
