"""Motions as people write them: positions rounded or in degrees where radians are meant, times in milliseconds."""

from __future__ import annotations

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.robot.limits import TURNS, look_like_degrees
from energy_opt.robot.robot import ROUNDING, Robot

DEGREES = 4 * 3.15  # [rad] beyond a limit from which a position is assumed to be in degrees: two turns
# share of the velocity limits that a motion reaches at most if its times are milliseconds, taken for seconds
SLOW = 1e-3
MOVED = 0.05  # [rad, m] a motion is at least so long
NOTED = 1e-9  # [rad, m] smaller changes of a position are not noted


def refuse_degrees(robot: Robot, position: np.ndarray, where: str = "") -> tuple[str, ...]:
    """Refuse positions (N, n) or (n,) that should be radians and look like degrees.

    Returns:
        A warning where a joint without limits turns many times: this is possible, but may be degrees.

    Raises:
        BadInput: a joint is far outside its limits; names what to write instead.
    """
    place = where and f"{where}: "
    found = look_like_degrees(robot.limits, position, DEGREES, robot.slides)
    if found is not None:
        value = float(np.atleast_2d(position)[found])
        raise BadInput(
            f"{place}{value:g} rad for {robot.joints[found[1]]} is far outside its limits: these look like degrees; "
            f"positions are radians ({value:g} deg = {np.radians(value):.4g} rad)"
        )
    found = look_like_degrees(robot.limits, position, DEGREES, robot.slides, TURNS)
    if found is None:
        return ()
    value = max(np.atleast_2d(position)[:, found[1]].tolist(), key=abs)
    turned = f"{place}{value:g} rad for {robot.joints[found[1]]}"
    turns, radians = abs(value) / (2 * np.pi), np.radians(value)
    return (f"{turned} is {turns:.3g} turns; if this is in degrees, write {radians:.4g}",)


def onto_limits(robot: Robot, position: np.ndarray, where: str = "") -> tuple[np.ndarray, tuple[str, ...]]:
    """Positions (N, n) or (n,) and notes: those beyond a limit by rounding (3.1416 for pi) are moved onto it."""
    low, high = robot.limits.lower, robot.limits.upper
    inside = np.clip(position, low, high)
    beyond = np.abs(inside - position)
    moved = beyond <= ROUNDING
    most = np.atleast_2d(np.where(moved, beyond, 0.0)).max(axis=0)
    place = where and f"{where}: "
    notes = (
        f"{place}{robot.joints[j]} is {most[j]:.1g} {robot.units[j]} beyond its position limits "
        f"[{low[j]:.6g}, {high[j]:.6g}], as rounded positions are; it is moved onto the limit"
        for j in np.flatnonzero(most > NOTED)
    )
    return np.where(moved, inside, position), tuple(notes)


def doubted_units(robot: Robot, time: np.ndarray | None, position: np.ndarray, where: str) -> tuple[str, ...]:
    """Remarks where a motion's positions may be degrees, or is so slow that its times may be milliseconds.

    Args:
        time: (N,), taken for s; None where there are none, or their unit is sure. position: (N, n) [rad, m]. where: the
            file.

    Raises:
        BadInput: as `refuse_degrees`.
    """
    degrees, limit = refuse_degrees(robot, position, where), robot.limits.velocity
    if time is None or len(time) < 2 or np.ptp(position, axis=0).max() < MOVED or not np.isfinite(limit).all():
        return degrees
    speed = np.percentile(np.abs(np.diff(position, axis=0)) / np.diff(time)[:, None], 95, axis=0)
    share = float((speed / limit).max())
    if share > SLOW:
        return degrees
    return (
        *degrees,
        f"{where}: takes {time[-1] - time[0]:.6g} s, at {100 * share:.1g} % of the largest speed: are its times "
        "milliseconds? Then name their column time_ms",
    )
