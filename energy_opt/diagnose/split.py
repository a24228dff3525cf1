"""Which runs are fitted and which are kept for the final judgement: by run, whatever their order in the log."""

from __future__ import annotations

import numpy as np

from energy_opt.diagnose.samples import Samples

SHARE = 0.25  # of the runs of each kind that are held out


def split(samples: Samples, seed: int = 0) -> tuple[list[int], list[int]]:
    """Indices of training and holdout runs.

    Runs are ranked by where they lead, and drawn by rank: neither their order in the log nor their files' names matter,
    nor rounding by other units. A kind with fewer than three runs is not split.
    """
    rng = np.random.default_rng(seed)
    weights = np.random.default_rng(0).normal(size=(3, samples.n))
    keys = []
    for rows in samples.slices:
        picked = samples.q[[rows.start, (rows.start + rows.stop) // 2, rows.stop - 1]]
        keys.append(float(np.sum(weights * picked)))
    holdout: list[int] = []
    for kind in ("motion", "static"):
        runs = sorted((k for k, x in enumerate(samples.kinds) if x == kind), key=lambda k: keys[k])
        if len(runs) >= 3:
            drawn = rng.permutation(len(runs))[: max(1, round(SHARE * len(runs)))]
            holdout += [runs[int(k)] for k in drawn]
    train = [k for k in range(len(samples.kinds)) if k not in holdout]
    return train, sorted(holdout)
