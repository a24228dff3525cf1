"""What an arm's drives are rated for: measures of size for friction and electrical values that nobody has published."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from energy_opt.robot.limits import ASSUMED_VELOCITY, DOUBTFUL_VELOCITY, Limits
from energy_opt.robot.rigid_body import RigidBody

POSES = 64  # postures in which an arm without effort limits is looked at
ROOM = 1.5  # times the largest torque that holding and accelerating take there; strongest joints have 0.9 to 3.3
WEAKEST = 0.1  # no joint's rating is below this share of the strongest one's; a UR5e's wrist has 0.19, a Panda's 0.14


@dataclass(frozen=True)
class Rating:
    """Speed (n,) [rad/s, m/s] and effort (n,) [N m, N] that the drives are rated for; always finite.

    User's limits that are lower do not change them: a slowed arm has the same motors. `estimated` (n,) tells efforts
    that no file states and that are estimated from the arm's own weight.
    """

    velocity: np.ndarray
    effort: np.ndarray
    estimated: np.ndarray

    @property
    def power(self) -> float:
        """The sum of effort times speed, W: no arm's drives give more."""
        return float(self.effort @ self.velocity)


def rating_of(own: Limits, known: np.ndarray, held: Limits, body: RigidBody) -> Rating:
    """The rating from the arm's own limits and those in force.

    Args:
        own: as URDF and publications state them, assumptions filled in.
        known: (n,) the joints whose own velocity is stated.
        held: the limits in force; what the arm's own files do not state is taken from here.
    """
    velocity = np.where(known, np.maximum(own.velocity, held.velocity), held.velocity)
    velocity = np.where(velocity < DOUBTFUL_VELOCITY, velocity, ASSUMED_VELOCITY)  # no drive turns a joint so fast
    stated = [np.where(np.isfinite(limits.effort), limits.effort, 0.0) for limits in (own, held)]
    effort = np.maximum(*stated)
    missing = effort <= 0
    if missing.any():
        effort = np.where(missing, _estimated(body, held), effort)
        for slides in (False, True):  # newtons and newton metres do not compare
            alike = np.array(body.slides) == slides
            if alike.any():
                effort[alike & missing] = np.maximum(effort, WEAKEST * effort[alike].max())[alike & missing]
    return Rating(velocity, effort, missing)


def _estimated(body: RigidBody, limits: Limits) -> np.ndarray:
    """(n,) N m: `ROOM` times the largest torque that holds each joint, plus what accelerates it as fast as it may."""
    rng = np.random.default_rng(0)
    low = np.where(np.isfinite(limits.lower), limits.lower, -np.pi)
    high = np.where(np.isfinite(limits.upper), limits.upper, np.pi)
    q = rng.uniform(np.minimum(low, high), np.maximum(low, high), (POSES, body.n))
    still = np.zeros_like(q)
    holding = body.torque(q, still, still)
    out = np.empty(body.n)
    for j in range(body.n):
        push = still.copy()
        push[:, j] = limits.acceleration[j]
        moved = body.torque(q, still, push)[:, j] - holding[:, j]
        out[j] = ROOM * (np.abs(holding[:, j]).max() + np.abs(moved).max())
    return out
