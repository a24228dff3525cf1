"""Batches of moves: suites, parallel and resumable runs, their results, and the comparison of two runs."""
