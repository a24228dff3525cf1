"""Proofs about a trajectory, from its samples alone: its energy and its limits."""
