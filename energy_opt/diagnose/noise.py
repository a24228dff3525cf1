"""Noise with memory: white noise of the meter and a first-order wave, and the filter that makes residuals white.

    y_k = w_k + x_k,   w_k ~ N(0, white^2 / weight_k^2),   x_{k+1} = e^{-h/memory} x_k + ...,   x ~ N(0, wave^2)

Runs are independent of each other. Whitening is the Kalman filter of this law: innovations over their standard
deviation, the same linear map for residuals and for the columns of their derivatives, so that ordinary least squares
on what comes out is the likelihood of the law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Noise:
    """Standard deviations white and wave [W], and the wave's memory [s]."""

    white: float
    wave: float = 0.0
    memory: float = 1.0


class Whitener:
    """The map that makes the noise of R runs white with variance 1.

    Args:
        times: (M_r,) s of every run's readings. weights: (M,) trust in each reading, run after run, 1 is whole.
    """

    def __init__(self, noise: Noise, times: Sequence[np.ndarray], weights: np.ndarray) -> None:
        self.noise = noise
        count, longest = len(times), max(len(t) for t in times)
        self._index = np.full((longest, count), -1)
        at = 0
        keep = np.zeros((longest, count))
        variance = np.full((longest, count), np.inf)
        for r, t in enumerate(times):
            k = len(t)
            self._index[:k, r] = np.arange(at, at + k)
            keep[1:k, r] = np.exp(-np.diff(t) / noise.memory)
            variance[:k, r] = (noise.white / np.maximum(weights[at : at + k], 1e-6)) ** 2
            at += k
        self._there = self._index >= 0
        self._keep = keep
        prior = np.full(count, noise.wave**2)
        self._gain, self._scale = np.zeros((longest, count)), np.zeros((longest, count))
        logs = 0.0
        for k in range(longest):
            if k:
                prior = keep[k] ** 2 * prior + (1 - keep[k] ** 2) * noise.wave**2
            total = prior + variance[k]
            self._gain[k] = np.where(self._there[k], prior / total, 0.0)
            self._scale[k] = np.where(self._there[k], 1 / np.sqrt(total), 0.0)
            logs += float(np.sum(np.log(total[self._there[k]])))
            prior = prior * (1 - self._gain[k])
        self.log_determinant = logs

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """White innovations (M, ...) of readings (M, ...)."""
        flat = x.reshape(len(x), -1)
        if self.noise.wave == 0:
            scale = np.zeros(len(x))
            scale[self._index[self._there]] = self._scale[self._there]
            return np.asarray((flat * scale[:, None]).reshape(x.shape))
        out = np.empty_like(flat, dtype=float)
        state = np.zeros((self._index.shape[1], flat.shape[1]))
        for k, rows in enumerate(self._index):
            live = self._there[k]
            if k:
                state *= self._keep[k][:, None]
            if live.all():
                surprise = flat[rows] - state
                out[rows] = surprise * self._scale[k][:, None]
                state += self._gain[k][:, None] * surprise
            else:
                surprise = flat[rows[live]] - state[live]
                out[rows[live]] = surprise * self._scale[k][live, None]
                state[live] += self._gain[k][live, None] * surprise
        return out.reshape(x.shape)
