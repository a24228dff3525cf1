"""Bent lines in joint space: shortened by seeded shortcuts, and their corners rounded to a path that can be timed."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from energy_opt.motion.path import JointPath, straight

TRIES = 150  # attempts at a shortcut
NEAR = 0.45  # share of a corner's shorter edge: largest reach of its rounding
CLOSE = 0.2  # [rad] corners nearer than this slow a motion down, because they leave no room for rounding
SLOWEST = 0.05  # share of the path's mean |dq/ds|: below it a corner turns back on itself and cannot be rounded


def length(points: np.ndarray, velocity: np.ndarray) -> float:
    """Duration [s] of a bent line (K, n) at the joints' speed limits `velocity` (n,), by which paths are compared."""
    return float(np.max(np.abs(np.diff(points, axis=0)) / velocity, axis=1).sum())


def between(a: np.ndarray, b: np.ndarray, step: np.ndarray) -> Iterator[np.ndarray]:
    """Poses on the line from a to b, without these, at most `step` (n,) [rad] apart; the middle first.

    Coarse before fine, so that obstacles are found early.
    """
    count = int(np.ceil(np.max(np.abs(b - a) / step)))
    stride = 1
    while stride < count:
        stride *= 2
    while stride > 1:
        for k in range(stride // 2, count, stride):
            yield a + (b - a) * (k / count)
        stride //= 2


def shortened(
    points: np.ndarray, line: Callable[[np.ndarray, np.ndarray], bool], velocity: np.ndarray, seed: int
) -> np.ndarray:
    """The bent line (K, n) with detours cut off: by the straight line between two of its places, or in only one joint.

    Args:
        points: (K, n) [rad, m] corners and ends.
        line: whether the straight line between two poses is free.
        velocity: (n,) speed limits; a shortcut is kept if it reduces the line's duration.
        seed: of the attempts at a shortcut.
    """
    random = np.random.default_rng(seed)
    for k in range(TRIES):
        if len(points) <= 2:
            break
        joint = None if k % 2 == 0 else int(random.integers(points.shape[1]))
        cut = _cut(points, np.sort(random.uniform(size=2)), joint)
        if cut is None:
            continue
        shorter, changed = cut
        if length(shorter, velocity) < length(points, velocity) * (1 - 1e-3) and all(
            line(shorter[i], shorter[i + 1]) for i in changed
        ):
            points = shorter
    return points


def _cut(points: np.ndarray, places: np.ndarray, joint: int | None) -> tuple[np.ndarray, range] | None:
    """The line cut between two places (shares of its length): in one joint, which then moves evenly, or in all.

    Returns the new line and the numbers of its new edges; None if both places lie on one edge.
    """
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    at = np.concatenate([[0.0], np.cumsum(lengths)])
    first, last = np.clip(np.searchsorted(at, places * at[-1], side="right") - 1, 0, len(lengths) - 1)
    if first == last:
        return None
    share = (places * at[-1] - at[[first, last]]) / np.maximum(lengths[[first, last]], 1e-12)
    a, b = (points[i] + s * (points[i + 1] - points[i]) for i, s in zip((first, last), share, strict=True))
    middle = points[first + 1 : last + 1].copy() if joint is not None else points[:0]
    if joint is not None:
        along = (at[first + 1 : last + 1] - places[0] * at[-1]) / ((places[1] - places[0]) * at[-1])
        middle[:, joint] = a[joint] + along * (b[joint] - a[joint])
    new = np.vstack([points[: first + 1], a, middle, b, points[last + 1 :]])
    return new, range(first + 1, first + 2 + len(middle))


def without_needless(points: np.ndarray, line: Callable[[np.ndarray, np.ndarray], bool]) -> np.ndarray:
    """The bent line (K, n) without corners that can be left out.

    Args:
        points: (K, n) [rad, m]. line: True for two positions (n,) whose straight line is free.
    """
    k = 1
    while k < len(points) - 1:
        if line(points[k - 1], points[k + 1]):
            points = np.delete(points, k, axis=0)
            k = max(1, k - 1)
        else:
            k += 1
    return points


def merged(points: np.ndarray, line: Callable[[np.ndarray, np.ndarray], bool]) -> np.ndarray:
    """The bent line (K, n) with corners that are close together replaced by one in their middle, if that is free.

    Args:
        points: (K, n) [rad, m]. line: True for two positions (n,) whose straight line is free.
    """
    k = 1
    while k < len(points) - 2:
        middle = (points[k] + points[k + 1]) / 2
        if (
            np.linalg.norm(points[k + 1] - points[k]) < CLOSE
            and line(points[k - 1], middle)
            and line(middle, points[k + 2])
        ):
            points = np.vstack([points[:k], middle, points[k + 2 :]])
        else:
            k += 1
    return points


class Rounding:
    """A path along a bent line whose corners are rounded, each within a reach that can be reduced.

    The path is the cubic spline whose control points are the bent line at the Greville abscissae of its knots
    (Schoenberg's approximation): it follows the line exactly, at even speed, wherever four neighbouring control points
    lie on one edge; with knots at l - w, l - w/3, l + w/3, l + w around a corner at l it leaves the line only between
    l - w and l + w, and stays in the triangle there. It is C^2, as timing requires.
    """

    def __init__(self, points: np.ndarray) -> None:
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        self.points = points
        self.at = np.concatenate([[0.0], np.cumsum(lengths)])
        self.reach = NEAR * np.minimum(lengths[:-1], lengths[1:])

    def path(self) -> JointPath:
        """The rounded path, s in proportion to the length of the bent line."""
        if len(self.points) == 2:
            return straight(self.points[0], self.points[1])
        from scipy.interpolate import BSpline

        total = self.at[-1]
        corners = self.at[1:-1, None] + self.reach[:, None] * np.array([-1, -1 / 3, 1 / 3, 1])
        knots = np.concatenate([np.zeros(4), corners.ravel() / total, np.ones(4)])
        greville = (knots[1:-3] + knots[2:-2] + knots[3:-1]) / 3
        control = np.column_stack([np.interp(greville, self.at / total, q) for q in self.points.T])
        spline, breaks = BSpline(knots, control, 3), np.unique(knots)
        powers = [spline(breaks[:-1]), spline(breaks[:-1], 1), spline(breaks[:-1], 2) / 2, spline(breaks[:-1], 3) / 6]
        return JointPath(breaks, np.stack(powers))

    def tighter(self, s: float) -> bool:
        """Halve the reach of the corner that the path at s belongs to; False if it belongs to none."""
        near = np.abs(self.at[1:-1] - s * self.at[-1]) / np.maximum(self.reach, 1e-12)
        if not near.size or near.min() > 1.0 + 1e-9:
            return False
        self.reach[int(np.argmin(near))] /= 2
        return True

    @staticmethod
    def regular(path: JointPath) -> bool:
        """True if the path turns back on itself at no corner."""
        s = np.unique(np.concatenate([path.knots[:-1] + f * np.diff(path.knots) for f in (0, 0.25, 0.5, 0.75)]))
        speed = np.linalg.norm(path(s, 1), axis=1)
        return bool(speed.min() > SLOWEST * speed.mean())
