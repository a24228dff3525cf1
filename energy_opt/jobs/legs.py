"""A job's steps as legs between rests: steps that are passed without stopping are one motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.jobs.file import Step
from energy_opt.jobs.reader import SAME
from energy_opt.motion.move import Move
from energy_opt.motion.path import JointPath, straight, through


@dataclass(frozen=True)
class Leg:
    """A motion from rest to rest: one step, or several that are joined through their ends.

    Attributes:
        steps: their places in the job.
        points: (K, n) [rad] the start, what is passed, and the end.
        way: the first path, where that is neither the straight line nor the curve through what is passed.
        begins: where the first path comes from, as `first_path.source` of a result says it.
    """

    steps: tuple[int, ...]
    names: tuple[str, ...]
    points: np.ndarray
    mode: str
    least: float
    most: float
    step: Step
    way: JointPath | None = None
    begins: str = "straight"

    @property
    def name(self) -> str:
        """For messages."""
        return " and ".join(self.names)

    @property
    def moves(self) -> bool:
        """False where it ends where it begins and passes nothing."""
        return bool(np.abs(self.points - self.points[0]).max() > SAME)

    @property
    def path(self) -> JointPath:
        """The first path: the straight line, the smooth curve through what is passed, or a way around."""
        if self.way is not None:
            return self.way
        return through(self.points) if len(self.points) > 2 else straight(self.points[0], self.points[-1])

    def move(self, duration: float | None) -> Move:
        """The leg as a move of exactly so many seconds, from ends and via points alone; None: of any duration."""
        start, goal = self.points[0], self.points[-1]
        if self.mode == "retime":
            return Move(start, goal, "retime", duration, path=through(self.points) if len(self.points) > 2 else None)
        return Move(start, goal, "reshape", duration, via=tuple(self.points[1:-1]))


def legs_of(steps: Sequence[Step]) -> list[Leg]:
    """The motions of a job in order; a joined leg is reshaped where one of its steps is."""
    out: list[Leg] = []
    part: list[int] = []
    for k, step in enumerate(steps):
        if step.wait is not None:
            continue
        part.append(k)
        if step.stop:
            joined = [steps[i] for i in part]
            out.append(
                Leg(
                    tuple(part),
                    tuple(s.name for s in joined),
                    np.vstack([joined[0].start, *(s.goal for s in joined)]),
                    "reshape" if any(s.mode == "reshape" for s in joined) else "retime",
                    sum(s.least for s in joined),
                    sum(s.most for s in joined),
                    step,
                )
            )
            part = []
    return out
