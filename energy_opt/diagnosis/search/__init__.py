"""The search over sets of effects: moves from set to set by evidence, and searches over numbers with kinks."""
