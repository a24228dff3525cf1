"""Energy of a step over its duration, as a convex curve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

SAME = 1e-6  # relative difference of durations that count as equal


@dataclass(frozen=True)
class Polynomial:
    """E(d) = sum_k c_k d^k, with exponents of either sign.

    Attributes:
        terms: pairs (k, c_k), k an integer, c_k in J/s^k.
    """

    terms: tuple[tuple[int, float], ...]

    def value(self, duration: float) -> float:
        """E(d) = sum of c_k d^k [J]."""
        return float(sum(c * duration**k for k, c in self.terms))

    def slope(self, duration: float) -> float:
        """E'(d) = sum of k c_k d^(k - 1) [W]."""
        return float(sum(c * k * duration ** (k - 1) for k, c in self.terms if k))

    def breaks(self, least: float, most: float) -> np.ndarray:
        """Durations [s] of the first tangents, denser where the curve bends more."""
        return np.geomspace(least, most, 16) if least > 0 else np.linspace(least, most, 16)

    def is_convex(self, least: float, most: float) -> bool:
        """Is E'' >= 0 on [least, most]? Checked at 200 places, to a relative error of 1e-9."""
        d = np.linspace(least, most, 200)
        parts = np.array([c * k * (k - 1) * d ** float(k - 2) for k, c in self.terms if k not in (0, 1)])
        return not parts.size or bool(np.all(parts.sum(0) >= -1e-9 * np.abs(parts).sum(0)))


@dataclass(frozen=True)
class Hull:
    """The lower convex hull of points (duration, energy), linear between them: energies of solved trajectories.

    Attributes:
        durations: (K,) [s], ascending; energies: (K,) [J].
    """

    durations: np.ndarray
    energies: np.ndarray

    @classmethod
    def of(cls, points: Sequence[tuple[float, float]]) -> Hull:
        """The hull of points in any order (Andrew's monotone chain); of equal durations the cheaper one counts."""
        least: list[tuple[float, float]] = []
        for d, e in sorted(points):
            if least and d <= least[-1][0] * (1 + SAME):  # the line through both would be extremely steep
                least[-1] = least[-1][0], min(least[-1][1], e)
            else:
                least.append((d, e))
        chain: list[tuple[float, float]] = []
        for d, e in least:
            while len(chain) > 1:
                (d0, e0), (d1, e1) = chain[-2:]
                if (e1 - e0) * (d - d0) < (e - e0) * (d1 - d0):
                    break
                chain.pop()
            chain.append((d, e))
        d, e = np.array(chain).T
        return cls(d, e)

    def value(self, duration: float) -> float:
        """Energy [J], linear between the known durations."""
        return float(np.interp(duration, self.durations, self.energies))

    def slope(self, duration: float) -> float:
        """Slope [W] of the piece that contains the duration."""
        if len(self.durations) < 2:
            return 0.0
        k = int(np.clip(np.searchsorted(self.durations, duration) - 1, 0, len(self.durations) - 2))
        return float(np.diff(self.energies)[k] / np.diff(self.durations)[k])

    def breaks(self, least: float, most: float) -> np.ndarray:
        """The middle [s] of each piece: its tangent there is the piece itself."""
        return (self.durations[1:] + self.durations[:-1]) / 2 if len(self.durations) > 1 else self.durations


Curve = Polynomial | Hull  # a convex function E(d): energy [J] of a step that takes d [s]
