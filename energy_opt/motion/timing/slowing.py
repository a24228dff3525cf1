"""Even slowing of a timing: the limits that it breaks, and the slowing that holds all limits.

TOPP-RA does not know limits such as jerk. Slowing a timing by the factor k divides the derivative of order m by k^m, so
such limits hold if a motion from rest to rest is slow enough. Limits without an order, as on torque, are tried instead.
"""

from __future__ import annotations

from collections.abc import Sequence

from energy_opt.errors import Infeasible
from energy_opt.motion.limits.along import Use, used
from energy_opt.motion.limits.base import Limit
from energy_opt.motion.path_dynamics import PathDynamics
from energy_opt.motion.timing.spline_timing import Timing

TOLERANCE = 1e-7  # share of a bound: a smaller excess is no violation
SLOWEST = 50.0  # largest factor of the duration: slowing further repairs nothing


def uses(limits: Sequence[Limit], dense: PathDynamics, timing: Timing) -> list[Use]:
    """The share of each limit that a timing uses at the places of `dense`, the path at closely spaced positions."""
    b, a, w = timing.speed(dense.s)
    return used(limits, dense, a, b, w)


def broken(limit: Limit, dense: PathDynamics, timing: Timing) -> bool:
    """Does a timing break a limit by more than the tolerance?"""
    return any(use.worst[0] > 1 + TOLERANCE for use in uses([limit], dense, timing))


def slowing(limits: Sequence[Limit], dense: PathDynamics, timing: Timing) -> float:
    """The factor by which to slow a timing evenly so that all limits hold which it breaks by more than the
    tolerance.
    """
    worse = [use for use in uses(limits, dense, timing) if use.worst[0] > 1 + TOLERANCE]
    if not worse:
        return 1.0
    # a derivative of order k falls with the k-th power of the duration; other limits are tried
    factor = max([1.0, *(use.worst[0] ** (1 / use.limit.order) for use in worse if use.limit.order)])
    others = [use.limit for use in worse if not use.limit.order]

    def held(factor: float) -> bool:
        slower = timing.slowed(timing.duration * factor * (1 + TOLERANCE))
        return max(use.worst[0] for use in uses(others, dense, slower)) <= 1 + TOLERANCE

    if others and not held(SLOWEST):
        return max(factor, SLOWEST)
    while factor < SLOWEST and others and not held(factor):
        factor *= 1.01
    return factor


def not_held(limits: Sequence[Limit], dense: PathDynamics, timing: Timing, text: str) -> Infeasible:
    """The error that the limit which is broken most cannot be held, with its place.

    Args:
        text: what it says of the limit, such as "cannot be held".
    """
    use = max(uses(limits, dense, timing), key=lambda use: use.worst[0])
    share, k, j = use.worst
    where, s = use.limit.where(dense.robot.joints, j), float(dense.s[k])
    return Infeasible(
        f"{where}: the {use.limit.name} limit {text} at path position {s:.3f}",
        joint=where,
        limit=use.limit.name,
        position=s,
        excess=share - 1,
    )
