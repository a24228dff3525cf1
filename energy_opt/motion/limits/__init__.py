"""Limits of motion: one file each, and the list of those in force (see `base` for how to add one)."""
