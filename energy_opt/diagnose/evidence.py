"""Evidence that does not trust samples to be independent: blocks, runs left out, and what is left of the residual."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.diagnose.fit import Fit
from energy_opt.diagnose.samples import Samples

BLOCK = 0.25  # [s] residuals this far apart count as independent
DRAWS = 999
LEFT_P = 1e-4  # p-value below which what is left is structure
LEFT_RATIO = 1.35  # and its block variance over that of noise
LEFT_SHARE = 0.01  # of the declared model's own excess that may stay without counting


def blocks(samples: Samples, seconds: float = BLOCK) -> list[slice]:
    """Consecutive samples of one run, about `seconds` long."""
    out = []
    for rows in samples.slices:
        count = rows.stop - rows.start
        span = float(samples.t[rows.stop - 1] - samples.t[rows.start])
        pieces = max(1, round(span / seconds))
        edges = np.linspace(rows.start, rows.stop, min(pieces, count) + 1).astype(int)
        out += [slice(int(a), int(b)) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    return out


def block_ratio(residual: np.ndarray, samples: Samples, numbers: int = 0) -> tuple[float, float]:
    """Variance of block means over what white noise gives them, and the p-value (chi-squared) of its excess."""
    from scipy.stats import chi2

    parts = blocks(samples)
    total = sum((b.stop - b.start) * float(residual[b].mean()) ** 2 for b in parts) / samples.noise**2
    free = max(len(parts) - numbers, 1)
    return total / free, float(chi2.sf(total, free))


@dataclass(frozen=True)
class Leftover:
    """What a hypothesis leaves: block variance over noise, its p-value, and True where that is structure."""

    ratio: float
    p_value: float
    structured: bool


def leftover(f: Fit, root: Fit, samples: Samples) -> Leftover:
    """Is the residual of a hypothesis noise, or small beside that of the declared model (`root`)?"""
    ratio, p = block_ratio(f.residual, samples, f.count)
    before, _ = block_ratio(root.residual, samples)
    floor = LEFT_RATIO if f is root else max(LEFT_RATIO, 1 + LEFT_SHARE * (before - 1))
    return Leftover(ratio, p, p < LEFT_P and ratio > floor)


def inflation(f: Fit, samples: Samples) -> float:
    """Long-run variance of the residual over its variance, at least 1."""
    ratio, _ = block_ratio(f.residual, samples, f.count)
    variance = float(np.mean(f.residual**2)) / samples.noise**2
    return max(1.0, ratio / max(variance, 1e-12) if ratio > 1.15 else 1.0)


def left_out_loss(f: Fit, samples: Samples) -> np.ndarray:
    """Loss of every run (R,) under the hypothesis fitted to the other runs (one linearised step from the whole fit)."""
    jacobian, residual = f.jacobian, f.residual
    if not jacobian.shape[1]:
        return np.array([float(residual[s] @ residual[s]) for s in samples.slices]) / samples.noise**2
    size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-12)
    jacobian = jacobian / size
    gram, cross = jacobian.T @ jacobian, jacobian.T @ residual
    ridge = 1e-8 * np.eye(len(gram))
    out = []
    for s in samples.slices:
        part, r = jacobian[s], residual[s]
        step = np.linalg.solve(gram - part.T @ part + ridge, cross - part.T @ r)
        out.append(float(np.sum((r - part @ step) ** 2)))
    return np.array(out) / samples.noise**2


def bootstrap_interval(values: Sequence[float], seed: int = 0) -> list[float]:
    """95 % interval of the mean of per-run values, by resampling runs."""
    x = np.asarray(values, dtype=float)
    if len(x) == 0:
        return []
    rng = np.random.default_rng(seed)
    means = x[rng.integers(0, len(x), (DRAWS, len(x)))].mean(axis=1)
    return [float(v) for v in np.quantile(means, [0.025, 0.975])]
