"""Does the measured power follow the motion at all?

Work that an arm does passes through its meter, so the power of a moving arm must go with torque times speed, sooner or
later. Where power and motion belong to different recordings, or a column was mixed up, it does not, and whatever is
fitted then is an accident. Motion and power are shifted against each other within each run, by random times and round
its end: where the true alignment explains the power no better than such shifts do, it does not follow. Alike motions
leave the shifts little to get wrong, so chance must do really well before readings are doubted that are not mere noise.
"""

from __future__ import annotations

import numpy as np

from energy_opt.diagnose.predict import Prediction
from energy_opt.diagnose.samples import Samples

LAGS = (-0.2, 0.0, 0.2, 0.5)  # [s] by which a meter may lag
SHIFTS = 199
CHANCE = 0.2  # p-value beyond which chance does as well
DOUBT = 0.01  # and where neighbouring readings hardly resemble each other, as in noise
ALIKE = 0.5  # correlation of neighbouring samples of a power that an arm draws
FEW = 3.0  # readings per column, below which columns fit whatever stands there
SHOWN = 0.5  # of the meter's noise: mechanical power that varies less cannot be expected to show


def follows(samples: Samples, now: Prediction, seed: int = 0) -> bool:
    """False where the power goes with the motion no better than by chance.

    Args:
        now: the declared model at the samples. The power must go with its mechanical power, its torques, its reading or
            the speed, which friction follows.
    """
    mechanical = np.einsum("nj,nj->n", now.tau, samples.v)
    speed = np.abs(samples.v)
    heat, lost, dragged = np.sum(now.tau**2, axis=1), speed.sum(axis=1), np.sum(speed**2, axis=1)
    columns = _centred(samples.shown(np.column_stack([mechanical, heat, now.power, lost, dragged])), samples)
    if np.std(columns[:, 0]) < SHOWN * samples.noise:
        return True
    lags = [lag for lag in LAGS if lag == 0 or abs(lag) > samples.step / 2]
    lagged = np.column_stack([_shifted(columns, samples, lag) for lag in lags])
    if len(lagged) - len(samples.parts) < FEW * lagged.shape[1]:
        return True
    u, s, _ = np.linalg.svd(lagged / np.maximum(np.linalg.norm(lagged, axis=0), 1e-12), full_matrices=False)
    u = u[:, s > 1e-6 * s[0]]
    power = _centred(samples.power[:, None], samples)[:, 0]
    seen = float(np.sum((u.T @ power) ** 2))
    rng = np.random.default_rng(seed)
    by_chance = 0
    for _ in range(SHIFTS):
        turned = np.concatenate([np.roll(power[s], rng.integers(1, max(s.stop - s.start, 2))) for s in samples.parts])
        by_chance += float(np.sum((u.T @ turned) ** 2)) >= seen
    together = sum(float(power[s][1:] @ power[s][:-1]) for s in samples.parts)
    rough = together < ALIKE * float(power @ power)
    return (1 + by_chance) / (SHIFTS + 1) <= (DOUBT if rough else CHANCE)


def _centred(x: np.ndarray, samples: Samples) -> np.ndarray:
    """Columns (N, c) less their mean in each run."""
    return np.concatenate([x[s] - x[s].mean(axis=0) for s in samples.parts])


def _shifted(x: np.ndarray, samples: Samples, lag: float) -> np.ndarray:
    """Columns (N, c) as they were `lag` seconds before, the ends of each run held."""
    out = np.empty_like(x)
    for s in samples.parts:
        t = samples.at[s]
        for k in range(x.shape[1]):
            out[s, k] = np.interp(t - lag, t, x[s, k])
    return out
