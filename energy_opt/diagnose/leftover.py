"""What a hypothesis leaves: is it the noise of standstill, and the drift of a meter, or is there structure in it?"""

from __future__ import annotations

import numpy as np

from energy_opt.diagnose.fit import Fit
from energy_opt.diagnose.noise import Noise
from energy_opt.diagnose.weigh import STEADY

LEVELS = 0.03  # of the arm's level, by which runs may differ among each other as meters drift
LEFT = 1.5  # of the noise's slow part, by which what is left must exceed it to be called structure
BLOCK = 0.4  # [s] over which what is left is averaged to be compared with noise at standstill


def wandering(f: Fit) -> bool:
    """Do the runs' levels differ by more than a meter drifts?"""
    own = np.sqrt(np.maximum(np.diag(f.covariance)[len(f.theta) - len(f.levels) :], 0.0))
    apart = float(np.ptp(f.levels))
    return apart > LEVELS * (f.world.scale.level + STEADY) and apart > 6 * float(np.median(own))


def leftover(f: Fit, still: Noise) -> tuple[float, bool]:
    """Slow part of what a hypothesis leaves in motion over that of the noise at standstill, and is it structure?"""
    from scipy.stats import chi2

    s = f.world.samples
    count = max(1, round(BLOCK / s.step))
    means = []
    for part in s.parts:
        rows = np.arange(part.start, part.stop)
        for k in range(0, len(rows) - count + 1, count):
            own = rows[k : k + count]
            if s.moving[own].mean() > 0.5:
                trust = s.weight[own]
                means.append(float(np.average(f.residual[own], weights=trust)))
    if len(means) < 5:
        return 1.0, False
    memory = np.exp(-np.abs(np.subtract.outer(np.arange(count), np.arange(count))) * s.step / still.memory)
    expected = still.white**2 / count + still.wave**2 * float(memory.mean())
    ratio = float(np.mean(np.square(means))) / expected
    p = float(chi2.sf(ratio * len(means), len(means)))
    return ratio**0.5, bool(ratio > LEFT**2 and p < 1e-4)
