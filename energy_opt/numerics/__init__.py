"""Numerics independent of robots: IPOPT, quadratic programs, B-splines, functions over many points, compiled C."""
