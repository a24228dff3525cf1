"""Joint limits: the URDF's, overlaid by published ones, overlaid by the user's file with MoveIt's keys."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.files import read_yaml

ASSUMED_VELOCITY = np.pi  # [rad/s] where no limit is known
ASSUMED_ACCELERATION = 10.0  # [rad/s^2] where neither acceleration nor effort is limited
PLACEHOLDER = 1e4  # a velocity or effort limit of this size or more is no limit
DOUBTFUL_VELOCITY = 100.0  # [rad/s] a limit from here on is named, but used
DOUBTFUL_EFFORT = 100.0  # likewise, in multiples of the torque that holds the whole arm out straight
TURNS = 50.0  # [rad] further no joint without limits is turned; eight turns

_KEYS = {
    "position": ("min_position", "max_position"),
    "velocity": ("max_velocity",),
    "acceleration": ("max_acceleration",),
    "jerk": ("max_jerk",),
    "effort": ("max_effort",),
}


@dataclass(frozen=True)
class Limits:
    """Bounds per joint, (n,) each, inf where there is none.

    lower, upper [rad]; velocity [rad/s], acceleration [rad/s^2], jerk [rad/s^3] and effort [N m] hold both ways.
    """

    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    jerk: np.ndarray
    effort: np.ndarray

    def replace(self, **bounds: np.ndarray) -> Limits:
        """The same limits with some of them changed."""
        return dataclasses.replace(self, **bounds)


def look_like_degrees(limits: Limits, position: np.ndarray, beyond: float) -> tuple[int, int] | None:
    """Row and joint of the first position that only makes sense as degrees, None where positions may be radians.

    Args:
        position: (N, n) or (n,), said to be rad.
        beyond: how far outside a limit one must lie [rad], while in degrees all would be inside (or nearly).
    """
    q = np.atleast_2d(position)
    far = (q < limits.lower - beyond) | (q > limits.upper + beyond) | (np.abs(q) > TURNS)
    if not far.any():
        return None
    turned = np.radians(q)
    if not ((turned >= limits.lower - beyond) & (turned <= limits.upper + beyond)).all():
        return None
    row, joint = (int(k) for k in np.argwhere(far)[0])
    return row, joint


def overlay(limits: Limits, joints: Sequence[str], path: Path) -> Limits:
    """`limits` with those of a MoveIt joint_limits.yaml in their place.

    Keys: has_position_limits, min_position, max_position, has_velocity_limits, max_velocity, has_acceleration_limits,
    max_acceleration, has_jerk_limits, max_jerk, has_effort_limits, max_effort. `has_…: false` takes a limit away.

    Raises:
        BadInput: the file is malformed, or none of the joints it names is the robot's.
    """
    table = _table(path)
    if not set(table) & set(joints):
        raise BadInput(f"{path}: names {', '.join(map(str, table))}; the robot's joints are {', '.join(joints)}")
    arrays = {field.name: getattr(limits, field.name).copy() for field in dataclasses.fields(Limits)}
    for j, joint in enumerate(joints):
        row = table.get(joint, {})
        if not isinstance(row, dict):
            raise BadInput(f"{path}: joint_limits.{joint}: not a table of limits")
        for kind, keys in _KEYS.items():
            where = f"{path}: joint_limits.{joint}"
            given = [_number(row, key, where) for key in keys]
            if row.get(f"has_{kind}_limits", any(x is not None for x in given)):
                if kind == "position":
                    arrays["lower"][j] = given[0] if given[0] is not None else arrays["lower"][j]
                    arrays["upper"][j] = given[1] if given[1] is not None else arrays["upper"][j]
                    if not arrays["lower"][j] < arrays["upper"][j]:
                        raise BadInput(f"{where}: min_position is not below max_position")
                elif given[0] is not None:
                    if given[0] <= 0:
                        raise BadInput(f"{where}.{keys[0]} = {given[0]:g}; expected a number above 0")
                    arrays[kind][j] = given[0]
                elif row.get(f"has_{kind}_limits"):
                    raise BadInput(f"{where}: has_{kind}_limits is true, but {keys[0]} is missing")
            elif f"has_{kind}_limits" in row:
                if kind == "position":
                    arrays["lower"][j], arrays["upper"][j] = -np.inf, np.inf
                else:
                    arrays[kind][j] = np.inf
    return Limits(**arrays)


def _table(path: Path) -> dict[str, Any]:
    document = read_yaml(path)
    table = document.get("joint_limits") if isinstance(document, dict) else None
    if not isinstance(table, dict) or not table:
        raise BadInput(f"{path}: no joint_limits table; expected MoveIt's joint_limits.yaml")
    return table


def names_in(path: Path) -> list[str]:
    """The joints that a limits file names."""
    return [str(name) for name in _table(path)]


def _number(row: dict[str, Any], key: str, where: str) -> float | None:
    value = row.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or np.isnan(value):
        raise BadInput(f"{where}.{key} = {value!r} is not a number")
    return float(value)


def with_assumptions(limits: Limits, joints: Sequence[str], holding: float) -> tuple[Limits, list[str]]:
    """Replace zero, missing and placeholder limits by assumptions, each named in a warning; doubtful ones are named.

    `holding` is the torque [N m] that holds the whole arm out straight, as a measure of what an effort limit can be.
    """
    warnings: list[str] = []
    lower, upper = limits.lower.copy(), limits.upper.copy()
    velocity, effort, acceleration = limits.velocity.copy(), limits.effort.copy(), limits.acceleration.copy()
    for j, joint in enumerate(joints):
        if not lower[j] < upper[j]:
            warnings.append(f"{joint}: position limits [{lower[j]:g}, {upper[j]:g}] are empty; assumed: none")
            lower[j], upper[j] = -np.inf, np.inf
        if not 0 < velocity[j] < PLACEHOLDER:
            warnings.append(f"{joint}: velocity limit {velocity[j]:g} rad/s; assumed: {ASSUMED_VELOCITY:.4g} rad/s")
            velocity[j] = ASSUMED_VELOCITY
        elif velocity[j] >= DOUBTFUL_VELOCITY:
            warnings.append(f"{joint}: velocity limit {velocity[j]:g} rad/s (a placeholder?); assumed: as stated")
        if 0 < effort[j] < PLACEHOLDER:
            if holding > 0 and effort[j] >= DOUBTFUL_EFFORT * holding:
                warnings.append(
                    f"{joint}: effort limit {effort[j]:g} N m, {effort[j] / holding:.0f} times what holds the arm out "
                    "straight (a placeholder?); assumed: as stated"
                )
        else:
            warnings.append(f"{joint}: effort limit {effort[j]:g} N m; assumed: none")
            effort[j] = np.inf
            if not np.isfinite(acceleration[j]):
                warnings.append(
                    f"{joint}: neither effort nor acceleration is limited; "
                    f"assumed: acceleration {ASSUMED_ACCELERATION:g} rad/s^2"
                )
                acceleration[j] = ASSUMED_ACCELERATION
    checked = limits.replace(lower=lower, upper=upper, velocity=velocity, effort=effort, acceleration=acceleration)
    return checked, warnings
