"""Moves whose start or goal is a set: a pose of the tool, or any of several positions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from energy_opt.front.answer import Answer
from energy_opt.motion import Settings, Trajectory
from energy_opt.poses.chosen import Chosen
from energy_opt.poses.judge import pose_document
from energy_opt.poses.pose import Pose


def _passing(trajectory: Trajectory, q: np.ndarray) -> np.ndarray:
    """Where a motion is nearest to positions q (n,)."""
    from scipy.optimize import minimize_scalar

    time = trajectory.time
    k = int(np.argmin(np.linalg.norm(trajectory.position - q, axis=1)))
    ends = time[max(k - 1, 0)], time[min(k + 1, len(time) - 1)]

    def miss(t: float) -> float:
        return float(np.linalg.norm(trajectory.sample(np.array([t]))[0][0] - q))

    found = minimize_scalar(miss, bounds=ends, method="bounded", options={"xatol": 1e-12})
    return np.asarray(trajectory.sample(np.array([found.x]))[0][0])


def with_goals(result: Answer, chosen: Chosen, poses: dict[str, Pose], settings: Settings) -> Answer:
    """The answer with the goals that were looked at, and by what its ends miss their poses."""
    positions = result.trajectory.position
    at = {"start": positions[0], "goal": positions[-1]}
    for k, q in enumerate(chosen.move.via, start=1):
        at[f"via {k}"] = _passing(result.trajectory, q)
    said = pose_document(result.arm, settings.tool, poses, at)
    status = result.status
    if not all(end["valid"] for end in said.values()):
        status = "not_converged"
    return replace(result, status=status, goals={**chosen.document(), "poses": said})
