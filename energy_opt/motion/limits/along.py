"""Limits along a path, all of a list at once: the share of each bound that a timing uses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.motion.limits.base import Limit
from energy_opt.motion.path_dynamics import PathDynamics


@dataclass(frozen=True)
class Use:
    """Used share of a limit's bound at places of a path, (M, m)."""

    limit: Limit
    share: np.ndarray

    @property
    def worst(self) -> tuple[float, int, int]:
        """The largest share, its place and its column."""
        k, j = np.unravel_index(int(np.argmax(self.share)), self.share.shape)
        return float(self.share[k, j]), int(k), int(j)


def used(limits: Sequence[Limit], d: PathDynamics, a: np.ndarray, b: np.ndarray, w: np.ndarray) -> list[Use]:
    """Use of every limit that depends on the timing, at path accelerations a, squared speeds b and w = da/ds (M,)."""
    out = []
    for limit in limits:
        share = limit.use(d, a, b)
        if share is not None:
            out.append(Use(limit, np.sqrt(share) if limit.squared else share))
            continue
        functions = limit.functions(d.path, d.s)
        if functions is not None:
            k, j = (x.ravel() for x in np.indices((len(d.s), limit.bound.size)))
            value = functions(k, j, 1.0).value(np.stack([a, np.maximum(b, 0.0), w])[:, k])
            out.append(Use(limit, np.abs(value).reshape(len(d.s), -1)))
    return out


class Tightening:
    """Factors (M, m) per limit, at a grid's points, by which broken bounds are reduced."""

    def __init__(self, factors: dict[str, np.ndarray] | None = None) -> None:
        self._factors = factors or {}

    def of(self, limit: Limit) -> np.ndarray | float:
        """The factors (M, m) of a limit's bounds; 1 if none was reduced."""
        return self._factors.get(limit.name, 1.0)

    def after(self, uses: Sequence[Use], s: np.ndarray, grid: np.ndarray) -> Tightening:
        """Reduced factors around the places where a limit was broken, by slightly more than its excess.

        Args:
            uses: shares of the bounds at places s (K,) of the path. grid: (M,) the points that have factors.
        """
        interval = np.clip(np.searchsorted(grid, s, side="right") - 1, 0, len(grid) - 2)
        changed = {}
        for use in uses:
            worst = np.zeros((len(grid) - 1, use.share.shape[1]))
            np.maximum.at(worst, interval, use.share - 1)
            padded = np.concatenate([worst[:1], worst[:1], worst, worst[-1:], worst[-1:]])
            around = np.maximum.reduce([padded[j : j + len(grid)] for j in range(4)])
            changed[use.limit.name] = self.of(use.limit) / (1 + 1.2 * around)
        return Tightening(changed)
