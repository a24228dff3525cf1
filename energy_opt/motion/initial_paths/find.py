"""First paths: the straight line if it is free, else our own bent lines, else a sampling planner's."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from energy_opt.motion.initial_paths import ompl
from energy_opt.motion.initial_paths.polyline import Rounding, between, length, merged, shortened, without_needless
from energy_opt.motion.path import JointPath, straight

Source = Literal["straight", "given", "own", "ompl"]
VIAS = 150  # seeded points through which our own lines may bend
PAIRS = 400  # most pairs of such points to try
OWN = 4  # own lines that may fail their proof, or repeat others, before a planner is asked
ATTEMPTS = 10  # most attempts of a planner at a first path
# most poses that an attempt may check: 0.15 s. Until there is a path, each pair of attempts may check twice as many.
POSES = 10_000
# [rad] longest edges of the planner's trees, in turn: short ones follow narrow passages, long ones leave wide boxes
EDGES = (0.25, 2.5)
SAME = 0.15  # [rad] paths that differ by less at all inner places are the same
ROUNDS = 40  # most times that corners are tightened before a path is given up


class Free(Protocol):
    """The obstacle check for paths: the body and the cell, first pose by pose, then by a proof."""

    def clear(self, q: np.ndarray) -> bool:
        """True if the pose q (n,) is free with the margin of paths."""
        ...

    def unproven(self, path: JointPath) -> float | None:
        """A place along the path (s) that could not be proven free; None if all of it is proven."""
        ...


@dataclass(frozen=True)
class InitialPath:
    """A free path.

    Attributes:
        source: how it was found.
        seconds: time to find it, with all searches before it.
        length: duration of its bent line at the joints' speed limits, s.
    """

    path: JointPath
    source: Source
    seconds: float
    length: float


@dataclass(frozen=True)
class Ends:
    """The ends of a path (n,) [rad, m], bounds of its poses, and the joints' speed limits [rad/s, m/s]."""

    start: np.ndarray
    goal: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray

    @staticmethod
    def of(start: np.ndarray, goal: np.ndarray, lower: np.ndarray, upper: np.ndarray, velocity: np.ndarray) -> Ends:
        """With bounds [rad, m] narrowed to half a turn beyond the ends: further turns never shorten a path."""
        least, most = np.minimum(start, goal), np.maximum(start, goal)
        return Ends(
            start, goal, np.minimum(np.maximum(lower, least - np.pi), least),
            np.maximum(np.minimum(upper, most + np.pi), most), velocity,
        )  # fmt: skip


class Looks:
    """Checks of poses and of lines between them, with a count of poses."""

    def __init__(self, free: Free, step: np.ndarray) -> None:
        self.free, self._step = free, step
        self.poses = 0

    def clear(self, q: np.ndarray) -> bool:
        """True if the pose q (n,) is free with the margin of paths; counts the checked poses."""
        self.poses += 1
        return self.free.clear(q)

    def line(self, a: np.ndarray, b: np.ndarray) -> bool:
        """True if the straight line between two free poses (n,) is free at the poses checked along it."""
        return all(self.clear(q) for q in between(a, b, self._step))

    def proven_line(self, a: np.ndarray, b: np.ndarray) -> bool:
        """True if all of the line is proven free. Poses alone may miss contacts, since shortcuts run along
        obstacles' edges.
        """
        return self.line(a, b) and self.free.unproven(straight(a, b)) is None

    def budget(self, poses: int, stopped: Callable[[], bool]) -> Callable[[], bool]:
        """A function that is True once so many more poses have been checked, or the search was `stopped`."""
        last = self.poses + poses
        return lambda: self.poses >= last or stopped()


def find_paths(
    free: Free, ends: Ends, step: np.ndarray, *, planner: str = "auto", seed: int = 0, count: int = 1,
    stopped: Callable[[], bool] = lambda: False,
) -> list[InitialPath]:  # fmt: skip
    """Up to `count` proven paths, the shortest first; only the straight line if it is free.

    Args:
        free: checks poses and proves paths. ends: start, goal and the bounds of poses.
        step: (n,) [rad, m] largest spacing of the checked poses along a line, for each joint.
        planner: "auto" and "ompl" ask OMPL if our own lines find nothing ("auto": only if it is installed), "none" does
            not.
        seed: of all random choices; the same seed gives the same paths.
        stopped: True ends a planner's search with the paths found so far.
    """
    began = time.perf_counter()
    line = straight(ends.start, ends.goal)
    if free.unproven(line) is None:
        lasts = length(np.stack([ends.start, ends.goal]), ends.velocity)
        return [InitialPath(line, "straight", time.perf_counter() - began, lasts)]
    search = Looks(free, step)
    if not (search.clear(ends.start) and search.clear(ends.goal)):
        return []
    found: list[InitialPath] = []
    for source, points in _free_bent_lines(search, ends, planner, seed, count, found, stopped):
        path = _rounded_path(search, ends, points, source, seed + len(found), began)
        if path is not None and not any(_is_similar(path, other) for other in found):
            found.append(path)
        if len(found) == count:
            break
    return sorted(found, key=lambda path: path.length)


def _free_bent_lines(
    search: Looks, ends: Ends, planner: str, seed: int, count: int, found: Sequence[InitialPath],
    stopped: Callable[[], bool],
) -> Iterator[tuple[Source, np.ndarray]]:  # fmt: skip
    """Bent lines that are free at the poses checked along them: our own, then, if these are too few, a planner's.

    Args:
        found: the paths that lines have led to so far; the planner searches longer until there is one.
        stopped: True ends the planner's search.
    """
    for k, points in enumerate(_own_bent_lines(search, ends, seed)):
        if k == OWN + count:
            break
        yield "own", points
    if planner == "none" or not ompl.installed():
        return
    for k in range(ATTEMPTS + 2 * count):
        if stopped() or (not found and k == ATTEMPTS):
            return
        enough = search.budget(POSES if found else POSES * 2 ** (k // 2), stopped)
        bent = ompl.rrt_connect(
            ends.start,
            ends.goal,
            ends.lower,
            ends.upper,
            search.clear,
            search.line,
            enough,
            seed + k,
            EDGES[k % len(EDGES)],
        )
        if bent is not None:
            yield "ompl", bent


def _own_bent_lines(search: Looks, ends: Ends, seed: int) -> Iterator[np.ndarray]:
    """Lines through one seeded point, or through two: one visible from the start and one from the goal."""
    random = np.random.default_rng(seed)
    middle, half = (ends.start + ends.goal) / 2, np.abs(ends.goal - ends.start) / 2
    from_start, from_goal = [], []
    for k in range(VIAS):
        wide = k / VIAS  # from near the straight line to anywhere
        q = random.uniform(ends.lower, ends.upper)
        near = np.clip(middle + random.normal(size=len(q)) * (half + 0.3), ends.lower, ends.upper)
        via = (1 - wide) * near + wide * q
        if not search.clear(via):
            continue
        seen = search.line(ends.start, via), search.line(via, ends.goal)
        if all(seen):
            yield np.stack([ends.start, via, ends.goal])
        elif seen[0]:
            from_start.append(via)
        elif seen[1]:
            from_goal.append(via)
    pairs = [(a, b) for a in from_start for b in from_goal]
    pairs.sort(key=lambda pair: length(np.stack([ends.start, *pair, ends.goal]), ends.velocity))
    for a, b in pairs[:PAIRS]:
        if search.line(a, b):
            yield np.stack([ends.start, a, b, ends.goal])


def _rounded_path(
    search: Looks, ends: Ends, points: np.ndarray, source: Source, seed: int, began: float
) -> InitialPath | None:
    """The bent line shortened, its corners rounded as far as the proof allows; None if it cannot be proven."""
    points = without_needless(points, search.proven_line)
    points = shortened(points, search.proven_line, ends.velocity, seed)
    points = without_needless(merged(points, search.proven_line), search.proven_line)
    rounding = Rounding(points)
    for _ in range(ROUNDS):
        path = rounding.path()
        if not Rounding.regular(path):
            return None
        where = search.free.unproven(path)
        if where is None:
            return InitialPath(path, source, time.perf_counter() - began, length(points, ends.velocity))
        if not rounding.tighter(where):
            return None
    return None


def _is_similar(a: InitialPath, b: InitialPath) -> bool:
    """True if two paths differ only slightly."""
    s = np.linspace(0, 1, 9)[1:-1]
    return bool(np.abs(a.path(s) - b.path(s)).max() < SAME)
