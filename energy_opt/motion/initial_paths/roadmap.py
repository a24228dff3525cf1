"""Ways that are cheap: the shortest ones in nets of seeded poses, by what it costs to be where they lead.

A move in a given time with a cost per second P(q) and one that grows with the speed squared goes, at its best, along
geodesics of Jacobi's metric, sqrt(P + E) |dq|, at a speed in proportion to sqrt(P + E): what is costly is passed fast,
and a detour is worth its while where it is cheap to be. Inertia is left out: these ways are starts, no answers.

A net's poses lie along a line that is free, along one that is cheap but not free (an optimum found without regard to
what is around), and about both. Its edges are looked at when a shortest way first asks for them, as in a lazy
probabilistic roadmap (R. Bohlin and L. E. Kavraki, Path planning using lazy PRM, ICRA 2000).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from energy_opt.motion.initial_paths.find import Ends, Looks

ALONG, AROUND = 60, 1500  # poses along each line, and strewn about both
SPREAD = (0.1, 0.25, 0.5, 0.9)  # [rad] how far from them
NEIGHBOURS = 12  # of each pose
EASE = (0.3, 3.0)  # E, as a share of the median of P, in turns: detours that go far for what is cheap, and short ones
AWAY, COSTLIER = 0.6, 2.0  # [rad] about a way that was found, edges count so many times as much in the next net
SEARCHES = 600  # shortest ways looked at before a net is given up
DENSE = 0.05  # [rad] between poses of a way
RAMP = 0.25  # share of a way's time in which it comes to speed, and in which it stops
SMOOTH = 0.02  # and of that over which corners are averaged (standard deviation)
SAMPLES = 400  # of a way evenly in time

Rate = Callable[[np.ndarray], np.ndarray]  # (M, n) poses -> (M,) what it costs to be there, by the second


def cheap_paths(
    looks: Looks, ends: Ends, rate: Rate, lines: Sequence[np.ndarray], seed: int, count: int
) -> Iterator[np.ndarray]:
    """Up to `count` ways from start to goal, poses (SAMPLES, n) evenly in time; none near to those before, if it can.

    They are free as far as poses along their edges tell, corners and what smooths them aside.

    Args:
        looks: what poses and lines between them are looked at by.
        rate: what it costs to be somewhere, zero or above.
        lines: (M, n) poses each, from start to goal; nets are laid about the first, best a free one, and each in turn.
        seed: of the nets.
    """
    found: list[np.ndarray] = []
    for k in range(count):
        about = lines[0], lines[k % len(lines)]
        net = _Net(looks, ends, rate, about, np.random.default_rng([seed, k]), EASE[k % len(EASE)])
        for way in found:
            net.shun(way)
        corners = net.shortest()
        if corners is not None:
            found.append(_dense(corners))
            yield net.passed(found[-1])


class _Net:
    """A net of poses between two ends, looked at as far as the shortest way through it needs."""

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
        self._known = np.zeros(len(self._edges), dtype=int)  # 1: free, -1: not
        a, b = self._q[self._edges[:, 0]], self._q[self._edges[:, 1]]
        pace = self._pace(self._q)
        self._weight = np.linalg.norm((b - a) / ends.velocity, axis=1) * pace[self._edges].mean(axis=1)

    def _pace(self, q: np.ndarray) -> np.ndarray:
        """The speed at which poses are passed, up to a factor: the root of what it costs to be there."""
        return np.sqrt(self._rate(q) + self._ease)

    def shun(self, way: np.ndarray) -> None:
        """Count edges near a way (M, n) as costlier."""
        from scipy.spatial import KDTree

        middles = self._q[self._edges].mean(axis=1)
        self._weight[KDTree(way).query(middles)[0] < AWAY] *= COSTLIER

    def shortest(self) -> np.ndarray | None:
        """The corners (K, n) of the shortest way whose edges are free; None where there is none, or it takes long."""
        from scipy.sparse import csr_matrix
        from scipy.sparse.csgraph import dijkstra

        for _ in range(SEARCHES):
            live = self._known >= 0
            net = csr_matrix((self._weight[live], self._edges[live].T), shape=(len(self._q),) * 2)
            reached, before = dijkstra(net, directed=False, indices=0, return_predecessors=True)
            if not np.isfinite(reached[1]):
                return None
            way = [1]
            while way[-1] != 0:
                way.append(int(before[way[-1]]))
            free = [self._free(a, b) for a, b in zip(way[1:], way[:-1], strict=True)]  # all of them are looked at
            if all(free):
                return self._q[way[::-1]]
        return None

    def _free(self, a: int, b: int) -> bool:
        number = self._number[min(a, b), max(a, b)]
        if not self._known[number]:
            self._known[number] = 1 if self._looks.line(self._q[a], self._q[b]) else -1
        return bool(self._known[number] > 0)

    def passed(self, way: np.ndarray) -> np.ndarray:
        """Poses (SAMPLES, n) evenly in time: a way passed from rest to rest, fast where it is costly."""
        from scipy.ndimage import gaussian_filter1d

        pace, step = self._pace(way), np.linalg.norm(np.diff(way, axis=0) / self._velocity, axis=1)
        at = np.concatenate([[0.0], np.cumsum(2 * step / (pace[1:] + pace[:-1]))])
        u = np.linspace(0, 1, SAMPLES)
        s = (np.minimum(u, RAMP) ** 2 - np.maximum(u - 1 + RAMP, 0) ** 2) / 2 + RAMP * np.maximum(u - RAMP, 0)
        poses = np.column_stack([np.interp(s / (RAMP * (1 - RAMP)) * at[-1], at, x) for x in way.T])
        return np.asarray(gaussian_filter1d(poses, SMOOTH * SAMPLES, axis=0, mode="nearest"))


def _dense(corners: np.ndarray) -> np.ndarray:
    """Poses along a bent line, near to each other, corners among them."""
    edges = zip(corners[:-1], corners[1:], strict=True)
    parts = [np.linspace(a, b, 2 + int(np.abs(b - a).max() / DENSE))[1:] for a, b in edges]
    return np.vstack([corners[:1], *parts])
