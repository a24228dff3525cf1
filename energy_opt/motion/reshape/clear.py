"""Reshaping that keeps clear of the arm's own body and of its cell: SQP with planes renewed in each linearisation.

At places along the curve, planes keep every two bodies apart that may come near in a step (see `sqp`). After
convergence, many more places of the curve are checked: those where bodies are too near are added. Only a curve that is
clear at all of these is proven; if the proof fails, the search continues with more distance.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from energy_opt.cell.cell import Cell, Clearance
from energy_opt.cell.planes import Near
from energy_opt.motion.limits.clearance import ClearanceConstraints
from energy_opt.motion.reshape.curve import Curve, Outcome
from energy_opt.motion.reshape.model import Model
from energy_opt.motion.reshape.search import trajectory_of
from energy_opt.motion.reshape.sqp import Descent, begin, descend
from energy_opt.motion.reshape.task import FEASIBLE, SLACK, Level, Task

log = logging.getLogger(__name__)
PLACES, DENSE = 60, 240  # places along a curve, evenly in time, at which pairs are looked at; and before a proof
CLOSE = 0.05  # share of the places' spacing: least distance between places, for a corner that is passed fast
REACH = 0.036  # [m] pairs get constraints that are nearer than this and what they keep
MARGIN = 0.002  # [m] constraints keep this much more than is to be proven
BESIDE = 0.001  # [m] checks of a curve's clearance measure pairs that are nearer than this and what they keep
# [m] the dense places keep this much more than is to be proven; of a pair that is nearer at an end, at most this share
# of what it keeps there
HAIR, HALF = 2e-4, 0.5
MORE, MOST = 0.0007, 0.003  # [m] added to the margin after a failed proof, and the most in all
RAMP = 0.15  # share of the move over which the margin grows from a nearer end to the full one
END_SHARE = 0.8  # share of an end's distance beyond the required clearance that is kept as its margin
TRUST = 0.1  # [rad, m] first step from a curve that is free
ROUNDS, AGAIN = 10, 15  # most descents from a curve; iterations of each but the first
GIVE = 0.1  # share of a bound: smaller excesses are accepted in the first descent
NEARBY = 0.06  # [rad, m] first step of each descent but the first
FINE = 2e-4  # relative: such a descent ends if it can save less
TINY = 0.002  # [rad, m] a first descent that ends with a smaller trust region may not have converged
MET = 1e-7  # [rad] allowed error of via points: a tenth of that of poses
TRIAL, ROUGH = 5, 3e-3  # iterations of a trial, and the relative change of cost at which it ends
SOON, STUCK = 2, 5.0  # it ends after so many iterations if the sum of its violations is larger [0.1 m]
RESOLVED, EXACT = 15, 1e-6  # iterations after limits changed slightly, and the accepted excess over them


@dataclass
class Places:
    """The places u (K,) of the constraints, and the extra distance `more` (P,) [m] of each pair of bodies."""

    u: np.ndarray
    more: np.ndarray

    @classmethod
    def evenly(cls, pairs: int) -> Places:
        """The usual places, of a cell with that many pairs of bodies."""
        return cls((np.arange(PLACES) + 0.5) / PLACES, np.zeros(pairs))

    def learn(self, proof: Clearance, duration: float) -> None:
        """Add the places where a proof failed, and keep more distance there."""
        self.look(np.array([touch.time / duration for touch in proof.touches]))
        self.keep(np.array([touch.pair for touch in proof.touches], dtype=int))

    def look(self, at: np.ndarray) -> bool:
        """Add places; True if any of them is new."""
        new = [u for u in np.unique(at) if np.abs(self.u - u).min() > CLOSE / PLACES]
        self.u = np.sort(np.append(self.u, new))
        return bool(new)

    def keep(self, pairs: np.ndarray) -> None:
        """Keep more distance between these pairs."""
        pairs = np.unique(pairs)
        self.more[pairs] = np.minimum(self.more[pairs] + MORE, MOST)


class Margins:
    """The distances that pairs of bodies keep along a move between two poses `ends` (2, n).

    They count between convex pieces, as `near` measures them, which are up to some millimetres nearer than the bodies.

    Attributes:
        wanted: [m] (P,) what is to be proven.
        tight: (P,) whether a pair is so near at an end that it cannot keep the full margin there.
    """

    def __init__(self, cell: Cell, ends: np.ndarray, near: Near) -> None:
        self.wanted, reach = cell.wanted(ends), 2 * (cell.asked + MARGIN + MOST)
        self._at_ends = np.full((2, len(self.wanted)), np.inf)  # [m] distances that each pair can keep at the ends
        for held, q in zip(self._at_ends, ends, strict=True):
            pieces = np.full(len(self.wanted), np.inf)
            _, number, measured, _, _ = near.measured(np.zeros(1), q[None], reach)
            np.minimum.at(pieces, near.pair[number], measured)
            for pair, distance in cell.distances(q, reach):
                held[pair] = min(pieces[pair], distance) - (1 - END_SHARE) * (distance - self.wanted[pair])
        room = self._at_ends.min(axis=0) - self.wanted
        self._dense, self.tight = self.wanted + np.clip(HALF * room, 0.0, HAIR), room < MARGIN

    def at(self, places: Places) -> np.ndarray:
        """The margin (K, P) [m] of every pair: the full one, but less near an end where bodies are nearer."""
        full = self.wanted + MARGIN + places.more
        out = np.repeat(full[None], len(places.u), axis=0)
        for held, from_end in zip(self._at_ends, (places.u, 1 - places.u), strict=True):
            low = np.flatnonzero(held < full)
            share = np.clip(from_end / RAMP, 0, 1)[:, None]
            out[:, low] = np.minimum(out[:, low], held[low] + share * (full - held)[low])
        return out

    def dense(self, u: np.ndarray, pair: np.ndarray) -> np.ndarray:
        """What pairs of bodies (M,) keep [m] at places u (M,) before a proof: less than `at`.

        A move leaves rest with the second power of time, or the third if its acceleration is 0 there, so its first
        places are almost as near as its end. This bound grows as slowly; with a linear one, searches fail.
        """
        out = self._dense[pair]
        for held, from_end in zip(self._at_ends, (u, 1 - u), strict=True):
            low = np.flatnonzero(held[pair] < out)
            at_end, share = held[pair[low]], np.clip(from_end[low] / RAMP, 0, 1) ** 3
            out[low] = np.minimum(out[low], at_end + share * (self.wanted[pair[low]] + MARGIN - at_end))
        return out


class ClearSearch:
    """Searches of one task in a cell.

    Args:
        cell: the bodies. joints: names of the arm's joints.
        level, task: the problem, of the answer's shape.
        scale: factor of costs that brings them to order one.
        stopped: True ends a search with what it has.
    """

    def __init__(
        self, cell: Cell, joints: tuple[str, ...], level: Level, task: Task, scale: float, stopped: Callable[[], bool]
    ) -> None:
        self.cell, self.joints, self.level, self.task, self.stopped = cell, joints, level, task, stopped
        ends = np.stack([task.ends.start, task.ends.goal])
        self.near, self._many = (Near(cell.bodies, ends) for _ in range(2))
        self.margins = Margins(cell, ends, self.near)
        self.wanted = self.margins.wanted
        self.scale = scale
        self._model = task.model(level).scaled(scale)
        self.iterations = 0

    @classmethod
    def scaled_by(
        cls, curve: Curve, cell: Cell, joints: tuple[str, ...], level: Level, task: Task, stopped: Callable[[], bool]
    ) -> Self:
        """A search whose costs are scaled by that of a curve."""
        return cls(cell, joints, level, task, 1 / max(abs(task.path_cost(level, curve)), 1e-6), stopped)

    def proof(self, curve: Curve) -> Clearance:
        """Does the trajectory of a curve keep clear?"""
        t = trajectory_of(curve, self.joints)
        return self.cell.prove(t.time, t.position, t.velocity, t.acceleration, self.wanted)

    def gap(self, curve: Curve) -> float:
        """The least distance beyond the margins at the usual places [m]."""
        places = Places.evenly(len(self.wanted))
        margin = self.margins.at(places)
        reach = BESIDE + float(margin.max(initial=0.0))
        k, number, distance, _, _ = self.near.measured(places.u, curve.position(places.u), reach)
        return float((distance - margin[k, self.near.pair[number]]).min(initial=BESIDE))

    def trial(self, curve: Curve, trust: float) -> Descent:
        """A few iterations from a curve, at the usual places; fewer if bodies do not come apart in the first ones.

        Args:
            trust: [rad, m] largest move of control points in the first step.
        """
        model, now = self._started(curve, trust)

        def ended() -> bool:
            return self.stopped() or (now.iterations >= SOON and model.broken(now.point, GIVE, SLACK) > STUCK)

        descend(model, now, TRIAL, trust, tolerance=ROUGH, give=GIVE, slack=SLACK, stopped=ended)
        self.iterations += now.iterations
        return now

    def descent(self, curve: Curve, iterations: int, trust: float, tolerance: float) -> Descent:
        """Some iterations from a curve, at the usual places, with hardly any excess over limits; nothing is proven.

        Args:
            iterations: most. trust: [rad, m] largest move in the first step. tolerance: relative; see `sqp.descend`.
        """
        model, now = self._started(curve, trust)
        descend(model, now, iterations, trust, tolerance=tolerance, give=EXACT, stopped=self.stopped)
        self.iterations += now.iterations
        return now

    def _started(self, curve: Curve, trust: float) -> tuple[Model, Descent]:
        model = self._with(Places.evenly(len(self.wanted)))
        return model, begin(model.at_curve(curve, trust))

    def merit(self, found: Descent) -> float:
        """Scaled cost plus a penalty on violations."""
        return found.point.cost + 10 * self._with(Places.evenly(len(self.wanted))).broken(found.point, GIVE, SLACK)

    def curve_of(self, found: Descent) -> Curve:
        """The curve of a search's present point."""
        point = found.point
        return Curve(self.level.shape, point.points, point.duration, point.via_u)

    def finish(
        self, curve: Curve, iterations: int, trust: float, tolerance: float, known: float = np.inf, give: float = GIVE
    ) -> Outcome | None:  # fmt: skip
        """The proven curve that a search from `curve` leads to; None if it fails.

        It counts as converged if the first descent did, with steps that are not tiny. The other descents only repair
        what is too near.

        Args:
            iterations, trust, tolerance: of the first descent, see `sqp.descend`.
            known: scaled cost of a proven curve: a search that finds no less is given up.
            give: share of a bound by which limits may be exceeded during the first descent.
        """
        places = Places.evenly(len(self.wanted))
        dense = (np.arange(DENSE) + 0.5) / DENSE
        now: Descent | None = None
        again, settled, slack, pairs = FINE, False, SLACK, np.zeros(0, dtype=int)
        for turn in range(ROUNDS):
            model, first = self._with(places), now is None
            point = model.at_curve(curve, trust if first else NEARBY)
            now = begin(point) if now is None else replace(now, point=point, damping=0.0)
            if first:
                descend(
                    model, now, iterations, trust, tolerance=tolerance, give=give, slack=SLACK, stopped=self.stopped
                )
                settled = now.converged and now.trust > TINY
            else:
                nearby = float(np.clip(4 * now.trust, NEARBY / 16, NEARBY))
                descend(model, now, AGAIN, nearby, tolerance=again, slack=slack, stopped=self.stopped)
            # give up if it costs more than what is known, or is caught between bodies
            if now.point.cost + 10 * model.broken(now.point, GIVE, SLACK) > known:
                break
            # look densely before the proof, which takes longer: places where bodies are too near join the constraints
            curve = self.curve_of(now)
            k, number, distance, _, _ = self._many.measured(dense, curve.position(dense), self.cell.asked + HAIR)
            bad = distance < self.margins.dense(dense[k], self.near.pair[number])
            if bad.any():
                pairs = self.near.pair[number[bad]]
                if not places.look(dense[k[bad]]) or turn > 1:
                    places.keep(pairs)
            elif model.excess(now.point) > FEASIBLE / 10 or np.abs(now.point.via).max(initial=0.0) > MET:
                again = EXACT  # take steps that save little, too
            else:
                proof = self.proof(curve)
                if proof.proven:
                    self.iterations += now.iterations
                    return model.outcome(now.point, now.iterations, settled)
                places.learn(proof, curve.duration)
                pairs = np.array([touch.pair for touch in proof.touches], dtype=int)
            if turn and self.margins.tight[pairs].any():
                slack = 0.0  # near that end, the margin is smaller than the excess that is allowed elsewhere
            if self.stopped():
                break
        self.iterations += now.iterations if now is not None else 0
        return None

    def under(self, task: Task, outcome: Outcome) -> Outcome | None:
        """An outcome solved again nearby, under limits that changed slightly; None if it is not proven."""
        again = ClearSearch(self.cell, self.joints, self.level, task, self.scale, self.stopped)
        found = again.finish(outcome.curve, RESOLVED, NEARBY / 2, FINE, give=EXACT)
        self.iterations += again.iterations
        return found

    def _with(self, places: Places) -> Model:
        """The model with clearance constraints at these places."""
        return self._model.keeping(ClearanceConstraints(self.near, places.u, self.margins.at(places), REACH))
