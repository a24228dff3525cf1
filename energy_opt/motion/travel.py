"""How far joints go, beside how far they need to."""

from __future__ import annotations

import numpy as np

from energy_opt.motion.trajectory import Trajectory

DETOUR = 1.5  # times what start to goal needs, from which a joint's travel is named
SMALLEST = 1e-3  # [rad, m] less than this further is no detour


def detours(trajectory: Trajectory) -> list[dict[str, object]]:
    """The joints that go more than 1.5 times as far as from their start to their goal: joint, path, straight [rad, m].

    A joint's path is that of its quintic between samples, read at ten places of each.
    """
    q = trajectory.sample_denser(10)[0]
    path, straight = np.abs(np.diff(q, axis=0)).sum(axis=0), np.abs(q[-1] - q[0])
    return [
        {"joint": joint, "path": float(path[j]), "straight": float(straight[j])}
        for j, joint in enumerate(trajectory.joints)
        if path[j] > DETOUR * straight[j] + SMALLEST
    ]
