"""Minimum time over the timing of a fixed path, within limits that TOPP-RA knows and those that it does not."""

from __future__ import annotations

from collections.abc import Sequence

from energy_opt.motion.limits.along import used
from energy_opt.motion.limits.base import Limit
from energy_opt.motion.path import JointPath
from energy_opt.motion.path_dynamics import PathDynamics, points_of
from energy_opt.motion.retime.program import Retiming
from energy_opt.motion.timing.law import Timing
from energy_opt.motion.timing.toppra import fastest
from energy_opt.power import PowerModel
from energy_opt.robot import Robot

FLOOR = 1e-6  # least squared speed, as a share of the start's largest
CHECKS = 1001  # places of a path that are looked at
BINDING = 0.99  # share of a bound that is used where it binds
ROUNDING = 1e-7  # relative: by so much the fastest timing is slowed, for what lies between the grid's points


def minimum_time(
    robot: Robot,
    model: PowerModel,
    path: JointPath,
    limits: Sequence[Limit],
    start_speed: float = 0.0,
    end_speed: float = 0.0,
) -> Timing:
    """The fastest timing of a path within limits: TOPP-RA's, and from there, where limits bind that TOPP-RA does not
    know (jerk, above all), the retiming program minimised for time: TOPP-RA's must be slowed evenly to hold them.

    Raises:
        Infeasible: the path breaks limits at any timing.
    """
    first = fastest(robot, model, path, limits=limits, start_speed=start_speed, end_speed=end_speed)
    if not path.moves:
        return first
    d = PathDynamics(robot, model, path, points_of(path, CHECKS))
    b, a, w = first.speed(d.s)
    unknown = [limit for limit in limits if limit.inner or limit.tangent(d, a, b) is None]
    if not any(use.worst[0] > BINDING for use in used(unknown, d, a, b, w)):
        return first
    return quickest(Retiming(robot, model, first, tuple(limits)), first)


def quickest(work: Retiming, shortest: Timing) -> Timing:
    """The program itself, minimised for time, and slowed by what it is off; `shortest` where that is no better."""
    found = work.optimise(shortest, price=-1.0, longest=2 * shortest.duration, floor=FLOOR, energy=False)
    timing = found.timing
    if all(work.rest):
        timing = timing.slowed(timing.duration * (1 + max(work.limits.worst(timing.control).excess, 0.0) + ROUNDING))
    return timing if found.solved and timing.duration < shortest.duration else shortest
