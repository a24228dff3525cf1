"""Reshaping that keeps clear of the arm's own body and of its cell: rounds of rows over frozen planes, each proven.

A round fixes a plane between every two bodies that are near at places along the curve, lets IPOPT go a little way from
there, and has the result proven. Where the proof fails, the next round looks there too and keeps more distance; the
best curve that was proven stays the answer while the search goes on from the last; and the part of the way towards
this one that can be proven is kept too, so that a search which ends a hair inside of something is not lost.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from energy_opt.cell.cell import Cell, Clearance
from energy_opt.cell.planes import Near
from energy_opt.motion.limits.base import box_of
from energy_opt.motion.limits.clearance import ClearanceRows
from energy_opt.motion.reshape.level import Curve, Level, Multipliers, Outcome, between
from energy_opt.motion.reshape.search import trajectory_of
from energy_opt.motion.reshape.task import FEASIBLE, Task, all_rows

log = logging.getLogger(__name__)
PLACES = 60  # along a curve, evenly in time, where pairs are looked at
ROUNDS, BOLD = 12, 6  # rounds, and those of them in which a failed proof does not make the next step shorter
CLOSE = 0.05  # of their spacing: a corner that is passed fast needs places as near to each other as this
REACH = 0.1  # [m] pairs that are nearer get rows
ARM, AGAIN = 1.0, 2.0  # [m] by which turns of joints come near; a round goes so many times as far as the last, at most
MARGIN = 0.002  # [m] rows keep this much more than is to be proven
MORE, MOST = 0.0005, 0.0015  # [m] added to it where a proof failed, and how much of that at most
RAMP = 0.15  # share of the move over which the margin of an end that stands nearer grows to the full one
END_SHARE = 0.8  # of what an end has beyond the clearance that is asked for, the margin there
TRUST, GROWTH, SHRINK = 0.25, 1.5, 0.5  # [rad] that control points may go in a round; after a proven and a failed one
LEAST = 0.03  # [rad]
LOOSE, FINE = 1e-3, 1e-5  # IPOPT's tolerance in a round, and in the last one
ITERATIONS = 40
DONE = 3e-3  # two proven rounds that win less of the cost than this share end the search
SHARES = (0.9, 0.7, 0.4)  # of the way from the best proven curve to one that is cheaper and not proven
CHEAPER = 0.002  # of the cost: where less is to be won, no part of the way is tried
HOPELESS, LESS = 0.45, 0.9  # [rows' units] rows broken by more, and not by less than this share of what it was before


@dataclass
class Cleared:
    """The best outcome that is proven to keep clear, if any, and the iterations spent."""

    best: Outcome | None = None
    iterations: int = 0

    def take(self, outcome: Outcome) -> None:
        """Keep an outcome if it is the cheapest."""
        if self.best is None or outcome.cost < self.best.cost:
            self.best = outcome

    def join(self, other: Cleared) -> None:
        """Count what another search took, and keep its best if it is the cheapest."""
        self.iterations += other.iterations
        if other.best is not None:
            self.take(other.best)


@dataclass
class Places:
    """Where rows are wanted: places u, pairs that are forced near a time, and what pairs keep beyond the usual [m]."""

    u: np.ndarray
    more: np.ndarray
    forced: set[tuple[float, int]] = field(default_factory=set)

    @classmethod
    def evenly(cls, pairs: int) -> Places:
        """The usual places, of a cell with that many pairs of bodies."""
        return cls((np.arange(PLACES) + 0.5) / PLACES, np.zeros(pairs))

    def learn(self, proof: Clearance, duration: float) -> None:
        """Look where a proof failed, and keep more distance there."""
        for touch in proof.touches:
            at = touch.time / duration
            self.forced.add((at, touch.pair))
            if np.abs(self.u - at).min() > CLOSE / PLACES:
                self.u = np.sort(np.append(self.u, at))
        pairs = np.unique(np.array([touch.pair for touch in proof.touches], dtype=int))
        self.more[pairs] = np.minimum(self.more[pairs] + MORE, MOST)

    @property
    def must(self) -> frozenset[tuple[int, int]]:
        """Places and pairs that get a row anyway."""
        near = ((int(np.argmin(np.abs(self.u - at))) + d, pair) for at, pair in self.forced for d in (-1, 0, 1))
        return frozenset((k, pair) for k, pair in near if 0 <= k < len(self.u))


class Margins:
    """What pairs of bodies keep along a move between two poses `ends` (2, n)."""

    def __init__(self, cell: Cell, ends: np.ndarray) -> None:
        self.wanted = cell.wanted(ends)  # (P,) to be proven, m
        self._at_ends = np.full((2, len(self.wanted)), np.inf)  # what each pair can keep there, m
        for held, q in zip(self._at_ends, ends, strict=True):
            for pair, distance in cell.distances(q, 2 * (cell.asked + MARGIN + MOST)):
                held[pair] = self.wanted[pair] + END_SHARE * (distance - self.wanted[pair])

    def at(self, places: Places) -> np.ndarray:
        """The margin (K, P) [m] of every pair: the full one, and less near an end that stands nearer."""
        full = self.wanted + MARGIN + places.more
        out = np.repeat(full[None], len(places.u), axis=0)
        for held, way in zip(self._at_ends, (places.u, 1 - places.u), strict=True):
            low = np.flatnonzero(held < full)
            share = np.clip(way / RAMP, 0, 1)[:, None]
            out[:, low] = np.minimum(out[:, low], held[low] + share * (full - held)[low])
        return out


class ClearSearch:
    """Searches of one cell; what measures distances is kept from one to the next."""

    def __init__(self, cell: Cell, joints: tuple[str, ...]) -> None:
        self.cell, self.joints, self.near = cell, joints, Near(cell.bodies)

    def begin(self, level: Level, task: Task, first: Curve, trust: float = TRUST) -> Descent:
        """A search from `first`; its first round goes at most `trust` [rad]."""
        first = replace(first, points=np.clip(first.points, *box_of(task.limits, level.shape.joints)))
        return Descent(_Rounds(self, level, task), first, all_rows(level.shape, task.limits), task, trust)

    def run(
        self, level: Level, task: Task, first: Curve, stopped: Callable[[], bool], rounds: int = ROUNDS,
        enough: float = -np.inf, trust: float = TRUST,
    ) -> Cleared:  # fmt: skip
        """The cheapest proven curve that at most so many rounds from `first` come to, or the first that is `enough`."""
        descent = self.begin(level, task, first, trust)
        descent.go(stopped, rounds, enough)
        descent.finish(stopped)
        return descent.found

    def polished(self, level: Level, task: Task, outcome: Outcome) -> Cleared:
        """A proven outcome solved again nearby, under limits that have changed a little."""
        rounds = _Rounds(self, level, task)
        rounds.one(outcome.curve, outcome.rows, LEAST, FINE)
        return rounds.found

    def proof(self, curve: Curve, wanted: np.ndarray) -> Clearance:
        """Does the trajectory of a curve keep clear?"""
        t = trajectory_of(curve, self.joints)
        return self.cell.prove(t.time, t.position, t.velocity, t.acceleration, wanted)


class Descent:
    """A search from one curve, that can be left and gone on with; `found` is the cheapest proven curve."""

    def __init__(self, work: _Rounds, first: Curve, rows: np.ndarray, task: Task, trust: float) -> None:
        self._work, self._task, self.found = work, task, work.found
        self._curve, self._rows = first, rows
        self._trust, self._turn, self._quiet = trust, 0, 0
        self._known: Multipliers | None = None
        self._broken, self._moved = np.inf, np.inf

    @property
    def cost(self) -> float:
        """What the path can change of the cost of the best that is proven; infinite where nothing is."""
        return np.inf if self.found.best is None else self._task.cost(self.found.best)

    def go(self, stopped: Callable[[], bool], rounds: int = ROUNDS, enough: float = -np.inf) -> None:
        """Up to `rounds` rounds in all, fewer where no more is to be won, or the cost is `enough`."""
        while self._turn < rounds and self._quiet < 2 and self.cost > enough and not stopped():
            before = self.cost
            far = min(self._trust, AGAIN * self._moved)
            outcome, proof = self._work.one(self._curve, self._rows, self._trust, LOOSE, self._known, far)
            self._moved = float(np.abs(outcome.curve.points - self._curve.points).max())
            self._curve, self._rows, self._turn = outcome.curve, outcome.rows, self._turn + 1
            self._known = outcome.multipliers
            share = {"share": 0.6 + 0.35 * self._turn / rounds}
            log.info(
                "round %d of at most %d: %s, cost %.6g", self._turn, rounds, proof.verdict, outcome.cost, extra=share
            )
            if proof.proven:
                self._trust *= GROWTH
                cost = self._task.cost(outcome)
                small = abs(before - cost) < DONE * max(cost, 1e-9)
                self._quiet = self._quiet + 1 if small else 0
            else:
                self._work.places.learn(proof, outcome.curve.duration)
                self._trust = self._trust if self._turn <= BOLD else max(self._trust * SHRINK, LEAST)
                self._quiet = 0
            if outcome.broken > max(HOPELESS, LESS * self._broken):  # it is stuck inside of something
                break
            self._broken = outcome.broken

    def finish(self, stopped: Callable[[], bool]) -> None:
        """Polish the best, and go towards what is cheaper as far as that can be proven."""
        if self.found.best is not None and not stopped():
            self._work.one(self.found.best.curve, self.found.best.rows, LEAST, FINE)
            self._work.part_way()


class _Rounds:
    """Rounds of one task: what pairs keep, where they are looked at, and the best that was found."""

    def __init__(self, search: ClearSearch, level: Level, task: Task) -> None:
        self._search, self._level, self._task = search, level, task
        self._kept = Margins(search.cell, np.stack([task.ends.start, task.ends.goal]))
        self._wanted = self._kept.wanted
        self.places = Places.evenly(len(self._wanted))
        self.found = Cleared()
        self.near: Outcome | None = None  # the cheapest that could not be proven

    def one(
        self, start: Curve, rows: np.ndarray, reach: float, tolerance: float, known: Multipliers | None = None,
        far: float = LEAST,
    ) -> tuple[Outcome, Clearance]:  # fmt: skip
        """Solve from `start`, at most `reach` away from it, and have it proven; `far` [rad] is what is expected."""
        outcome, proof = self._solved(start, rows, reach, tolerance, known, far)
        if proof.proven and self._excess(outcome) > FEASIBLE:  # a limit has come to bind that had no row
            outcome, proof = self._solved(outcome.curve, outcome.rows, LEAST, tolerance, outcome.multipliers, LEAST)
        if proof.proven and self._excess(outcome) <= FEASIBLE:
            self.found.take(outcome)
        elif self.near is None or outcome.cost < self.near.cost:
            self.near = outcome
        return outcome, proof

    def _solved(
        self, start: Curve, rows: np.ndarray, reach: float, tolerance: float, known: Multipliers | None, far: float
    ) -> tuple[Outcome, Clearance]:
        places, task, near = self.places, self._task, min(REACH, MARGIN + ARM * far)
        held = ClearanceRows(self._search.near, places.u, self._kept.at(places), near, places.must)
        outcome = self._level.solve(
            start, task.ends, (*task.limits, held), task.parameters, task.durations,
            tolerance=tolerance, rows=rows, offset=task.offset, rounds=1, reach=reach, multipliers=known,
            options={"max_iter": ITERATIONS, "mu_init": 1e-2},
        )  # fmt: skip
        self.found.iterations += outcome.iterations
        return outcome, self._search.proof(outcome.curve, self._wanted)

    def part_way(self) -> None:
        """Keep what lies farthest on the way from the best to the cheapest that is not proven, and is proven."""
        best, outcome, task = self.found.best, self.near, self._task
        if (
            best is None
            or outcome is None
            or task.cost(outcome) > (1 - CHEAPER) * task.cost(best)
            or outcome.broken > HOPELESS
        ):
            return
        for share in SHARES:
            curve = between(best.curve, outcome.curve, share)
            cost, excess = self._level.excess(curve, task.parameters, task.limits)
            if cost >= best.cost or excess > FEASIBLE or not self._search.proof(curve, self._wanted).proven:
                continue
            self.found.take(replace(outcome, curve=curve, cost=cost, broken=excess))
            return

    def _excess(self, outcome: Outcome) -> float:
        """The worst excess over a limit, planes aside."""
        return self._level.excess(outcome.curve, self._task.parameters, self._task.limits)[1]
