"""The form of a reshaping problem: its unknowns, its nodes, and its nonzero entries.

A node or place depends on six control points, a window of 6 n neighbouring unknowns; so the Hessian over control points
is a band of width 6 n, kept as its lower diagonals (see `numerics.quadratic`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from energy_opt.numerics.bspline import DEGREE, Basis
from energy_opt.numerics.quadratic import add_places

LOCAL = DEGREE + 1  # control points that a node depends on


@dataclass(frozen=True)
class Shape:
    """The fixed form of a program.

    Attributes:
        joints: n.
        basis: the B-splines.
        per_span: Gauss nodes per knot span.
        free_acceleration: end accelerations are free; else zero.
        vias: number of via points.
    """

    joints: int
    basis: Basis
    per_span: int = 3
    free_acceleration: bool = False
    vias: int = 0

    @cached_property
    def pinned(self) -> int:
        """Control points at each end that the end conditions determine."""
        return 2 if self.free_acceleration else 3

    @cached_property
    def free(self) -> int:
        """Free control points."""
        return self.basis.controls - 2 * self.pinned

    @cached_property
    def size(self) -> int:
        """Unknowns that are coordinates of free control points, point by point."""
        return self.joints * self.free

    @cached_property
    def width(self) -> int:
        """Unknowns of a window."""
        return LOCAL * self.joints

    @cached_property
    def grid(self) -> tuple[np.ndarray, np.ndarray]:
        """Nodes u (K,) and weights (K,): Gauss nodes of every span, and its breakpoints with weight zero."""
        u, w = self.basis.gauss(self.per_span)
        u = np.concatenate([u, self.basis.breaks])
        w = np.concatenate([w, np.zeros(len(self.basis.breaks))])
        order = np.argsort(u, kind="stable")
        return u[order], w[order]

    @cached_property
    def matrices(self) -> list[np.ndarray]:
        """Basis matrices at the nodes for derivatives 0 to 3, (K, controls) each."""
        return [self.basis.matrix(self.grid[0], order) for order in range(4)]

    @cached_property
    def stacked(self) -> np.ndarray:
        """`matrices` of derivatives 0 to 2 as one, (3 K, controls), node by node."""
        return np.stack(self.matrices[:3], axis=1).reshape(-1, self.basis.controls)

    def first(self, u: np.ndarray) -> np.ndarray:
        """First of the six control points that each place u (M,) depends on, (M,)."""
        inside = np.searchsorted(self.basis.breaks, u, side="right") - 1
        return np.clip(inside, 0, len(self.basis.breaks) - 2)

    def window(self, u: np.ndarray) -> np.ndarray:
        """First control points of windows at u (M,), counted from the first free one; negative if pinned."""
        return self.first(u) - self.pinned

    def columns(self, first: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Unknowns (R, 6 n) of windows, 0 if a control point is pinned; and whether they are free."""
        index = first[:, None] * self.joints + np.arange(self.width)
        free = (index >= 0) & (index < self.size)
        return np.where(free, index, 0), free

    @cached_property
    def local(self) -> np.ndarray:
        """Basis values of a node's six control points for derivatives 0 to 3, (K, 4, 6)."""
        columns = self.first(self.grid[0])[:, None] + np.arange(LOCAL)
        return np.stack([np.take_along_axis(m, columns, axis=1) for m in self.matrices], axis=1)

    @cached_property
    def sites(self) -> list[np.ndarray]:
        """Matrices (sites, controls) to the control points of velocity, acceleration and jerk (times powers of T)."""
        return [self.basis.polygon(order) for order in (1, 2, 3)]

    @cached_property
    def site_local(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """For each of `sites`: its first control point (S,), and its six coefficients (S, 6)."""
        out = []
        for matrix in self.sites:
            first = np.minimum(np.argmax(np.abs(matrix) > 0, axis=1), self.basis.controls - LOCAL)
            out.append((first, np.take_along_axis(matrix, first[:, None] + np.arange(LOCAL), axis=1)))
        return out

    def linear(self, orders: Sequence[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Control points of derivatives of the given orders, site by site and joint by joint: window (L,), joint (L,)
        and coefficients (L, 6)."""
        n = self.joints
        first, local, joint = [np.zeros(0, dtype=np.int64)], [np.zeros((0, LOCAL))], [np.zeros(0, dtype=np.int64)]
        for k in orders:
            begin, values = self.site_local[k - 1]
            first.append(np.repeat(begin - self.pinned, n))
            local.append(np.repeat(values, n, axis=0))
            joint.append(np.tile(np.arange(n), len(begin)))
        return np.concatenate(first), np.concatenate(joint), np.concatenate(local)

    @cached_property
    def mass(self) -> np.ndarray:
        """The band (6 n wide, see `numerics.quadratic`) of the integral of |q|^2 over u, (size, 6 n)."""
        u, w = self.grid
        quad = np.flatnonzero(w)
        out = np.zeros((self.size, self.width))
        eye = np.eye(self.joints) * w[quad, None, None]
        add_places(out, eye, self.local[quad, 0], self.window(u[quad]), self.joints)
        return out

    @cached_property
    def _yielding(self) -> np.ndarray:
        """Control points' response to forces on them, (controls, controls), if the integral of |q''|^2 over u resists.

        Those that end conditions determine do not move.
        """
        inner, w = slice(self.pinned, self.basis.controls - self.pinned), self.grid[1]
        bent = self.matrices[2][:, inner]
        out = np.zeros((self.basis.controls, self.basis.controls))
        out[inner, inner] = np.linalg.inv((bent * w[:, None]).T @ bent)
        return out

    def passing(self, points: np.ndarray, u: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Control points (C, controls, n) of curves moved so that each passes given positions.

        Of all such changes this has the least integral of |q''|^2 over u.

        Args:
            points: (C, controls, n) [rad, m] of the curves. u: (C, V) times. q: (V, n) [rad, m] the positions.
        """
        basis = self.basis.matrix(u.ravel()).reshape(*u.shape, -1)
        pulled = basis @ self._yielding
        strength = np.linalg.pinv(pulled @ basis.transpose(0, 2, 1), hermitian=True)
        return points + pulled.transpose(0, 2, 1) @ (strength @ (q - basis @ points))

    @cached_property
    def end_slopes(self) -> np.ndarray:
        """Control-point offsets (2, pinned) per unit of u-velocity at the start and the end, acceleration zero."""
        zero, one = np.zeros(1), np.ones(1)
        acceleration = None if self.free_acceleration else zero
        return np.stack([self.basis.ends(zero, one, acceleration, last)[:, 0] for last in (False, True)])


@dataclass(frozen=True)
class Ends:
    """The fixed conditions of a move: q [rad, m] and v [rad/s, m/s] (n,) at both ends, and via points (vias, n)."""

    start: np.ndarray
    goal: np.ndarray
    v_start: np.ndarray
    v_goal: np.ndarray
    via: np.ndarray
