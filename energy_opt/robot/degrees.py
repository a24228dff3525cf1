"""Positions that should be radians and look like degrees."""

from __future__ import annotations

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.robot.limits import TURNS, look_like_degrees
from energy_opt.robot.robot import Robot

DEGREES = 4 * 3.15  # [rad] beyond a limit from which a position is assumed to be in degrees: two turns


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
