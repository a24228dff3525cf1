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
        keep = np.concatenate([np.concatenate([[0.0], np.exp(-np.diff(t) / noise.memory)]) for t in times])
        variance = (noise.white / np.maximum(weights, 1e-6)) ** 2
        gain, total, prior = [], [], 0.0
        for k, v in zip(keep.tolist(), variance.tolist(), strict=True):  # plain numbers: a run may have 1e4 readings
            prior = k * k * prior + (1 - k * k) * noise.wave**2
            total.append(prior + v)
            gain.append(prior / total[-1])
            prior *= 1 - gain[-1]
        self._scale = 1 / np.sqrt(total)
        self._feed = keep[1:] * gain[:-1]
        self._band = np.ones((2, len(keep)))  # of the recursion: its diagonal, and what a state keeps of the one before
        self._band[1, :-1] = self._feed - keep[1:]
        self.log_determinant = float(np.sum(np.log(total)))

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """White innovations (M, ...) of readings (M, ...)."""
        from scipy.linalg import solve_banded

        flat = x.reshape(len(x), -1)
        if self.noise.wave == 0:
            return np.asarray((flat * self._scale[:, None]).reshape(x.shape))
        state = np.zeros_like(flat, dtype=float, order="F")
        state[1:] = self._feed[:, None] * flat[:-1]
        state = solve_banded((1, 0), self._band, state, overwrite_b=True, check_finite=False)
        return np.asarray(((flat - state) * self._scale[:, None]).reshape(x.shape))
