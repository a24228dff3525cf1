"""Whole jobs: a cycle of moves and waits, whose time is shared for least energy."""
