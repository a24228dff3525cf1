"""The result of a choice among goals: the cheapest motion, and all goals considered."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from energy_opt.motion.move import Move
from energy_opt.motion.result import Result
from energy_opt.poses.pose import Pose


@dataclass(frozen=True)
class Candidate:
    """A joint goal and its result.

    Attributes:
        goal: (n,) [rad, m]; estimate: [J] of the straight move; energy: [J] as solved, None if not solved.
        status: as in results, such as "solved"; "screened" with the energy of a sketch, which ignores
            bodies; "looked_at", "not_looked_at", "colliding", "too_fast" or "infeasible".
        pose: the pose that it reaches; None if it was given by its joints.
        start, via: (n,) start and via points of the move, if these were optimized with the goal.
    """

    goal: np.ndarray
    estimate: float
    energy: float | None = None
    status: str = "looked_at"
    pose: Pose | None = None
    start: np.ndarray | None = None
    via: tuple[np.ndarray, ...] = ()

    def moved(self, move: Move) -> Move:
        """The move that ends there."""
        if self.start is None:
            return replace(move, goal=self.goal)
        return replace(move, start=self.start, goal=self.goal, via=self.via)

    def document(self) -> dict[str, object]:
        """Its record in result.json; the energy of a sketch counts as an estimate."""
        rough = self.status == "screened"
        estimate, energy = (self.energy, None) if rough else (self.estimate, self.energy)
        return {"goal": self.goal, "estimate": estimate, "energy": energy, "status": self.status}


@dataclass(frozen=True)
class Chosen:
    """The cheapest goal and its motion.

    Attributes:
        move: with that goal; result: its motion.
        candidates: the answer's first, then by energy and estimate.
        nearest: the goal nearest to the start; nearest_result: its motion at the answer's duration, None without
            one.
        solves: number of moves solved in full; screened: number of moves sketched.
    """

    move: Move
    result: Result
    candidates: tuple[Candidate, ...]
    nearest: Candidate
    nearest_result: Result | None
    solves: int
    screened: int

    def document(self) -> dict[str, object]:
        """`candidates` and `nearest` of result.json; energies in J, those of several models in the mean."""
        near, best, cost = self.nearest_result, self.result, self.nearest.energy
        saved = None if cost is None else cost - (self.candidates[0].energy or 0.0)
        return {
            "candidates": [candidate.document() for candidate in self.candidates],
            "nearest": {
                "goal": self.nearest.goal,
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
