"""Static poses that would determine Method 2 best: within limits, and with gravity torques as different as possible."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.robot import PointMass, Robot

DRAWN = 4000
MOST = 1000  # most poses: recording more would take days
MARGIN = 0.05  # share of a joint's range kept free at each limit
SHARE = 0.9  # largest share of the effort limit for holding a pose


@dataclass(frozen=True)
class Suggestion:
    """Poses (N, n) rad, their |gravity torque|^2 (N,) (N m)^2, and their expected accuracy.

    `width` is the 95 % half-width of r_over_kt2 [W/(N m)^2] to expect per watt of spread about the line.
    """

    poses: np.ndarray
    load: np.ndarray
    width: float


def suggest(
    robot: Robot,
    count: int,
    seed: int = 0,
    payload: PointMass | None = None,
    free: Callable[[np.ndarray], bool] | None = None,
    gravity: np.ndarray | None = None,
) -> Suggestion:
    """Choose `count` poses that maximise det(X^T X), X = [1, |g|^2], and differ from each other.

    For a line that determinant is largest with half of the poses at either end of |g|^2. Among poses of nearly the same
    load the ones farthest from those already chosen are taken.

    Args:
        free: True if the arm touches nothing at a pose (n,); None to skip this check.
        gravity: (3,) [m/s^2] in the base frame (that of an upright base).

    Raises:
        BadInput: fewer than 3 or more than `MOST` poses are asked for, or not so many can be held;
            the seed is below 0.
    """
    from scipy.stats import t as student

    if count < 3:
        raise BadInput(f"--suggest {count}: a fit with a confidence interval needs 3 poses or more")
    if count > MOST:
        raise BadInput(f"--suggest {count}: expected at most {MOST} poses")
    if seed < 0:
        raise BadInput(f"--seed {seed}: expected 0 or more")
    rng = np.random.default_rng(seed)
    limits = robot.limits
    lower, upper = limits.ranges
    room = MARGIN * (upper - lower)
    drawn = rng.uniform(lower + room, upper - room, (DRAWN, robot.n))
    rest = np.zeros_like(drawn)
    torque = robot.body.torque(drawn, rest, rest, payload, gravity)
    can = (np.abs(torque) <= SHARE * limits.effort).all(axis=1)
    drawn, load = drawn[can], np.sum(torque[can] ** 2, axis=1)
    if len(drawn) < count:
        raise BadInput("the arm can hold hardly any pose within its effort limits; are limits and payload right?")
    order = np.argsort(load)
    band = max(count, len(order) // 50)
    ends = (order, order[::-1])
    low, high = (np.fromiter(islice((k for k in end if free is None or free(drawn[k])), band), int) for end in ends)
    if len(low) < count:
        raise BadInput("the arm can hold hardly any pose without touching something")
    chosen: list[int] = [int(high[0]), int(low[0])]
    for k in range(2, count):
        pool = high if k % 2 == 0 else low
        apart = np.min(np.abs(drawn[pool][:, None] - drawn[chosen][None]).max(axis=2), axis=1)
        chosen.append(int(pool[int(np.argmax(apart))]))
    drawn, load = drawn[chosen], load[chosen]
    width = float(student.ppf(0.975, max(count - 2, 1)) / np.sqrt(np.sum((load - load.mean()) ** 2)))
    return Suggestion(drawn, load, width)
