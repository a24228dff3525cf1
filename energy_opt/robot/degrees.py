"""Positions as people write them: rounded, or in degrees where radians are meant."""

from __future__ import annotations

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.robot.limits import TURNS, look_like_degrees
from energy_opt.robot.robot import ROUNDING, Robot

DEGREES = 4 * 3.15  # [rad] beyond a limit from which a position is assumed to be in degrees: two turns
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
