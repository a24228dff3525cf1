"""Minimum time over the timing of a fixed path, with all limits: those that TOPP-RA supports and the others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from energy_opt.motion.limits.along import used
from energy_opt.motion.limits.base import Limit
from energy_opt.motion.path import JointPath
from energy_opt.motion.path_dynamics import PathDynamics, points_of
from energy_opt.motion.retime.program import Retiming
from energy_opt.motion.timing.spline_timing import Timing
from energy_opt.motion.timing.toppra import fastest
from energy_opt.power import PowerModel
from energy_opt.robot import Robot

FLOOR = 1e-6  # least squared speed, as a share of the start's largest
CHECKS = 1001  # places of a path to check
BINDING = 0.99  # share of a bound from which a limit counts as binding
ROUNDING = 1e-7  # relative slowing of the fastest timing, for excesses between the grid's points


def minimum_time(robot: Robot, model: PowerModel, path: JointPath, limits: Sequence[Limit]) -> Timing:
    """The fastest timing of a path within limits, with the path's speeds at both ends.

    It is TOPP-RA's, unless limits bind that TOPP-RA does not support (above all jerk): it would have to be slowed
    evenly to hold these, so the retiming program is then minimised for time, starting there.

    Raises:
        Infeasible: the path breaks limits at any timing.
    """
    first = fastest(robot, model, path, limits=limits)
    if not path.moves:
        return first
    d = PathDynamics(robot, model, path, points_of(path, CHECKS))
    b, a, w = first.speed(d.s)
    middle, one = d.at(np.array([0.5])), np.ones(1)
    unknown = [limit for limit in limits if limit.inner or limit.tangent(middle, one, one) is None]
    if not any(use.worst[0] > BINDING for use in used(unknown, d, a, b, w)):
        return first
    return quickest(Retiming(robot, model, first, tuple(limits)), first)


def quickest(work: Retiming, shortest: Timing) -> Timing:
    """The program minimised for time, slowed by its excess over limits; `shortest` if that is no slower.

    Args:
        work: the path's retiming. shortest: a timing of the path within the limits, from which the solver starts.
    """
    found = work.optimise(shortest, price=-1.0, longest=2 * shortest.duration, floor=FLOOR, energy=False)
    timing = found.timing
    if all(work.rest):
        timing = timing.slowed(timing.duration * (1 + max(work.limits.worst(timing.control).excess, 0.0) + ROUNDING))
    return timing if found.solved and timing.duration < shortest.duration else shortest
