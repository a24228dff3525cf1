"""From a model's power over time to what the meter reads: means over windows, differences of counters, totals.

A model is evaluated at `nodes(run)` and `observe` gives what the meter would have shown:

    at = nodes(run)                          # (K,) s on the run's clock, evenly spaced
    expected = observe(run, at, power)       # (M,) W beside run.power, (M, P) for slopes (K, P)

Between nodes power is taken to be linear, so a reading over [b - w, b] is, exactly,

    1/w * sum over intervals [t_k, t_k+1] of the integral of p_k (t_k+1 - t)/h + p_k+1 (t - t_k)/h over their overlap,

a row of a sparse matrix. What the meter does besides (delay, lag, gain) acts on the power at the nodes, before the
mean.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from energy_opt.measured.run import Run

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

STEP = 0.02  # [s] between nodes; drives' power has little above 10 Hz that a mean over a window would show
FEWEST = 4  # nodes that a window has at least


def nodes(run: Run) -> np.ndarray:
    """Times (K,) [s] at which to evaluate a model of the run's power: the stamps, or an even grid under the windows."""
    if not len(run.power) or not run.window.any():
        return run.power_time
    first = max(float(np.min(run.power_time - run.window)), float(run.time[0]))
    last = min(float(run.power_time[-1]), float(run.time[-1]))
    step = min(STEP, float(run.window[run.window > 0].min()) / FEWEST)
    return np.linspace(first, last, max(2, int(np.ceil((last - first) / step)) + 1))


def operator(run: Run, at: np.ndarray) -> csr_matrix:
    """The matrix (M, K) that takes power at times `at` (K,) [s, increasing] to the run's readings.

    Every row sums to 1. Windows that reach out of `at` count with the part that lies inside; stamps outside take the
    nearest value.
    """
    from scipy.sparse import csr_matrix

    at = np.asarray(at, dtype=float)
    last = np.clip(run.power_time, at[0], at[-1])
    first = np.clip(run.power_time - run.window, at[0], at[-1])
    count = len(at)
    if count == 1:
        return csr_matrix(np.ones((len(last), 1)))
    at_once = last - first <= 1e-9
    low = np.clip(np.searchsorted(at, first, side="right") - 1, 0, count - 2)
    high = np.clip(np.searchsorted(at, last, side="left") - 1, low, count - 2)
    low = np.where(at_once, high, low)
    per_reading = high - low + 1
    row = np.repeat(np.arange(len(last)), per_reading)
    offset = np.arange(len(row)) - np.repeat(np.cumsum(per_reading) - per_reading, per_reading)
    k = low[row] + offset
    left, right = at[k], at[k + 1]
    a, b = np.maximum(first[row], left), np.minimum(last[row], right)
    length = np.where(at_once[row], 1.0, last[row] - first[row])
    middle = np.where(at_once[row], last[row], (a + b) / 2)
    share = np.where(at_once[row], 1.0, (b - a) / length)
    to_right = share * (middle - left) / (right - left)
    data = np.concatenate([share - to_right, to_right])
    return csr_matrix((data, (np.concatenate([row, row]), np.concatenate([k, k + 1]))), shape=(len(last), count))


def observe(run: Run, at: np.ndarray, power: np.ndarray) -> np.ndarray:
    """What the meter would have read, (M, ...) [W], of a power (K, ...) [W] at times `at` (K,) [s on the run's clock].

    Linear in the power, so derivatives go through it column by column.
    """
    power = np.asarray(power, dtype=float)
    if not run.window.any() and len(at) == len(run.power_time) and np.array_equal(at, run.power_time):
        return power
    flat = operator(run, at) @ power.reshape(len(at), -1)
    return flat.reshape(len(run.power), *power.shape[1:])
