"""Where a move begins and ends, where that is not one position each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from energy_opt.poses.pose import Pose


@dataclass(frozen=True)
class Ends:
    """A start pose, where there is one, and goals of which any will do: poses of the tool or joint positions (n,)."""

    start: Pose | None
    goals: tuple[Pose | np.ndarray, ...]

    @property
    def poses(self) -> dict[str, Pose]:
        """The poses that the ends of a trajectory are judged against."""
        out = {} if self.start is None else {"start": self.start}
        if len(self.goals) == 1 and isinstance(self.goals[0], Pose):
            out["goal"] = self.goals[0]
        return out

    def asked(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """A result's request with these ends: which goal it will be is not asked, it is answered."""
        goals = [goal.document() if isinstance(goal, Pose) else goal.tolist() for goal in self.goals]
        out = {**request, "goal": None, "goals": goals}
        return out if self.start is None else out | {"start": None, "start_pose": self.start.document()}
