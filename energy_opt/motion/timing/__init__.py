"""Timing of a path: the timing law, and TOPP-RA's fastest timing."""
