"""Which joint an arm's losses come from."""

from __future__ import annotations

import numpy as np

from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.trajectory import Trajectory

APART = 0.01  # relative difference beyond which what joints lose one by one is not what they lose together


def loss_by_joint(scorer: Scorer, trajectory: Trajectory) -> dict[str, np.ndarray]:
    """Energy (n,) [J] that each effect takes at each joint.

    The law is evaluated once for each joint, with the speed, acceleration and torque of that joint alone. Effects of
    the whole arm (overhead, supply, a store on the bus) do not add up so, and are left out.
    """
    dense = scorer.dense(trajectory)
    names = list(scorer.parts)
    spent = np.zeros((scorer.robot.n, len(names)))
    for j in range(scorer.robot.n):
        spent[j] = dense.weight @ scorer.alone(dense, j)
    together = dense.weight @ dense.parts
    standing = {e.name for e in scorer.model.effects if e.overhead or e.stores} | {"mechanical"}
    out = {}
    for k, name in enumerate(names):
        whole = max(abs(float(together[k])), 1e-9)
        adds_up = abs(float(spent[:, k].sum() - together[k])) < APART * whole
        if name not in standing and adds_up and np.abs(spent[:, k]).max() > 1e-6:
            out[name] = spent[:, k]
    return out
