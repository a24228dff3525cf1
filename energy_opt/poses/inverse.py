"""All joint positions that bring the tool to a pose: seeded starts, Levenberg and Marquardt's steps, within the limits.

    minimise |e(q)|^2,   (J^T J + lambda I) dq = -J^T e,   lower <= q <= upper

for many starts at once. e is the error of the pose within its freedom; J follows by differences of e. Solutions of arms
without redundancy are isolated (the branches); of others the starts sample the whole set.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from energy_opt.poses.pose import Missed, Pose, missed
from energy_opt.robot import Robot
from energy_opt.robot.kinematics import Kinematics
from energy_opt.robot.tool import tool_of

STARTS = 400
STEPS = 80
SMALL = 1e-9  # [m, rad] a smaller error is none
DIFFERENCE = 1e-6  # [rad, m]
SAME = 1e-3  # [rad, m] positions nearer than this are one
TURN = 2 * np.pi
LENGTH = 0.3  # [m] that counts as much as a radian


@dataclass(frozen=True)
class Reached:
    """What the starts came to.

    Attributes:
        positions: (K, n) [rad, m] that reach the pose.
        nearest: (n,) that comes nearest, where none reaches it; distance [m] and angle [rad] are what it misses by.
        blocked: the joint whose limit holds it there; "" where none does.
    """

    positions: np.ndarray
    nearest: np.ndarray
    distance: float
    angle: float
    blocked: str


class ToolKinematics:
    """The tool of a robot at many configurations."""

    def __init__(self, robot: Robot, tool: str | None = None) -> None:
        self.robot = robot
        self._kinematics = Kinematics(robot.body.tree())
        frame = tool_of(robot.body, tool)
        self._joint, pose = frame.joint, np.array(frame.pose)
        self._turn, self._shift = pose[:3, :3], pose[:3, 3]

    def __call__(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotation (N, 3, 3) and origin (N, 3) [m] of the tool in the base frame at q (N, n)."""
        poses = self._kinematics(q)
        r, p = poses.rotation[:, self._joint], poses.origin[:, self._joint]
        return r @ self._turn, p + r @ self._shift

    def missed(self, pose: Pose, q: np.ndarray) -> Missed:
        """By what the tool misses a pose at q (N, n)."""
        return missed(pose, *self(q))


def reach(
    tool: ToolKinematics, pose: Pose, *, seed: int = 0, near: np.ndarray | None = None, starts: int = STARTS
) -> Reached:
    """Joint positions that reach a pose, from many seeded starts.

    Args:
        near: (n,) positions that are tried first, and of which whole turns of joints are taken nearest.
    """
    limits = tool.robot.limits
    low, high = (np.where(np.isfinite(x), x, s * np.pi) for x, s in ((limits.lower, -1), (limits.upper, 1)))
    rng = np.random.default_rng(seed)
    q = rng.uniform(low, high, size=(starts, len(low)))
    if near is not None:
        q[0] = np.clip(near, limits.lower, limits.upper)
    q, error = solve(tool, pose, q)
    good = error < SMALL
    if not good.any():
        k = int(np.argmin(error))
        off = tool.missed(pose, q[k : k + 1])
        at_end = np.minimum(q[k] - limits.lower, limits.upper - q[k]) < 1e-6
        blocked = tool.robot.joints[int(np.argmax(at_end))] if at_end.any() else ""
        distance, angle = (float(np.linalg.norm(x)) for x in (off.shift, off.turn))
        return Reached(np.zeros((0, len(low))), q[k], distance, angle, blocked)
    found = distinct(turned_near(q[good], near, tool.robot))
    return Reached(found, found[0], 0.0, 0.0, "")


def solve(tool: ToolKinematics, pose: Pose, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (N, n) that the starts q (N, n) lead to, and the largest error of each (N,) [m, rad]."""
    limits = tool.robot.limits
    lower, upper = limits.lower, limits.upper
    weight = np.array([1 / LENGTH] * 3 + [1.0] * 3)
    count, n = q.shape
    q = q.copy()
    e = tool.missed(pose, q).both * weight
    damping = np.full(count, 1e-2)
    for _ in range(STEPS):
        open_ = np.flatnonzero(np.abs(e).max(axis=1) > SMALL / 10)
        if not len(open_):
            break
        at, now = q[open_], e[open_]
        jacobian = np.empty((len(open_), 6, n))
        for j in range(n):
            step = at.copy()
            step[:, j] += DIFFERENCE
            jacobian[:, :, j] = (tool.missed(pose, step).both * weight - now) / DIFFERENCE
        gradient = np.einsum("kij,ki->kj", jacobian, now)
        # a joint at its limit that is pushed outwards takes no part
        held = ((at <= lower) & (gradient > 0)) | ((at >= upper) & (gradient < 0))
        jacobian *= ~held[:, None]
        gradient *= ~held
        normal = np.einsum("kij,kil->kjl", jacobian, jacobian) + damping[open_, None, None] * np.eye(n)
        trial = np.clip(at - np.linalg.solve(normal, gradient[..., None])[..., 0], lower, upper)
        there = tool.missed(pose, trial).both * weight
        better = np.sum(there**2, axis=1) < np.sum(now**2, axis=1)
        q[open_[better]], e[open_[better]] = trial[better], there[better]
        damping[open_] = np.clip(np.where(better, damping[open_] / 5, damping[open_] * 4), 1e-12, 1e6)
    return q, np.abs(e / weight).max(axis=1)


def turned_near(q: np.ndarray, near: np.ndarray | None, robot: Robot) -> np.ndarray:
    """Positions (K, n) with whole turns of revolute joints taken off or added, within the limits, towards `near`."""
    if near is None:
        return q
    out = q.copy()
    for j in np.flatnonzero(~np.array(robot.slides, dtype=bool)):
        whole = np.round((near[j] - q[:, j]) / TURN)
        for turns in (whole, whole - np.sign(whole)):
            moved = q[:, j] + TURN * turns
            inside = (moved >= robot.limits.lower[j]) & (moved <= robot.limits.upper[j])
            nearer = np.abs(moved - near[j]) < np.abs(out[:, j] - near[j])
            out[:, j] = np.where(inside & nearer, moved, out[:, j])
    return out


def distinct(q: np.ndarray) -> np.ndarray:
    """Positions (K, n) of which no two are nearer than `SAME`."""
    kept: list[np.ndarray] = []
    for row in q[np.lexsort(np.round(q.T[::-1], 4))]:
        if not kept or np.abs(np.array(kept) - row).max(axis=1).min() > SAME:
            kept.append(row)
    return np.array(kept).reshape(-1, q.shape[1])
