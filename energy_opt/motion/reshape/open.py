"""Ends and via points of a curve that may move on surfaces, such as the positions that give the tool one pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np


class Surface(Protocol):
    """Positions over which an end or a via point may move, in `count` directions: those that give the tool its pose."""

    count: int

    def along(self, q: np.ndarray) -> np.ndarray:
        """Orthonormal tangents (count, n) at q (n,), which follow q smoothly."""

    def bend(self, q: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Second derivatives (count, count, n) of the surface by steps along the tangents."""

    def reached(self, q: np.ndarray, step: np.ndarray) -> np.ndarray:
        """The position (n,) on the surface, within its ranges, that is nearest to q + step (n,)."""

    def work(self, q: np.ndarray) -> np.ndarray:
        """Work of ending at positions q (K, n) beside the objective's integral, (K,) in the objective's unit.

        Beginning there costs its negative.
        """

    def ranges(self, q: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Bounded quantities: values (R,), their slopes (R, count) along the tangents, lowest and highest values."""


@dataclass(frozen=True)
class Open:
    """The parts of a move that may move on surfaces: its ends, at rest there, and its via points; None if fixed."""

    start: Surface | None = None
    goal: Surface | None = None
    via: tuple[Surface | None, ...] = ()

    @property
    def ends(self) -> tuple[tuple[int, Surface], ...]:
        """The ends that may move, each with its surface: 0 (the start) or -1 (the goal)."""
        return tuple((end, surface) for end, surface in ((0, self.start), (-1, self.goal)) if surface is not None)

    @property
    def any(self) -> bool:
        """Whether any end or via point is free."""
        return bool(self.ends) or any(self.via)


FIXED = Open()


@dataclass(frozen=True)
class Passed:
    """Bounds of a via point on the curve's step there: slopes (R, n), lowest and highest values (R,).

    `bend`: second derivatives (M, n, n) of the first M, which hold the point; the others hold ranges.
    """

    slope: np.ndarray
    low: np.ndarray
    high: np.ndarray
    bend: np.ndarray


def passed(open_: Open, via: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, list[Passed]]:
    """The errors (vias, n) of a curve from its via points, and the bounds of these on its step there.

    Args:
        open_: the surfaces of via points that may move: such a point is the one of its surface nearest to q.
        via: (vias, n) the points. q: (vias, n) the curve at the times at which it is to pass them.
    """
    n, off, out = q.shape[1], q - via, []
    for k, surface in enumerate(open_.via or [None] * len(q)):
        if surface is None:
            out.append(Passed(np.eye(n), -off[k], -off[k], np.zeros((n, n, n))))
            continue
        target = surface.reached(via[k], off[k])
        off[k] = q[k] - target
        along = surface.along(target)
        across = np.linalg.svd(along)[2][len(along) :]
        value, slope, low, high = surface.ranges(q[k], along)
        bounded = np.isfinite(low) | np.isfinite(high)
        missed = -across @ off[k]
        low, high = (np.concatenate([missed, (end - value)[bounded]]) for end in (low, high))
        bend = -np.einsum("rm,abm,ai,bj->rij", across, surface.bend(target, along), along, along)
        out.append(Passed(np.vstack([across, slope[bounded] @ along]), low, high, bend))
    return off, out


def bending(f: Callable[[np.ndarray], np.ndarray], q: np.ndarray, along: np.ndarray, step: float = 1e-3) -> np.ndarray:
    """Second derivatives (k, k, ...) of a function along k directions, by central differences.

    With steps d and e along two of them: (f(q+d+e) - f(q+d-e) - f(q-d+e) + f(q-d-e)) / (4 step^2).

    Args:
        f: of positions (M, n), returns (M, ...). q: (n,). along: (k, n) directions of unit length.
        step: [rad, m] length of a step.
    """
    i, j = np.triu_indices(len(along))
    one, other = step * along[i], step * along[j]
    around = np.vstack([q + a * one + b * other for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))])
    value = f(around)
    value = value.reshape(4, len(i), *value.shape[1:])
    out = np.zeros((len(along), len(along), *value.shape[2:]))
    out[i, j] = out[j, i] = (value[0] - value[1] - value[2] + value[3]) / (4 * step**2)
    return out
