"""Minimum energy over the timing of a fixed path."""
