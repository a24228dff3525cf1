"""The limits in force: the robot's own, and those that settings or a move add."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from energy_opt.arguments import expect
from energy_opt.errors import BadInput
from energy_opt.motion.limits.base import Limit
from energy_opt.motion.limits.held import Held
from energy_opt.motion.limits.joint import Acceleration, Effort, Jerk, JointLimit, Position, Velocity
from energy_opt.motion.limits.keep import KeepLine, KeepOrientation, KeepUpright
from energy_opt.motion.limits.own import OwnLimit, Power
from energy_opt.motion.limits.tool import ToolAcceleration, ToolSpeed
from energy_opt.motion.limits.tube import Tube
from energy_opt.motion.limits.via import ViaPoints
from energy_opt.motion.move import Move, Settings
from energy_opt.robot import Limits, Robot

# added to the robot's own
ASKED: tuple[type[Limit], ...] = (
    Held, ViaPoints, Power, ToolSpeed, ToolAcceleration, KeepUpright, KeepOrientation, KeepLine, Tube,
)  # fmt: skip


def joint_limits(bounds: Limits) -> tuple[Limit, ...]:
    """The limits from a robot's bounds, in the order in which they are reported."""
    return (
        Position(bounds.lower, bounds.upper),
        Velocity(bounds.velocity),
        Acceleration(bounds.acceleration),
        Jerk(bounds.jerk),
        Effort(bounds.effort),
    )


def limits_of(
    robot: Robot, settings: Settings, move: Move | None = None, gravity: np.ndarray | None = None
) -> tuple[Limit, ...]:
    """All limits in force for a robot's moves, or for one of them.

    Args:
        gravity: (3,) [m/s^2] in the base frame; None for an upright base.

    Raises:
        BadInput: an impossible bound or frame.
    """
    pull = robot.body.gravity if gravity is None else gravity
    asked = (kind.asked(robot, settings, move, pull) for kind in ASKED)
    for limit in settings.own_limits:
        expect(limit, OwnLimit, "--own-limits")
    own = (limit.for_robot(robot) for limit in settings.own_limits)
    limits = (*joint_limits(robot.limits), *(limit for limit in asked if limit is not None), *own)
    names = [limit.name for limit in limits]
    if twice := [name for name in names if names.count(name) > 1]:
        raise BadInput(f"two limits are named {twice[0]!r}; each needs a name of its own")
    return limits


def without_conditions(limits: Sequence[Limit]) -> tuple[Limit, ...]:
    """The limits of the joints alone."""
    return tuple(limit for limit in limits if isinstance(limit, (Position, JointLimit)))
