"""Which runs are fitted and which are kept for the final judgement: by run, whatever their order in the log."""

from __future__ import annotations

import zlib

import numpy as np

from energy_opt.diagnose.samples import Samples

SHARE = 0.25  # of the runs of each kind that are held out


def split(samples: Samples, seed: int = 0) -> tuple[list[int], list[int]]:
    """Indices of training and holdout runs.

    Runs are drawn by what they contain, so neither their order nor their files' names matter. A kind with fewer than
    three runs is not split.
    """
    keys = [_content(samples, rows, seed) for rows in samples.slices]
    holdout: list[int] = []
    for kind in ("motion", "static"):
        runs = sorted((k for k, x in enumerate(samples.kinds) if x == kind), key=lambda k: keys[k])
        if len(runs) >= 3:
            holdout += runs[: max(1, round(SHARE * len(runs)))]
    train = [k for k in range(len(samples.kinds)) if k not in holdout]
    return train, sorted(holdout)


def _content(samples: Samples, rows: slice, seed: int) -> int:
    """A number drawn from a run's path: where it begins, its middle and its end, to a hundredth of a radian."""
    picked = samples.q[[rows.start, (rows.start + rows.stop) // 2, rows.stop - 1]]
    return zlib.crc32(np.round(picked, 2).astype(np.float32).tobytes() + str(seed).encode())
