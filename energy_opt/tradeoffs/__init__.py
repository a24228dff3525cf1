"""Energy against duration for one move, and over a fixed cycle."""
