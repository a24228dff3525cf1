"""Evaluation of a given motion: energy under one or more models, limits, clearance, and simple timings of its path."""
