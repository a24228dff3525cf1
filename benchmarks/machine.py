"""Limits in seconds on a machine of any speed: a fixed piece of work says how slow this one is now."""

from __future__ import annotations

import time

import numpy as np

REFERENCE = 0.08  # [s] of processor time of `_work` on the machine where the limits were written


def _work() -> float:
    begin, values, total = time.process_time(), np.linspace(0.1, 1.0, 12), 0.0
    for k in range(8000):
        values = np.sin(values + k) @ np.eye(12)
        total += sum(x * x for x in values.tolist())
    return time.process_time() - begin


def allowed(seconds: float) -> float:
    """`seconds` of the reference machine on this one, with as much again for what runs beside a test."""
    return 2.0 * seconds * max(1.0, _work() / REFERENCE)
