"""From a move to its result: candidates, choice, neighbours."""
