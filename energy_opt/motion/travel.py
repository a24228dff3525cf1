"""Distances that joints travel, compared with those they need."""

from __future__ import annotations

import numpy as np

from energy_opt.motion.trajectory import Trajectory

DETOUR = 1.5  # factor of the distance from start to goal above which a joint's travel is reported
SMALLEST = 0.02  # [rad, m] about one degree: a smaller excess is no detour


def detours(trajectory: Trajectory) -> list[dict[str, object]]:
    """The joints that travel more than 1.5 times their distance from start to goal: joint, path, straight [rad, m].

    A joint's path is that of its quintics, read at ten places between samples.
    """
    q = trajectory.sample_denser(10)[0]
    path, straight = np.abs(np.diff(q, axis=0)).sum(axis=0), np.abs(q[-1] - q[0]).round(9)
    return [
        {"joint": joint, "path": float(path[j]), "straight": float(straight[j])}
        for j, joint in enumerate(trajectory.joints)
        if path[j] > DETOUR * straight[j] + SMALLEST
    ]
