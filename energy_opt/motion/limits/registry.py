"""Which limits are in force: the robot's own, and those that are asked for besides."""

from __future__ import annotations

from energy_opt.motion.limits.acceleration import Acceleration
from energy_opt.motion.limits.base import Limit
from energy_opt.motion.limits.effort import Effort
from energy_opt.motion.limits.jerk import Jerk
from energy_opt.motion.limits.position import Position
from energy_opt.motion.limits.velocity import Velocity
from energy_opt.robot import Limits


def joint_limits(bounds: Limits) -> tuple[Limit, ...]:
    """The limits that a robot's numbers stand for, in the order in which they are reported."""
    return (
        Position(bounds.lower, bounds.upper),
        Velocity(bounds.velocity),
        Acceleration(bounds.acceleration),
        Jerk(bounds.jerk),
        Effort(bounds.effort),
    )
