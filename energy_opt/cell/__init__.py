"""The cell: the arm's surroundings, its own body, and the proof that a motion touches neither."""
