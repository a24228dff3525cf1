"""The cell: what is around the arm, the arm's own body, and the proof that a motion touches neither."""
