"""The quadratic model of a reshaping problem at a curve: banded Hessian and linearised rows.

Rows of velocity, acceleration and jerk are |A x| <= b T^k: linear at a fixed T, and else linearised in T on the side of
the bound, where they stay inside of the limit.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.sparse import csr_matrix

from energy_opt.motion.reshape.evaluation import Evaluation, Point
from energy_opt.motion.reshape.layout import LOCAL
from energy_opt.motion.reshape.rows import Part, PlacePart, Rows
from energy_opt.numerics.batch import Batch
from energy_opt.numerics.quadratic import Banded

SPARE = 0.02  # beyond what a step can reach by its first derivative
HOT = 0.8  # share of a bound from which what is limited at a node gets a row


class Model(Evaluation):
    """One problem of a shape, with what a quadratic program takes of it."""

    @cached_property
    def _break_curvature(self) -> Batch:
        return Batch(self._nodes.curvature, len(self._breaks))

    @cached_property
    def mass(self) -> Banded:
        """What the Hessian is damped with: squares of positions, T relative to its size, via times."""
        corner = np.eye(self.border)
        return Banded(self.frame.mass, np.zeros((self.frame.size, self.border)), corner)

    def hessian(self, point: Point, multipliers: dict[str, np.ndarray]) -> Banded:
        """Of the Lagrangian; `multipliers` by what they belong to, in the order of a point's values."""
        s, f, n = self.shape, self.frame, self.shape.joints
        hot = multipliers.get("hot")
        lam = np.zeros(point.hot.shape) if hot is None else hot / self._hot_scale
        sets = [(self._quad, self._curvature, self.scale * self._weight[:, None])]
        if hot is not None and lam[self._breaks[:-1]].any():
            sets.append((self._breaks, self._break_curvature, np.zeros((len(self._breaks), 1))))
        band = np.zeros((f.size, f.width))
        out = Banded(band, np.zeros((f.size, self.border)), np.zeros((self.border, self.border)))
        for which, curvature, weight in sets:
            (blocks,) = curvature(point.z[which], self._u[which], self._values, weight, lam[which])
            c = blocks.reshape(len(which), 3 * n + 1, 3 * n + 1)
            used = which if which is self._quad else which[:-1]
            out.band += f.band_of(c[: len(used)], s.local[used, :3])
            if not self.fixed:
                by_time = np.matmul(c, self._z_slope[which][:, :, None])[:, :, 0]
                local = np.einsum("kdi,kda->kai", by_time[:, :-1].reshape(-1, 3, n), s.local[which, :3])
                index, free = f.columns(s.first(self._u[which, 0]))
                flat = local.reshape(len(which), -1)
                out.border[:, 0] += np.bincount(index[free], flat[free], f.size)
                out.corner[0, 0] += float(np.sum(by_time * self._z_slope[which]))
        linear = multipliers.get("linear")
        if linear is not None and not self.fixed:
            k = self._order
            out.corner[0, 0] -= float(np.sum(np.abs(linear) * k * (k - 1))) / point.duration**2
        for number, rows, q, _ in point.placed:
            lam_place = multipliers.get(f"place {number}")  # how ends that move stretch with T is left out
            if lam_place is not None and lam_place.any():
                m = rows.hessian(q, lam_place)
                out.band += (self._placing(rows.u)[0] @ m.ravel()).reshape(
                    band.shape
                )  # by T, where ends move: left out
        if s.vias and "via" in multipliers:
            self._add_via_curvature(out, point, multipliers["via"])
        return out

    def _add_via_curvature(self, out: Banded, point: Point, lam: np.ndarray) -> None:
        s, n = self.shape, self.shape.joints
        inner = slice(s.pinned, s.basis.controls - s.pinned)
        slope = s.basis.matrix(point.via_u, 1)
        bend = s.basis.matrix(point.via_u, 2) @ point.points
        lam = lam.reshape(s.vias, n)
        for i in range(s.vias):
            column = self.border - s.vias + i
            out.border[:, column] += np.outer(slope[i, inner], lam[i]).ravel()
            out.corner[column, column] += float(bend[i] @ lam[i])
            if not self.fixed:
                cross = float(slope[i] @ self._pinned_slope @ lam[i])
                out.corner[0, column] += cross
                out.corner[column, 0] += cross

    def _placing(self, u: np.ndarray) -> tuple[csr_matrix, np.ndarray]:
        """What places u touch: matrix to the band, and the basis values of free control points."""
        known = getattr(self, "_known_places", None)
        key = u.tobytes()
        if known is None or known[0] != key:
            s = self.shape
            first, basis = s.first(u), self._matrix(u)
            local = np.take_along_axis(basis, first[:, None] + np.arange(LOCAL), axis=1)
            free = basis[:, s.pinned : s.basis.controls - s.pinned].copy()
            known = (key, (self.frame.of_places(first, local), free))
            self._known_places = known
        return known[1]

    def linear_rows(self, point: Point, held: np.ndarray) -> Rows:
        """Rows on derivatives that are `held`."""
        which = np.flatnonzero(held)
        time = 1 / point.duration ** self._order[which]
        factor = time * self._per[which]
        a = self._linear_free[which]
        a = csr_matrix((a.data * np.repeat(factor, np.diff(a.indptr)), a.indices, a.indptr), shape=a.shape)
        border = np.zeros((len(which), self.border))
        share = point.linear[which]
        if not self.fixed:
            border[:, 0] = self._linear_slope[which] * time - self._order[which] * np.sign(share) / point.duration
        part = Part(a, self._linear_square, which, factor**2)
        return Rows([(len(which), part)], border, -1 - share, 1 - share, which.astype(np.int64) * 4)

    def other_rows(self, point: Point, far: float) -> Rows:
        """Rows at nodes that are near their bounds, of via points, and numeric ones that steps of `far` can reach."""
        s, n, f = self.shape, self.shape.joints, self.frame
        k, j = np.nonzero((self.hot_share(point) > HOT) | (self._hot_always & np.isfinite(self._hot_scale)))
        slope = point.hot_slope[k, :, j] / self._hot_scale[j][:, None]
        parts = slope[:, :-1].reshape(-1, 3, n)
        wide: list[np.ndarray] = [np.einsum("rdi,rda->rai", parts, s.local[k, :3]).reshape(len(k), f.width)]
        first = [s.first(self._u[k, 0])]
        border = [np.zeros((len(k), self.border))]
        if not self.fixed:
            border[0][:, 0] = slope[:, -1] + np.sum(slope[:, :-1] * self._z_slope[k, :-1], axis=1)
        floor = [np.where(self._hot_one[j], -np.inf, -1 - point.hot[k, j])]
        ceiling = [1 - point.hot[k, j]]
        keys = [(k * len(self._hot_scale) + j).astype(np.int64) * 4 + 1]
        if s.vias:
            basis, speed = s.basis.matrix(point.via_u), s.basis.matrix(point.via_u, 1) @ point.points
            begin = s.first(point.via_u)
            local = np.take_along_axis(basis, begin[:, None] + np.arange(LOCAL), axis=1)
            wide.append((local[:, None, :, None] * np.eye(n)[None, :, None, :]).reshape(s.vias * n, f.width))
            first.append(np.repeat(begin, n))
            edge = np.zeros((s.vias, n, self.border))
            for i in range(s.vias):
                edge[i, :, self.border - s.vias + i] = speed[i]
            if not self.fixed:
                edge[:, :, 0] = basis @ self._pinned_slope
            border.append(np.asarray(edge.reshape(-1, self.border)))
            floor.append(-point.via.ravel())
            ceiling.append(-point.via.ravel())
            keys.append(np.arange(s.vias * n, dtype=np.int64) * 4 + 2)
        begin, rows = np.concatenate(first), np.concatenate(wide)
        nothing = np.ones(0)
        at_nodes = Part(self._sparse(begin, rows), f.squares(begin, rows), None, nothing)
        made: list[tuple[int, Part | PlacePart]] = [(len(begin), at_nodes)] if len(begin) else []
        for number, placed, q, value in point.placed:
            to_band, basis = self._placing(placed.u)
            gradient, off = placed.gradient(q), np.minimum(value - placed.lower, placed.upper - value)
            order = np.argsort(placed.place, kind="stable")
            order = order[(off < np.abs(gradient).sum(axis=1) * far + SPARE)[order]]
            place, gradient = placed.place[order], gradient[order]
            made.append((len(place), PlacePart(basis, to_band, place, gradient)))
            of_places = np.zeros((len(place), self.border))
            if not self.fixed and not self._still:
                of_places[:, 0] = np.sum(gradient * (self._matrix(placed.u) @ self._pinned_slope)[place], axis=1)
            border.append(of_places)
            floor.append((placed.lower - value)[order])
            ceiling.append((placed.upper - value)[order])
            keys.append((placed.keys[order].astype(np.int64) * 64 + number) * 4 + 3)
        return Rows(
            made, np.concatenate(border), np.concatenate(floor), np.concatenate(ceiling), np.concatenate(keys)
        )  # fmt: skip

    def _sparse(self, first: np.ndarray, rows: np.ndarray) -> csr_matrix:
        index, free = self.frame.columns(first)
        data = np.where(free, rows, 0.0)
        pointer = np.arange(len(first) + 1) * self.frame.width
        return csr_matrix((data.ravel(), index.ravel(), pointer), shape=(len(first), self.frame.size))

    def multipliers(self, point: Point, keys: np.ndarray, values: np.ndarray) -> dict[str, np.ndarray]:
        """Multipliers of named rows in the form that `hessian` takes."""
        order = np.argsort(keys, kind="stable")
        keys, values = keys[order], values[order]
        name, kind = np.divmod(keys, 4)
        out: dict[str, np.ndarray] = {}
        if not self.fixed:
            out["linear"] = np.zeros(len(point.linear))
            np.add.at(out["linear"], name[kind == 0], values[kind == 0])
        if (kind == 1).any():
            flat = np.zeros(point.hot.size)
            np.add.at(flat, name[kind == 1], values[kind == 1])
            out["hot"] = flat.reshape(point.hot.shape)
        if (kind == 2).any():
            out["via"] = np.zeros(point.via.size)
            out["via"][name[kind == 2]] = values[kind == 2]
        for number, rows, _, _ in point.placed:
            wanted = (rows.keys.astype(np.int64) * 64 + number) * 4 + 3
            if len(keys) and len(wanted):
                at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
                out[f"place {number}"] = np.where(keys[at] == wanted, values[at], 0.0)
        return out
