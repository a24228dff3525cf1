"""Runs left out: what a hypothesis fitted to the other runs says of them. Repeats of a motion are left out together."""

from __future__ import annotations

import numpy as np

from energy_opt.diagnose.fit import Fit
from energy_opt.diagnose.samples import Samples

POINTS = 24  # of a run's way, by which motions are compared
SAME = 0.05  # [rad] motions whose ways are this near at all points are repeats
PACE = 0.05  # and their durations within this share


def clusters(samples: Samples) -> list[list[int]]:
    """Runs in groups: repeats of one motion together."""
    keys = []
    for rows in samples.slices:
        at = np.linspace(rows.start, rows.stop - 1, POINTS).round().astype(int)
        keys.append((samples.q[at], float(samples.t[rows.stop - 1] - samples.t[rows.start])))
    out: list[list[int]] = []
    for k, (way, duration) in enumerate(keys):
        for group in out:
            other, lasts = keys[group[0]]
            if abs(duration - lasts) <= PACE * max(duration, lasts) and np.abs(way - other).max() < SAME:
                group.append(k)
                break
        else:
            out.append([k])
    return out


def left_out(f: Fit) -> np.ndarray:
    """Sum of squared white residuals of every cluster of runs (C,), by the hypothesis fitted without it.

    The fit is repeated from what is known before the data, around the same linearisation; the cluster's own levels are
    not known to it.
    """
    s = f.world.samples
    white = f.world.whiten(f.residual)
    jacobian, off = f.jacobian, f.theta - f.mean
    whole = jacobian.T @ jacobian + f.precision
    right = jacobian.T @ (white + jacobian @ off)
    out = []
    for group in clusters(s):
        rows = np.concatenate([np.arange(s.parts[r].start, s.parts[r].stop) for r in group])
        own = jacobian[rows]
        found = np.linalg.solve(whole - own.T @ own, right - own.T @ (white[rows] + own @ off))
        out.append(float(np.sum((white[rows] - own @ (found - off)) ** 2)))
    return np.array(out)
