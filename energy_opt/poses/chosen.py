"""The result of a choice among goals: the cheapest motion, and all goals considered.

Also here: the optimum of curve and poses together, near a motion, within what the poses leave free.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.motion import Move, Result, Trajectory
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.reshape.open import Open
from energy_opt.poses.distance import keeps
from energy_opt.poses.freedom import WIDE, Bent, PosedGoal, has_freedom, inside, used
from energy_opt.poses.inverse import ToolKinematics
from energy_opt.poses.pose import Pose


@dataclass(frozen=True)
class Candidate:
    """A joint goal and its result.

    Attributes:
        goal: (n,) [rad, m]; estimate: [J] of the straight move; energy: [J] as solved, None if not solved.
        status: as in results, such as "solved"; "screened" with the energy of a sketch, which ignores
            bodies; "looked_at", "not_looked_at", "colliding", "near", "too_fast" or "infeasible".
        pose: the pose that it reaches; None if it was given by its joints.
        start, via: (n,) start and via points of the move, if these were optimized with the goal.
        detour: [J] assumed cost of going around what its sketch touches; 0 if it touches nothing.
    """

    goal: np.ndarray
    estimate: float
    energy: float | None = None
    status: str = "looked_at"
    pose: Pose | None = None
    start: np.ndarray | None = None
    via: tuple[np.ndarray, ...] = ()
    detour: float = 0.0

    def moved(self, move: Move) -> Move:
        """The move that ends there."""
        if self.start is None:
            return replace(move, goal=self.goal)
        return replace(move, start=self.start, goal=self.goal, via=self.via)

    def document(self) -> dict[str, object]:
        """Its record in result.json; the energy of a sketch counts as an estimate."""
        rough = self.status == "screened"
        estimate, energy = (self.energy, None) if rough else (self.estimate, self.energy)
        return {"goal": self.goal.tolist(), "estimate": estimate, "energy": energy, "status": self.status}


Sketched = tuple[Candidate, Trajectory]


def cost_of(item: tuple[Candidate, *tuple[object, ...]]) -> float:
    """The energy [J] of a goal that was solved or sketched, with its detour; infinite if it was neither."""
    return np.inf if item[0].energy is None else item[0].energy + item[0].detour


@dataclass(frozen=True)
class Chosen:
    """The cheapest goal and its motion.

    Attributes:
        move: with that goal; result: its motion.
        candidates: the answer's first, then by energy and estimate.
        nearest: the goal nearest to the start, "not_looked_at" if the search ended before; nearest_result: its motion
            at the answer's duration, None without one.
        solves: number of moves solved in full; screened: number of moves sketched.
        warnings: which goals were left out, and why.
    """

    move: Move
    result: Result
    candidates: tuple[Candidate, ...]
    nearest: Candidate
    nearest_result: Result | None
    solves: int
    screened: int
    warnings: tuple[str, ...] = ()

    def document(self) -> dict[str, object]:
        """`candidates` and `nearest` of result.json; energies in J, those of several models in the mean."""
        near, best, cost = self.nearest_result, self.result, self.nearest.energy
        saved = None if cost is None else cost - (self.candidates[0].energy or 0.0)
        return {
            "candidates": [candidate.document() for candidate in self.candidates],
            "nearest": {
                "goal": self.nearest.goal.tolist(),
                "status": self.nearest.status,
                "energy": cost,
                "loss": None if near is None else near.energy.loss,
                "duration": None if near is None else near.trajectory.duration,
                "saving_joules": saved,
                "saving_loss_percent": None
                if near is None or near.energy.loss <= 0
                else 100 * (1 - best.energy.loss / near.energy.loss),
            },
            "solves": {"full": self.solves, "screened": self.screened},
        }


Settle = Callable[[Move, Trajectory, Open, bool], tuple[Trajectory, tuple[np.ndarray, ...]]]


@dataclass(frozen=True, eq=False)
class Settling:
    """Moves motions to the nearest optimum of curve, start, via points and goal.

    Attributes:
        settle: moves a motion to the nearest optimum of curve and what is open, clear of bodies if so asked; it gives
            the positions at via points too.
        start, via: poses that the move begins at and passes; None where it begins at one position.
    """

    tool: ToolKinematics
    scorers: Sequence[Scorer]
    cell: Cell | None
    settle: Settle
    start: Pose | None
    via: Sequence[Pose]

    def __call__(
        self, move: Move, goal: Candidate, motion: Trajectory, clear: bool
    ) -> list[tuple[Candidate, Trajectory]] | None:
        """Optima near a motion whose ends keep the clearance; None if its poses leave no freedom.

        The goal's tolerance is used up in the direction in which the motion, bent to other ends, costs less.
        """
        pose, at = goal.pose, goal.moved(move)
        if not (self._open(at, pose).any or (pose is not None and max(pose.tolerance) > WIDE)):
            return None
        wanted, before = pose, (at.start, *at.via, at.goal)
        found: list[tuple[Candidate, Trajectory]] = []
        for shifted in range(2):
            open_ = self._open(at, pose)
            if open_.any or shifted:
                motion, via = self.settle(at, motion, open_, clear)
                at = replace(at, start=motion.position[0], goal=motion.position[-1], via=via)
            reached = wanted is None or inside(self.tool, wanted, at.goal)
            if reached and all(map(partial(keeps, self.cell), (at.start, *at.via, at.goal), before)):
                found.append((replace(goal, goal=at.goal, start=at.start, via=at.via), motion))
            bent = partial(Bent(self.scorers, motion, move.duration is not None), None)
            moved = None if shifted or pose is None else used(self.tool, pose, at.goal, bent)
            if moved is None:
                break
            pose, at = moved[0], replace(at, goal=moved[1])
        return found

    def _open(self, move: Move, goal: Pose | None) -> Open:
        """The freedom that a move's poses leave."""

        def surface(pose: Pose | None, q: np.ndarray) -> PosedGoal | None:
            if pose is None or not has_freedom(self.tool, pose):
                return None
            found = PosedGoal(self.tool, pose, q, self._work)
            return found if found.count else None

        via = tuple(map(surface, self.via, move.via))
        return Open(surface(self.start, move.start), surface(goal, move.goal), via)

    def _work(self, q: np.ndarray) -> np.ndarray:
        """Potential energy (K,) [J] at positions (K, n), the mean over the models."""
        return np.asarray(np.mean([scorer.potential(q) for scorer in self.scorers], axis=0))
