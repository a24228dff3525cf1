"""Checks of limits before anything is solved: places of a path that no timing can bring inside them.

Otherwise a solver would find nothing, and could not say why.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil

import numpy as np

from energy_opt.errors import Infeasible
from energy_opt.motion.limits.base import Limit
from energy_opt.motion.limits.own import Power
from energy_opt.motion.move import LONGEST, Move
from energy_opt.motion.path import straight
from energy_opt.motion.path_dynamics import PathDynamics
from energy_opt.power import PowerModel
from energy_opt.robot import Robot

ALLOWED = 1e-9  # share of a bound, or of a range
HELD = 1e-6  # share of a bound: excess that the certificate accepts


def check_path(limits: Sequence[Limit], d: PathDynamics) -> None:
    """Check what no timing can repair: positions outside the limits, and the torque to hold the arm.

    Raises:
        Infeasible: names joint, limit, path position and excess.
    """
    for limit in limits:
        fixed = limit.fixed(d)
        if fixed is None:
            continue
        k, j = np.unravel_index(int(np.argmax(fixed.excess)), fixed.excess.shape)
        if fixed.excess[k, j] <= ALLOWED:
            continue
        s, joint = float(d.s[k]), limit.where(d.robot.joints, int(j))
        place = {0.0: "at the start", 1.0: "at the goal"}.get(s, f"at path position {s:.3f}")
        raise Infeasible(
            f"{joint}: {fixed.text(int(k), int(j))} {place}",
            joint=joint,
            limit=limit.name,
            position=s,
            excess=float(fixed.excess[k, j]),
        )


def check_pose(limits: Sequence[Limit], robot: Robot, model: PowerModel, q: np.ndarray, what: str, rest: bool) -> None:
    """Check a pose (n,) of a move: inside the limits, and held within them if the arm is at `rest`.

    Args:
        what: its name in messages, such as "start"; an error states the path position of "start" and "goal".

    Raises:
        Infeasible: names `what`, the joint, limit and excess.
    """
    d = PathDynamics(robot, model, straight(q, q), np.zeros(1))
    for limit in limits:
        fixed = limit.fixed(d)
        if fixed is None or (fixed.holding and not rest):
            continue
        j = int(np.argmax(fixed.excess[0]))
        if fixed.excess[0, j] > (HELD if fixed.holding else ALLOWED):
            joint = limit.where(robot.joints, j)
            said = f"{joint}: {fixed.text(0, j)}"
            if isinstance(limit, Power):
                needed = limit.scale[j] * (1 + fixed.excess[0, j])
                said = (
                    f"--max-power {limit.scale[j]:g} is too small: the arm at rest needs {needed:.4g} W "
                    f"({model.constant_power(robot.n):.4g} W of it is standby); give at least {ceil(needed)} W"
                )
            elif fixed.holding:
                said += "; a lighter payload or another posture would work"
            raise Infeasible(
                f"{what}: {said}",
                joint=joint,
                limit=limit.name,
                position={"start": 0.0, "goal": 1.0}.get(what),
                excess=float(fixed.excess[0, j]),
            )


def least_duration(limits: Sequence[Limit], robot: Robot, move: Move) -> tuple[float, str, str]:
    """A duration [s] that every motion of a move exceeds, whatever its path; the limit behind it, and what it limits.

    Raises:
        Infeasible: no motion may last so long.
    """
    poses, resting = np.array([move.start, *move.via, move.goal]), not np.any(move.end_velocities)
    least, limit = max(((limit.least_duration(poses, resting), limit) for limit in limits), key=lambda found: found[0])
    where = limit.where(robot.joints, 0)
    if least > LONGEST:
        raise Infeasible(
            f"the {limit.name} limit of {where} requires at least {least:.4g} s; no motion may last more than "
            f"{LONGEST:g} s",
            joint=where,
            limit=limit.name,
        )
    return least, limit.name, where
