"""Numerics that know nothing of robots: IPOPT, compilation, B-splines, functions over many points."""
