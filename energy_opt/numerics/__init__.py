"""Numerics independent of robots: IPOPT, compilation, B-splines, functions over many points."""
