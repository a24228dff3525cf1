"""The scheduling problem: rings of moves and waits, time lags between them, and zones for one robot at a time.

`keeps` checks lags and exclusions from starts and durations, independent of the program that found them.

The energy of a step over its duration is a convex curve: a polynomial, or the hull of known points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Mode:
    """A mode in which a robot waits.

    Attributes:
        name: for results; power: while waiting [W].
        least: shortest duration, entry and exit included [s].
        enter, leave: seconds [s] and energy [J] of entry and exit.
        stated: power [W] under the model that results are stated under, if not `power`.
    """

    name: str
    power: float
    least: float = 0.0
    enter: tuple[float, float] = (0.0, 0.0)
    leave: tuple[float, float] = (0.0, 0.0)
    stated: float | None = None

    @property
    def shortest(self) -> float:
        """The shortest wait in this mode [s]."""
        return max(self.least, self.enter[0] + self.leave[0])

    @property
    def fixed(self) -> float:
        """Energy [J] beyond power * duration: E = power * duration + fixed."""
        return self.enter[1] + self.leave[1] - self.power * (self.enter[0] + self.leave[0])

    def energy(self, duration: float) -> float:
        """Energy [J] of a wait of `duration` [s] in this mode."""
        return self.power * duration + self.fixed


@dataclass(frozen=True)
class Move:
    """A motion. Its duration [s] is in [least, most]; `curve` gives its energy; `as_is` is its present duration, if
    known; `stated` gives the energy [J] over the duration under the model that results are stated under, if another.
    """

    name: str
    least: float
    most: float
    curve: Curve
    as_is: float | None = None
    stated: Callable[[float], float] | None = None


@dataclass(frozen=True)
class Wait:
    """A stay at one place. Its duration [s] is in [least, most]; one of `modes` is chosen."""

    name: str
    least: float
    most: float
    modes: tuple[Mode, ...]


@dataclass(frozen=True)
class Group:
    """Consecutive steps of a ring, in blocks that may be done in any order.

    Attributes:
        blocks: pairs (first, last) of steps' indices; each block follows the one before.
        before: pairs (i, j) of blocks: i is done before j.
    """

    blocks: tuple[tuple[int, int], ...]
    before: frozenset[tuple[int, int]] = frozenset()


@dataclass(frozen=True)
class Ring:
    """The steps of one robot, in order; the first follows the last, one cycle later.

    Attributes:
        groups: parts of it whose order is free. If one is the whole ring, its first possible block stays first.
    """

    name: str
    steps: tuple[Move | Wait, ...]
    groups: tuple[Group, ...] = ()


@dataclass(frozen=True)
class Lag:
    """start(to) - start(from) >= length - cycle_time * height, in seconds.

    Attributes:
        begin, end: pairs (ring, step) of indices: "from" and "to".
        begin_ends: does the lag count from the end of step `begin` (else from its start)?
        length: [s].
        height: cycles between the two; None lets the solver choose it.
        most: the lag is at most this [s]; None for no bound.
        within: start(to) - start(from) is at most this [s]; None for no bound.
    """

    begin: tuple[int, int]
    end: tuple[int, int]
    length: float
    height: int | None = 0
    begin_ends: bool = False
    most: float | None = None
    within: float | None = None


@dataclass(frozen=True)
class Run:
    """Consecutive steps of a ring, as an interval of time.

    Attributes:
        ring, first, last: indices; `last` is smaller than `first` if the run passes the end of the ring.
        part: shares of the duration of `first` at which the interval begins and ends; None for the whole run.
    """

    ring: int
    first: int
    last: int
    part: tuple[float, float] | None = None


@dataclass(frozen=True)
class Exclusion:
    """Two runs of different rings that may not overlap in time, in any cycle; `gap` seconds lie between them."""

    first: Run
    second: Run
    gap: float = 0.0


@dataclass(frozen=True)
class Problem:
    """A cell. `cycle_time` in seconds."""

    cycle_time: float
    rings: tuple[Ring, ...]
    lags: tuple[Lag, ...] = ()
    exclusions: tuple[Exclusion, ...] = ()

    def in_order(self, orders: Sequence[Sequence[int]]) -> Problem:
        """The problem with the steps of every ring in another, then fixed, order; `orders` contains indices of
        steps.
        """
        place = [{k: new for new, k in enumerate(order)} for order in orders]
        rings = tuple(Ring(ring.name, tuple(ring.steps[k] for k in order))
                      for ring, order in zip(self.rings, orders, strict=True))  # fmt: skip

        def moved(run: Run) -> Run:
            return replace(run, first=place[run.ring][run.first], last=place[run.ring][run.last])

        def at(step: tuple[int, int]) -> tuple[int, int]:
            return step[0], place[step[0]][step[1]]

        lags = tuple(replace(lag, begin=at(lag.begin), end=at(lag.end)) for lag in self.lags)
        exclusions = tuple(replace(e, first=moved(e.first), second=moved(e.second)) for e in self.exclusions)
        return Problem(self.cycle_time, rings, lags, exclusions)

    def describe(self, constraint: Lag | Exclusion) -> str:
        """A lag or an exclusion in words."""

        def named(r: int, first: int, last: int | None = None) -> str:
            steps, ring = self.rings[r].steps, self.rings[r].name
            own = f"{ring}.{steps[first].name}"
            return own if last in (None, first) else f"{own} to {ring}.{steps[last].name}"

        if isinstance(constraint, Exclusion):
            one, two = (named(run.ring, run.first, run.last) for run in (constraint.first, constraint.second))
            apart = f", {constraint.gap:g} s apart" if constraint.gap else ""
            return f"{one} and {two} not at once{apart}"
        one, two = named(*constraint.begin), named(*constraint.end)
        most = constraint.most if constraint.within is None else constraint.within
        length = constraint.length - self.cycle_time * (constraint.height or 0)
        late = f"{length:g} s or more" if most is None else f"{length:g} to {most:g} s"
        return f"{two} {late} after {one} {'ends' if constraint.begin_ends else 'begins'}"

    @property
    def as_listed(self) -> Problem:
        """The problem with its steps in the listed order, as far as the groups allow it."""
        return self.in_order([listed(ring) for ring in self.rings])


def listed(ring: Ring) -> list[int]:
    """Indices of a ring's steps in the order of its list; in groups a block is delayed until it is allowed."""
    return in_blocks(len(ring.steps), ring.groups, [possible(group, range(len(group.blocks))) for group in ring.groups])


def possible(group: Group, wanted: Sequence[int]) -> list[int]:
    """The order of a group's blocks nearest to the wanted one: a block is delayed until it is allowed."""
    left, out = list(wanted), []
    while left:
        free = [j for j in left if not any(i in left for i, k in group.before if k == j)]
        out.append((free or left)[0])
        left.remove(out[-1])
    return out


def in_blocks(count: int, groups: Sequence[Group], orders: Sequence[Sequence[int]]) -> list[int]:
    """Indices of `count` steps with the blocks of every group in the given order.

    Args:
        count: of steps. groups: blocks that may change places. orders: of each group's blocks.
    """
    out = list(range(count))
    for group, order in zip(groups, orders, strict=True):
        first, last = group.blocks[0][0], group.blocks[-1][1]
        out[first : last + 1] = [k for b in order for k in range(group.blocks[b][0], group.blocks[b][1] + 1)]
    return out


CLOSE = 1e-6  # [s] tolerance


def keeps(problem: Problem, starts: Sequence[np.ndarray], durations: Sequence[np.ndarray]) -> bool:
    """True if a schedule keeps all lags and exclusions.

    Args:
        problem: with these. starts, durations: [s] of each ring's steps, (steps,) each.
    """
    cycle = problem.cycle_time
    for lag in problem.lags:
        (a, i), (b, j) = lag.begin, lag.end
        behind = starts[b][j] - starts[a][i]
        if lag.height is None:
            ended = durations[a][i] if lag.begin_ends else 0.0
            most = min(np.inf if lag.most is None else lag.most + ended, np.inf if lag.within is None else lag.within)
            if (behind - ended - lag.length + CLOSE) % cycle > most - ended - lag.length + 2 * CLOSE:
                return False
        elif behind < lag.length - cycle * lag.height - CLOSE:
            return False
    for pair in problem.exclusions:
        (one, one_end), (two, two_end) = (_interval(run, starts, durations) for run in (pair.first, pair.second))
        if (two - one) % cycle < one_end - one + pair.gap - CLOSE:
            return False
        if (one - two) % cycle < two_end - two + pair.gap - CLOSE:
            return False
    return True


def _interval(run: Run, starts: Sequence[np.ndarray], durations: Sequence[np.ndarray]) -> tuple[float, float]:
    """Begin and end [s] of the steps, or of the part of a step, of a run."""
    begin, lengths = float(starts[run.ring][run.first]), durations[run.ring]
    if run.part is not None:
        return begin + run.part[0] * float(lengths[run.first]), begin + run.part[1] * float(lengths[run.first])
    count = (run.last - run.first) % len(lengths) + 1
    return begin, begin + float(sum(lengths[(run.first + k) % len(lengths)] for k in range(count)))


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
        """Durations (16,) [s] of the first tangents, denser where the curve bends more."""
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
        """The middle [s] of each piece, (pieces,): its tangent there is the piece itself."""
        return (self.durations[1:] + self.durations[:-1]) / 2 if len(self.durations) > 1 else self.durations


Curve = Polynomial | Hull  # a convex function E(d): energy [J] of a step that takes d [s]
