"""The quadratic model of a reshaping problem at a curve: banded Hessian and linearised constraints.

Constraints on velocity, acceleration and jerk are |A x| <= b T^k: linear at a fixed T, else linearised in T at the
nearer bound, which keeps them inside the limit.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from energy_opt.motion.reshape.evaluation import Evaluation, Point
from energy_opt.motion.reshape.layout import LOCAL
from energy_opt.motion.reshape.open import bending
from energy_opt.numerics.batch import Batch
from energy_opt.numerics.quadratic import Banded, Constraints, add_nodes, add_places

SPARE = 0.02  # added to a step's first-order reach, to select constraints at places
HOT = 0.8  # share of a bound from which a limit at a node gets a constraint

AXES = 6  # most ranges of a via point's pose
ORDER = 1 << 20  # number of the first constraint on the order of via points: more than ends have
LINEAR, AT_NODES, VIA, AT_PLACES = range(4)  # kinds of constraints: a constraint's key is its kind + 4 times a number


class Model(Evaluation):
    """One problem of a shape, with the parts of its quadratic program."""

    @cached_property
    def _break_curvature(self) -> Batch:
        return Batch(self._nodes.curvature, len(self._breaks)).fixing(1, self._u[self._breaks], self._values)

    @cached_property
    def mass(self) -> Banded:
        """The metric of the Hessian's damping: squared positions, squared relative T and squared via times."""
        corner = np.eye(self.border)
        return Banded(self.shape.mass, np.zeros((self.shape.size, self.border)), corner)

    def hessian(self, point: Point, multipliers: dict[str, np.ndarray], convex: bool = False) -> Banded:
        """The Hessian of the Lagrangian at a point.

        Args:
            multipliers: by kind, as the method `multipliers` gives them; a kind that is missing counts as zero.
            convex: set negative eigenvalues of each node's and place's Hessian to zero.
        """
        s, n = self.shape, self.shape.joints
        hot = multipliers.get("hot")
        lam = np.zeros(point.hot.shape) if hot is None else hot / self._hot_scale
        # breakpoints of the spline have no weight in the cost: they count only where a limit is held
        sets = [(self._quad, self._curvature, (self.scale * self._weight)[:, None], self._quad_windows)]
        if hot is not None and lam[self._breaks[:-1]].any():
            none = np.zeros((len(self._breaks), 1))
            sets.append((self._breaks, self._break_curvature, none, self._windows_of(self._breaks[:-1])))
        band = np.zeros((s.size, s.width))
        out = Banded(band, np.zeros((s.size, self.border)), np.zeros((self.border, self.border)))
        for which, curvature, weight, (local, window) in sets:
            (blocks,) = curvature(point.z[which], weight, lam[which])
            c = blocks.reshape(len(which), 3 * n + 1, 3 * n + 1)
            if convex:
                c = _convex(c)
            add_nodes(band, c[: len(window)], local, window, n)
            if self.border == s.vias:
                continue
            # chain rule to the unknowns behind the band, which change z at every node
            behind = self._behind(point, which)
            index, free = s.columns(self._window[which])
            by = np.matmul(c, behind)
            for column in range(behind.shape[2]):
                flat = np.einsum("kdi,kda->kai", by[:, :-1, column].reshape(-1, 3, n), s.local[which, :3])
                out.border[:, column] += np.bincount(index[free], flat.reshape(len(which), -1)[free], s.size)
            out.corner[: behind.shape[2], : behind.shape[2]] += np.einsum("kzi,kzj->ij", behind, by)
        linear = multipliers.get("linear")
        if linear is not None and not self.fixed:  # of the bound T^k
            k = self.order
            out.corner[0, 0] -= float(np.sum(np.abs(linear) * k * (k - 1))) / point.duration**2
        # a step of an end follows its curved surface: the surface's bend times the gradient there
        for number, (end, surface) in enumerate(self.moving):
            at_nodes = np.matmul(point.hot_slope[:, :-1], lam[:, :, None]).reshape(len(lam), 3, n)
            force = self.by_end(point, number) + np.einsum("kd,kdi->i", self.end_z[number], at_nodes)
            if linear is not None:
                force = force + (linear / point.duration**self.order) @ self.end_linear[number]
            q, along = point.points[end], point.along[self.of == number]
            which = self.toward.start + np.flatnonzero(self.of == number)
            bend = surface.bend(q, along) @ force + self._sign(end) * self.scale * bending(surface.work, q, along)
            out.corner[np.ix_(which, which)] += bend
        for number, constraints, q, _ in point.placed:
            lam_place = multipliers.get(f"place {number}")  # neglects how moving ends scale with T
            if lam_place is not None and lam_place.any():
                window, local = self._placing(constraints.u)
                bent = constraints.hessian(q, lam_place)
                add_places(band, _convex(bent) if convex else bent, local, window, n)
        if s.vias and "via" in multipliers:
            self._add_via_curvature(out, point, multipliers["via"])
        return out

    def _behind(self, point: Point, which: np.ndarray) -> np.ndarray:
        """d z/d(T and the ends' steps) at nodes, (K, nz, columns)."""
        nz, count = point.z.shape[1], len(point.along)
        by_end = np.zeros((len(which), nz, count))
        if count:
            at = self.end_z[self.of][:, which]
            by_end[:, :-1] = np.einsum("ckd,ci->kdic", at, point.along).reshape(-1, nz - 1, count)
        return by_end if self.fixed else np.concatenate([self._z_slope[which, :, None], by_end], axis=2)

    def _add_via_curvature(self, out: Banded, point: Point, lam: np.ndarray) -> None:
        s, n = self.shape, self.shape.joints
        inner = slice(s.pinned, s.basis.controls - s.pinned)
        slope = s.basis.matrix(point.via_u, 1)
        bend = s.basis.matrix(point.via_u, 2) @ point.points
        window, local = self._placing(point.via_u)
        for i, passed in enumerate(point.passed):
            column, by = self.border - s.vias + i, lam[i * (n + AXES) :][: len(passed.slope)]
            force, bent = by @ passed.slope, np.tensordot(by[: len(passed.bend)], passed.bend, axes=1)
            speed = slope[i] @ point.points
            if bent.any():
                add_places(out.band, bent[None], local[i : i + 1], window[i : i + 1], n)
            out.border[:, column] += np.outer(slope[i, inner], force).ravel()
            out.border[:, column] += np.outer(s.basis.matrix(point.via_u[i : i + 1])[0, inner], bent @ speed).ravel()
            out.corner[column, column] += float(bend[i] @ force + speed @ bent @ speed)
            if not self.fixed:
                cross = float(slope[i] @ self._pinned_slope @ force)
                out.corner[0, column] += cross
                out.corner[column, 0] += cross

    def _placing(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Windows and basis values (K, 6) of places u (K,)."""
        first = self.shape.first(u)
        local = np.take_along_axis(self._matrix(u), first[:, None] + np.arange(LOCAL), axis=1)
        return first - self.shape.pinned, local

    def linear_constraints(
        self, point: Point, held: np.ndarray | None = None, side: np.ndarray | None = None
    ) -> Constraints:
        """Constraints on the control points of derivatives, linearised in T.

        Args:
            held: (L,) which of them; None for all.
            side: (L,) 1 or -1, the bound at which each is linearised; None for the nearer one.
        """
        constant = held is None and self.fixed and not self.moving
        if constant and point.duration in self._constant:
            return self._constant[point.duration].within(-1 - point.linear, 1 - point.linear)
        which = np.arange(len(point.linear)) if held is None else np.flatnonzero(held)
        time = 1 / point.duration ** self.order[which]
        border = np.zeros((len(which), self.border))
        share = point.linear[which]
        if not self.fixed:
            sign = np.sign(share) if side is None else side[which]
            border[:, 0] = self._linear_slope[which] * time - self.order[which] * sign / point.duration
        if self.moving:
            by_end = np.einsum("cli,ci->lc", self.end_linear[self.of][:, which], point.along)
            border[:, self.toward] = time[:, None] * by_end
        out = Constraints.of(
            self.shape.joints, self.border, first=self._linear_first[which], joint=self._linear_joint[which],
            coefficient=self._linear_local[which] * (time * self._per[which])[:, None], border=border,
            floor=-1 - share, ceiling=1 - share, keys=which * 4 + LINEAR,
        )  # fmt: skip
        if constant:
            self._constant[point.duration] = out
            out.matrix  # noqa: B018  # made once for all that share it
        return out

    def smooth_steps(self, constraints: Constraints, point: Point, most: float) -> Constraints:
        """Constraints that begin with all `linear_constraints`, with |d2q/du2| of a step at most `most` [rad, m]."""
        count = len(self.order)
        reach = np.where(self.order == 2, most * self._per / point.duration**2, np.inf)
        floor, ceiling = constraints.floor.copy(), constraints.ceiling.copy()
        ceiling[:count] = np.minimum(ceiling[:count], reach)
        floor[:count] = np.minimum(np.maximum(floor[:count], -reach), ceiling[:count])
        return constraints.within(floor, ceiling)

    def hot(self, point: Point, share: float) -> np.ndarray:
        """True for limits at nodes (nodes, columns) whose share exceeds `share`, or that are always held."""
        return np.asarray((point.used[len(point.linear) :].reshape(point.hot.shape) > share) | self._hot_always)

    def other_constraints(self, point: Point, far: float, hot: np.ndarray | None = None) -> Constraints:
        """Constraints at nodes near their bounds, and numeric ones that steps of `far` can reach.

        Args:
            far: [rad, m] most that control points will move; infinite for all numeric constraints.
            hot: (nodes, columns) the constraints at nodes; None for those near their bounds.
        """
        n, hot = self.shape.joints, self.hot(point, HOT) if hot is None else hot
        out = self._hot_constraints(point, hot) if hot.any() else Constraints.of(n, self.border)
        for number, placed, q, value in point.placed:
            gradient, off = placed.gradient(q), np.minimum(value - placed.lower, placed.upper - value)
            reach = np.abs(gradient).sum(axis=1) * far + SPARE if np.isfinite(far) else np.inf
            near = np.flatnonzero(off < reach)
            place, gradient = placed.place[near], gradient[near]
            edge = np.zeros((len(place), self.border))
            if self.moving:
                at_end = (self._matrix(placed.u) @ self.share.T)[place]
                edge[:, self.toward] = at_end[:, self.of] * (gradient @ point.along.T)
            if not self.fixed and not self._still:
                edge[:, 0] = np.sum(gradient * (self._matrix(placed.u) @ self._pinned_slope)[place], axis=1)
            used, row = np.unique(place, return_inverse=True)
            window, local = self._placing(placed.u)
            at_places = Constraints.of(
                n, self.border, place=row, gradient=gradient, place_first=window[used], basis=local[used], border=edge,
                floor=(placed.lower - value)[near], ceiling=(placed.upper - value)[near],
                keys=(placed.keys[near].astype(np.int64) * 64 + number) * 4 + AT_PLACES,
            )  # fmt: skip
            out = out.joined(at_places)
        return out.joined(self._end_bounds(point)) if self.moving else out

    def _hot_constraints(self, point: Point, which: np.ndarray) -> Constraints:
        """Constraints on `which` (nodes, columns) limits at nodes."""
        s, n = self.shape, self.shape.joints
        k, j = np.nonzero(which)
        slope = point.hot_slope[k, :, j] / self._hot_scale[j][:, None]
        parts = slope[:, :-1].reshape(-1, 3, n)
        edge = np.zeros((len(k), self.border))
        if self.border > s.vias:
            edge[:, : self.border - s.vias] = np.einsum("rz,rzc->rc", slope, self._behind(point, k))
        return Constraints.of(
            n, self.border, wide_first=self._window[k], border=edge, keys=(k * len(self._hot_scale) + j) * 4 + AT_NODES,
            wide=np.einsum("rdi,rda->rai", parts, s.local[k, :3]).reshape(len(k), s.width),
            floor=np.where(self._hot_one[j], -np.inf, -1 - point.hot[k, j]), ceiling=1 - point.hot[k, j],
        )  # fmt: skip

    def via_constraints(self, point: Point) -> Constraints:
        """Constraints that the curve passes the via points."""
        s, n = self.shape, self.shape.joints
        if not s.vias:
            return Constraints.of(n, self.border)
        basis, speed = s.basis.matrix(point.via_u), s.basis.matrix(point.via_u, 1) @ point.points
        window, local = self._placing(point.via_u)
        edge = np.zeros((s.vias, n, self.border))
        edge[:, :, self.toward] = (basis @ self.share.T)[:, None, self.of] * point.along.T
        for i in range(s.vias):
            edge[i, :, self.border - s.vias + i] = speed[i]
        if not self.fixed:
            edge[:, :, 0] = basis @ self._pinned_slope
        counts = [len(passed.slope) for passed in point.passed]
        keys = [i * (n + AXES) + np.arange(count) for i, count in enumerate(counts)]
        wide = [np.einsum("a,rj->raj", local[i], passed.slope).reshape(-1, s.width)
                for i, passed in enumerate(point.passed)]  # fmt: skip
        return Constraints.of(
            n, self.border, wide_first=np.repeat(window, counts), wide=np.vstack(wide),
            border=np.vstack([passed.slope @ edge[i] for i, passed in enumerate(point.passed)]),
            floor=np.concatenate([passed.low for passed in point.passed]),
            ceiling=np.concatenate([passed.high for passed in point.passed]), keys=np.concatenate(keys) * 4 + VIA,
        )  # fmt: skip

    def order_constraints(self, point: Point) -> Constraints:
        """Constraints that via points are passed in order: no step takes more than half of the time between two."""
        n, count = self.shape.joints, self.shape.vias - 1
        if count <= 0:
            return Constraints.of(n, self.border)
        border = np.zeros((count, self.border))
        border[:, self.border - count :] += np.eye(count)
        border[:, self.border - count - 1 : self.border - 1] -= np.eye(count)
        return self._behind_band(border, -np.diff(point.via_u) / 2, np.full(count, np.inf), ORDER)

    def _behind_band(self, border: np.ndarray, floor: np.ndarray, ceiling: np.ndarray, number: int) -> Constraints:
        """Constraints (R,) on the unknowns behind the band, `border` (R, border); `number`: of the first one."""
        count = len(border)
        none = np.zeros(count, dtype=np.int64)
        return Constraints.of(
            self.shape.joints, self.border, first=none, joint=none, coefficient=np.zeros((count, LOCAL)), border=border,
            floor=floor, ceiling=ceiling, keys=-1 - 4 * (number + np.arange(count)),
        )  # fmt: skip

    def _end_bounds(self, point: Point) -> Constraints:
        """Constraints on the steps of ends that may move: the joints' ranges and those of the pose's free
        coordinates.
        """
        parts = []
        for k, (end, surface) in enumerate(self.moving):
            q, along = point.points[end], point.along[self.of == k]
            value, slope, low, high = surface.ranges(q, along)
            border = np.zeros((len(q) + len(value), len(self.of)))
            border[:, self.of == k] = np.vstack([along.T, slope])
            parts.append(
                (border, np.concatenate([q, value]), *map(np.concatenate, zip(self.box, (low, high), strict=True)))
            )
        of_steps, value, low, high = (np.concatenate(part) for part in zip(*parts, strict=True))
        border = np.zeros((len(value), self.border))
        border[:, self.toward] = of_steps
        return self._behind_band(border, np.minimum(low - value, 0.0), np.maximum(high - value, 0.0), 0)

    @staticmethod
    def relaxed(constraints: Constraints, give: float, slack: float) -> Constraints:
        """The constraints with bounds that count excesses as `broken` does.

        An excess that is allowed need not shrink, but may not grow. A larger one needs to shrink only to what is
        allowed. If nothing is exceeded, these are the same constraints.

        Args:
            give: allowed excess over limits, a share of the bound; slack: over numeric constraints, in their own unit.
        """
        floor, ceiling = constraints.floor, constraints.ceiling
        if floor.max(initial=0.0) <= 0 <= ceiling.min(initial=0.0):  # nothing is exceeded
            return constraints
        kind = constraints.keys & 3
        allowed = np.where(kind == AT_PLACES, slack, np.where(kind == VIA, 0.0, give))
        return constraints.within(
            np.minimum(floor, np.maximum(floor - allowed, 0.0)), np.maximum(ceiling, np.minimum(ceiling + allowed, 0.0))
        )

    def multipliers(self, point: Point, keys: np.ndarray, values: np.ndarray) -> dict[str, np.ndarray]:
        """Multipliers in the form that `hessian` takes.

        Args:
            keys, values: (R,) keys of constraints, perhaps of another curve, and the multipliers found for them.

        Returns:
            The kinds that occur: "linear" (L,), "hot" (K, m), "via" (vias (n + AXES),) and "place k" (R,) for the limit
            number k; zero for constraints that are not among the keys.
        """
        name, kind = keys >> 2, keys & 3
        out: dict[str, np.ndarray] = {}
        if not self.fixed or self.moving:
            out["linear"] = np.zeros(len(point.linear))
            np.add.at(out["linear"], name[kind == LINEAR], values[kind == LINEAR])
        at_nodes = kind == AT_NODES
        if at_nodes.any():
            flat = np.zeros(point.hot.size)
            np.add.at(flat, name[at_nodes], values[at_nodes])
            out["hot"] = flat.reshape(point.hot.shape)
        if len(point.via) and (kind == VIA).any():
            out["via"] = np.zeros(len(point.via) * (self.shape.joints + AXES))
            out["via"][name[kind == VIA]] = values[kind == VIA]
        if point.placed:
            order = np.argsort(keys, kind="stable")
            keys, values = keys[order], values[order]
        for number, constraints, _, _ in point.placed:
            wanted = (constraints.keys.astype(np.int64) * 64 + number) * 4 + AT_PLACES
            if len(keys) and len(wanted):
                at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
                out[f"place {number}"] = np.where(keys[at] == wanted, values[at], 0.0)
        return out


def _convex(c: np.ndarray) -> np.ndarray:
    """Symmetric matrices (K, m, m) with negative eigenvalues set to zero."""
    values, vectors = np.linalg.eigh(c)
    return np.asarray((vectors * np.maximum(values, 0.0)[:, None]) @ vectors.transpose(0, 2, 1))
