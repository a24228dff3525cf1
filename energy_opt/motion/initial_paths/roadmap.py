"""Initial paths of low cost: shortest paths in roadmaps of seeded poses, weighted by the cost of being there.

A move in a given time with a cost per second P(q), and one that grows with the speed squared, is best along geodesics
of Jacobi's metric, sqrt(P + E) |dq|, at a speed in proportion to sqrt(P + E): costly regions are passed fast, and a
detour through cheap regions can pay. Inertia is neglected: these paths are starts, not answers.

A roadmap's poses lie along a free line, along a cheap line that is not free (an optimum found without bodies), and
around both. Its edges are checked when a shortest path first uses them, as in a lazy probabilistic roadmap (R. Bohlin
and L. E. Kavraki, Path planning using lazy PRM, ICRA 2000).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from energy_opt.motion.initial_paths.find import Ends, Looks

ALONG, AROUND = 60, 1500  # poses along each line, and scattered around both
SPREAD = (0.1, 0.25, 0.5, 0.9)  # [rad] standard deviations of the scatter
NEIGHBOURS = 12  # neighbours of each pose
# E as a share of the median of P, in turn: a small share allows long cheap detours, a large one only short ones
EASE = (0.3, 3.0)
# edges within AWAY [rad] of a path found have their weight times COSTLIER in the next roadmap
AWAY, COSTLIER = 0.6, 2.0
SEARCHES = 600  # most shortest paths to check in one roadmap
DENSE = 0.05  # [rad] largest spacing of a path's poses
RAMP = 0.25  # share of a path's time to accelerate, and to stop
SMOOTH = 0.02  # share of a path's time: standard deviation of the smoothing of corners
SAMPLES = 400  # poses of a path, evenly in time

Rate = Callable[[np.ndarray], np.ndarray]  # (M, n) poses -> (M,) cost per second of being there


def cheap_paths(
    looks: Looks, ends: Ends, rate: Rate, lines: Sequence[np.ndarray], seed: int, count: int
) -> Iterator[np.ndarray]:
    """Up to `count` paths from start to goal, poses (SAMPLES, n) evenly in time; each far from those before, if
    possible.

    They are free at the poses checked along their edges, apart from corners and smoothing.

    Args:
        looks: checks poses and lines between them.
        rate: cost per second of being somewhere, zero or above.
        lines: (M, n) poses each, from start to goal; roadmaps are built around the first, preferably a free one, and
            each of the others in turn.
        seed: of the roadmaps.
    """
    found: list[np.ndarray] = []
    for k in range(count):
        about = lines[0], lines[k % len(lines)]
        net = _Net(looks, ends, rate, about, np.random.default_rng([seed, k]), EASE[k % len(EASE)])
        for path in found:
            net.penalize(path)
        corners = net.shortest()
        if corners is not None:
            found.append(_dense(corners))
            yield net.timed_poses(found[-1])


class _Net:
    """A roadmap of poses between two ends, checked only as far as its shortest path needs."""

    def __init__(
        self,
        looks: Looks,
        ends: Ends,
        rate: Rate,
        lines: Sequence[np.ndarray],
        random: np.random.Generator,
        ease: float,
    ) -> None:
        from scipy.spatial import KDTree

        self._looks, self._velocity, self._rate = looks, ends.velocity, rate
        along = np.vstack([line[np.linspace(0, len(line) - 1, ALONG + 2).astype(int)[1:-1]] for line in lines])
        spread = random.choice(SPREAD, size=(AROUND, 1))
        strewn = along[random.integers(len(along), size=AROUND)]
        strewn = strewn + spread * random.normal(size=strewn.shape)
        inner = np.clip(np.vstack([along, strewn]), ends.lower, ends.upper)
        clear = [q for q in inner if looks.clear(q)]
        self._q = np.vstack([ends.start, ends.goal, *clear])
        self._ease = ease * float(np.median(rate(self._q))) + np.finfo(float).tiny
        scaled = self._q / ends.velocity
        near = KDTree(scaled).query(scaled, min(NEIGHBOURS + 1, len(scaled)))[1]
        edges = np.sort(np.stack([np.repeat(np.arange(len(near)), near.shape[1]), near.ravel()], axis=1), axis=1)
        self._edges = np.unique(edges[edges[:, 0] != edges[:, 1]], axis=0)
        self._number = {(a, b): k for k, (a, b) in enumerate(self._edges.tolist())}
        self._known = np.zeros(len(self._edges), dtype=int)  # 1: free, -1: not free, 0: not checked
        a, b = self._q[self._edges[:, 0]], self._q[self._edges[:, 1]]
        pace = self._speed(self._q)
        self._weight = np.linalg.norm((b - a) / ends.velocity, axis=1) * pace[self._edges].mean(axis=1)

    def _speed(self, q: np.ndarray) -> np.ndarray:
        """The speed at which poses are passed, up to a factor: the root of the cost of being there."""
        return np.sqrt(self._rate(q) + self._ease)

    def penalize(self, path: np.ndarray) -> None:
        """Increase the weights of edges near a path (M, n)."""
        from scipy.spatial import KDTree

        middles = self._q[self._edges].mean(axis=1)
        self._weight[KDTree(path).query(middles)[0] < AWAY] *= COSTLIER

    def shortest(self) -> np.ndarray | None:
        """The corners (K, n) of the shortest path whose edges are free; None if there is none, or the search takes
        too long.
        """
        from scipy.sparse import csr_matrix
        from scipy.sparse.csgraph import dijkstra

        for _ in range(SEARCHES):
            live = self._known >= 0
            net = csr_matrix((self._weight[live], self._edges[live].T), shape=(len(self._q),) * 2)
            reached, before = dijkstra(net, directed=False, indices=0, return_predecessors=True)
            if not np.isfinite(reached[1]):
                return None
            nodes = [1]
            while nodes[-1] != 0:
                nodes.append(int(before[nodes[-1]]))
            free = [self._free(a, b) for a, b in zip(nodes[1:], nodes[:-1], strict=True)]  # check all of them
            if all(free):
                return self._q[nodes[::-1]]
        return None

    def _free(self, a: int, b: int) -> bool:
        number = self._number[min(a, b), max(a, b)]
        if not self._known[number]:
            self._known[number] = 1 if self._looks.line(self._q[a], self._q[b]) else -1
        return bool(self._known[number] > 0)

    def timed_poses(self, path: np.ndarray) -> np.ndarray:
        """Poses (SAMPLES, n) evenly in time: a path passed from rest to rest, fast in costly regions."""
        from scipy.ndimage import gaussian_filter1d

        pace, step = self._speed(path), np.linalg.norm(np.diff(path, axis=0) / self._velocity, axis=1)
        at = np.concatenate([[0.0], np.cumsum(2 * step / (pace[1:] + pace[:-1]))])
        u = np.linspace(0, 1, SAMPLES)
        s = (np.minimum(u, RAMP) ** 2 - np.maximum(u - 1 + RAMP, 0) ** 2) / 2 + RAMP * np.maximum(u - RAMP, 0)
        poses = np.column_stack([np.interp(s / (RAMP * (1 - RAMP)) * at[-1], at, x) for x in path.T])
        return np.asarray(gaussian_filter1d(poses, SMOOTH * SAMPLES, axis=0, mode="nearest"))


def _dense(corners: np.ndarray) -> np.ndarray:
    """Closely spaced poses along a bent line, with its corners."""
    edges = zip(corners[:-1], corners[1:], strict=True)
    parts = [np.linspace(a, b, 2 + int(np.abs(b - a).max() / DENSE))[1:] for a, b in edges]
    return np.vstack([corners[:1], *parts])
