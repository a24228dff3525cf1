"""Minimum energy over path and timing together."""
