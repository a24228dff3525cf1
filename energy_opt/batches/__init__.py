"""Batches of moves: suites, parallel and resumable runs, their results, and the comparison of two runs."""

from energy_opt.batches.batch import Batch, run_batch
from energy_opt.batches.compare import compare, comparison_text
from energy_opt.batches.suite import Suite, check_suite, load_suite

__all__ = ["Batch", "Suite", "check_suite", "compare", "comparison_text", "load_suite", "run_batch"]
