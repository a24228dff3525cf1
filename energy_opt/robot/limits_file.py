"""Joint limits of a file with the keys of MoveIt's joint_limits.yaml.

Limits hold in both directions here: of two different sizes the smaller one is used. The table may stand by itself, or
where ROS parameters have it (robot_description_planning, ros__parameters).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import AfterValidator, Field, StrictBool, model_validator

from energy_opt.errors import BadInput
from energy_opt.files import is_number, read_yaml
from energy_opt.robot.limits import SMALLEST, Limits
from energy_opt.schema import Table, parse, reads

EXTREMES = ("min", "max")
KINDS = ("velocity", "acceleration", "jerk", "effort")  # bounds on a magnitude
WRAPPERS = ("/**", "ros__parameters", "robot_description_planning", "move_group")


def _bound(value: object) -> object:
    """A number, which may be infinite."""
    if not is_number(value) and value not in (np.inf, -np.inf):
        raise BadInput("expected a number")
    return value


Flag = StrictBool | None
Bound = Annotated[float, reads(_bound)] | None
Most = Annotated[float, reads(_bound), Field(ge=SMALLEST)] | None
Least = Annotated[float, reads(_bound), Field(le=-SMALLEST)] | None
Braking = Annotated[float, reads(_bound), AfterValidator(abs), Field(ge=SMALLEST)] | None  # its size counts
Factor = Annotated[float, reads(_bound), Field(gt=0, le=1)] | None


class JointTable(Table):
    """Limits of one joint [rad or m, s, N m or N].

    A number counts unless its `has_...` is false, which takes the limit away. A soft range makes that of the position
    smaller; its gains k_... are the controller's and are not used.
    """

    has_position_limits: Flag = None
    min_position: Bound = None
    max_position: Bound = None
    has_velocity_limits: Flag = None
    min_velocity: Least = None
    max_velocity: Most = None
    has_acceleration_limits: Flag = None
    min_acceleration: Least = None
    max_acceleration: Most = None
    has_deceleration_limits: Flag = None
    max_deceleration: Braking = None
    has_jerk_limits: Flag = None
    max_jerk: Most = None
    has_effort_limits: Flag = None
    max_effort: Most = None
    has_soft_limits: Flag = None
    soft_lower_limit: Bound = None
    soft_upper_limit: Bound = None
    k_position: Bound = None
    k_velocity: Bound = None
    angle_wraparound: Flag = None

    @model_validator(mode="before")
    @classmethod
    def _without_disabled(cls, row: dict[str, Any]) -> dict[str, Any]:
        """Leave out numbers whose `has_...` is false."""
        off = [kind for kind in ("position", *KINDS, "deceleration") if row.get(f"has_{kind}_limits") is False]
        return {
            key: value for key, value in row.items() if key not in [f"{m}_{kind}" for kind in off for m in EXTREMES]
        }

    @model_validator(mode="after")
    def _check_numbers_given(self) -> Self:
        """A limit that is said to exist has a number."""
        for kind in (*KINDS, "deceleration"):
            if getattr(self, f"has_{kind}_limits") and not self.sizes(kind):
                raise ValueError(f"has_{kind}_limits is true, but max_{kind} is missing")
        return self

    def sizes(self, kind: str) -> list[float]:
        """The bounds on a magnitude that are given, in both directions."""
        given = (getattr(self, f"{extreme}_{kind}", None) for extreme in EXTREMES)
        return [abs(value) for value in given if value is not None]


class LimitsTable(Table):
    """Limits by joint, and factors by which all limits on velocity and acceleration are multiplied."""

    joint_limits: dict[str, dict[str, Any]] = Field(min_length=1)
    default_velocity_scaling_factor: Factor = None
    default_acceleration_scaling_factor: Factor = None
    cartesian_limits: Any = None  # of other planners; ignored


def overlay(
    limits: Limits, joints: Sequence[str], path: Path, prefix: str = "", others: Collection[str] = ()
) -> tuple[Limits, list[str]]:
    """`limits` with those of a joint_limits.yaml instead, and a warning for each factor that scales them.

    Args:
        limits: to start from. joints: names in the order of the limits. path: the file.
        prefix: prefix of the robot's joint names in the file.
        others: joints of the robot that do not move; limits for them are ignored.

    Raises:
        BadInput: the file is malformed, has an unknown key, or names none of the robot's joints. A name that is close
            to one of the robot's joints is refused, and the message names that joint.
    """
    document = _document(path)
    table = document.joint_limits
    names = [prefix + joint for joint in joints]
    if not any(name in table for name in names):
        before = [name.removesuffix(joints[0]) for name in table if name.endswith(joints[0])]
        hint = f"; they fit with --joint-prefix {before[0]!r}" if before and before[0] != prefix else ""
        raise BadInput(f"{path}: names {', '.join(table)}; the robot's joints are {', '.join(joints)}{hint}")
    for name in table:
        meant = _misspelt(name, [n for n in names if n not in table])
        if name not in names and name not in others and meant:
            raise BadInput(f"{path}: joint_limits.{name}: the robot has no such joint; did you mean {meant!r}?")
    arrays = {field.name: getattr(limits, field.name).copy() for field in dataclasses.fields(Limits)}
    for j, name in enumerate(names):
        if name in table:
            where = f"{path}: joint_limits.{name}"
            _apply(arrays, j, parse(JointTable, table[name], where), where)
    warnings = []
    for kind in ("velocity", "acceleration"):
        key = f"default_{kind}_scaling_factor"
        factor = getattr(document, key) or 1.0
        arrays[kind] *= factor
        if factor != 1:
            warnings.append(f"{path.name}: {key} {factor:g}: all limits on {kind} are multiplied by it")
    return Limits(**arrays), warnings


def _misspelt(name: str, joints: Sequence[str]) -> str | None:
    """The joint with a very similar name and the same digits: another number is another joint."""
    digits = [c for c in name if c.isdigit()]
    found = get_close_matches(name, [j for j in joints if [c for c in j if c.isdigit()] == digits], 1, 0.75)
    return found[0] if found else None


def names_in(path: Path) -> list[str]:
    """The joints that a limits file names."""
    return list(_document(path).joint_limits)


def _document(path: Path) -> LimitsTable:
    """The limits of a file, taken out of the parameters around them.

    Raises:
        BadInput: no such table, an unknown key, or a value that is none.
    """
    document = read_yaml(path)
    for _ in range(len(WRAPPERS)):
        if isinstance(document, dict) and "joint_limits" not in document:
            inner = [document[key] for key in WRAPPERS if isinstance(document.get(key), dict)]
            document = inner[0] if inner else document
    if not isinstance(document, dict) or "joint_limits" not in document:
        raise BadInput(f"{path}: no joint_limits table; expected MoveIt's joint_limits.yaml")
    return parse(LimitsTable, {str(key): value for key, value in document.items()}, str(path))


def _apply(arrays: dict[str, np.ndarray], j: int, row: JointTable, where: str) -> None:
    """Apply one joint's entry of a limits file to the bounds of joint j."""
    if row.has_position_limits is False:
        arrays["lower"][j], arrays["upper"][j] = -np.inf, np.inf
    for side, own in (("lower", row.min_position), ("upper", row.max_position)):
        arrays[side][j] = arrays[side][j] if own is None else own
    if row.has_soft_limits:
        for side, soft, narrower in (("lower", row.soft_lower_limit, max), ("upper", row.soft_upper_limit, min)):
            arrays[side][j] = arrays[side][j] if soft is None else narrower(arrays[side][j], soft)
    given = any(value is not None for value in (row.has_position_limits, row.min_position, row.max_position))
    if given and not arrays["lower"][j] < arrays["upper"][j]:
        raise BadInput(f"{where}: min_position is not below max_position")
    for kind in KINDS:
        if row.sizes(kind):
            arrays[kind][j] = min(row.sizes(kind))
        elif getattr(row, f"has_{kind}_limits") is False:
            arrays[kind][j] = np.inf
    arrays["acceleration"][j] = min(arrays["acceleration"][j], *row.sizes("deceleration"), np.inf)
