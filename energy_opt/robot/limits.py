"""Joint limits and their units: the URDF's, overlaid by published ones, overlaid by the user's file with MoveIt's keys.

MoveIt's joint_limits.yaml has limits by joint name, and the scaling factors of speed and acceleration:

    default_velocity_scaling_factor: 1.0         in (0, 1]; all limits on velocity (acceleration) are multiplied by it
    default_acceleration_scaling_factor: 1.0
    joint_limits:
      <joint>:
        has_position_limits, min_position, max_position
        has_velocity_limits, max_velocity (and min_velocity, below 0)
        has_acceleration_limits, max_acceleration (and min_acceleration, below 0)
        has_deceleration_limits, max_deceleration (its size counts)
        has_jerk_limits, max_jerk
        has_effort_limits, max_effort
        has_soft_limits, soft_lower_limit, soft_upper_limit, k_position, k_velocity
        angle_wraparound

A number counts unless its `has_...` says false, which takes the limit away. Limits hold in both directions here: of two
different sizes the smaller one is used. A soft range narrows the position's; its gains k_... are the controller's. The
table may stand by itself, or where ROS parameters have it (robot_description_planning, ros__parameters).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.errors import BadInput, near
from energy_opt.files import read_yaml

TURNING = {"position": "rad", "velocity": "rad/s", "acceleration": "rad/s^2", "jerk": "rad/s^3", "effort": "N m"}
PLAIN = {"power": "W", "tool_speed": "m/s", "tool_acceleration": "m/s^2"}  # quantities that belong to no joint


def sliding(unit: str) -> str:
    """The unit for a sliding joint, from that for a turning one.

    >>> sliding("N m s/rad"), sliding("rad/s^2"), sliding("W/(N m)^2")
    ('N s/m', 'm/s^2', 'W/N^2')
    """
    return unit.replace("(N m)", "N").replace("N m", "N").replace("rad", "m")


def unit_of(kind: str, slides: bool = False) -> str:
    """Unit of a joint's position, velocity, ..., or of another bounded quantity; empty where it is not known."""
    unit = TURNING.get(kind)
    if unit is None:
        return PLAIN.get(kind, "")
    return sliding(unit) if slides else unit


ASSUMED_VELOCITY = np.pi  # [rad/s] assumed if no limit is known
RAMP = 5.0  # [1/s] acceleration over velocity limit if none is known: full speed in no less than 0.2 s
FASTEST = 50.0  # [rad/s^2] largest assumed limit: light arms with higher limits publish them
SHARPNESS = 100.0  # [1/s] jerk over acceleration limit if none is known: full acceleration in no less than 0.01 s
SMALLEST = 1e-6  # least usable limit, in SI units
PLACEHOLDER = 1e4  # a velocity limit of this size or more counts as none
DOUBTFUL_VELOCITY = 100.0  # [rad/s] a limit from here on causes a warning, but is used
TURNS = 50.0  # [rad] largest plausible position of a joint without limits: eight turns


@dataclass(frozen=True)
class Limits:
    """Bounds of each joint, (n,) each; inf if there is none.

    Attributes:
        lower, upper: position [rad], or [m] of joints that slide.
        velocity: [rad/s, m/s]. acceleration: [rad/s^2, m/s^2]. jerk: [rad/s^3, m/s^3]. effort: [N m, N]. These four
            hold in both directions.
    """

    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    jerk: np.ndarray
    effort: np.ndarray

    @property
    def near_zero(self) -> np.ndarray:
        """The positions (n,) nearest to zero that are inside."""
        return np.clip(np.zeros(len(self.lower)), self.lower, self.upper)

    @property
    def ranges(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper end (n,) of each joint's range; a joint without limits counts as one turn, [-pi, pi]."""
        bounded = np.isfinite(self.lower) & np.isfinite(self.upper)
        return np.where(bounded, self.lower, -np.pi), np.where(bounded, self.upper, np.pi)

    def replace(self, **bounds: np.ndarray) -> Limits:
        """The same limits with some of them changed."""
        return dataclasses.replace(self, **bounds)


def look_like_degrees(
    limits: Limits, position: np.ndarray, beyond: float, slides: Sequence[bool]
) -> tuple[int, int] | None:
    """Row and joint of the first position that only makes sense as degrees, None if positions may be radians.

    Args:
        position: (N, n) or (n,), said to be rad.
        beyond: how far outside a limit one must lie [rad], while in degrees all would be inside (or nearly).
        slides: (n,) True for joints without an angle, which are ignored.
    """
    q = np.where(np.asarray(slides), np.clip(0.0, limits.lower, limits.upper), np.atleast_2d(position))
    far = (q < limits.lower - beyond) | (q > limits.upper + beyond) | (np.abs(q) > TURNS)
    if not far.any():
        return None
    turned = np.radians(q)
    if not ((turned >= limits.lower - beyond) & (turned <= limits.upper + beyond)).all():
        return None
    row, joint = (int(k) for k in np.argwhere(far)[0])
    return row, joint


def with_assumptions(limits: Limits, joints: Sequence[str], slides: Sequence[bool]) -> tuple[Limits, list[str]]:
    """Limits with assumed values instead of zero, missing and placeholder limits of position and velocity.

    Missing limits on acceleration are RAMP times the velocity limit, at most FASTEST; missing limits on jerk are
    SHARPNESS times the acceleration limit. The robot's `sources` state that these are assumed. Efforts are not changed.

    Args:
        limits: as the files state them. joints: names. slides: (n,) which joints slide.

    Returns:
        The limits, and a warning for each assumed limit of position or velocity.
    """
    warnings: list[str] = []
    lower, upper = limits.lower.copy(), limits.upper.copy()
    velocity = limits.velocity.copy()
    for j, joint in enumerate(joints):
        speed = unit_of("velocity", slides[j])
        if not lower[j] < upper[j]:
            warnings.append(f"{joint}: position limits [{lower[j]:g}, {upper[j]:g}] are empty; assumed: none")
            lower[j], upper[j] = -np.inf, np.inf
        if not SMALLEST <= velocity[j] < PLACEHOLDER:
            warnings.append(f"{joint}: velocity limit {velocity[j]:g} {speed}; assumed: {ASSUMED_VELOCITY:.4g} {speed}")
            velocity[j] = ASSUMED_VELOCITY
        elif velocity[j] >= DOUBTFUL_VELOCITY:
            hint = "a placeholder?" if slides[j] else f"a placeholder, or {np.radians(velocity[j]):.4g} rad/s in deg/s?"
            warnings.append(f"{joint}: velocity limit {velocity[j]:g} {speed} ({hint}); assumed: as stated")
    acceleration = np.where(np.isfinite(limits.acceleration), limits.acceleration, np.minimum(RAMP * velocity, FASTEST))
    jerk = np.where(np.isfinite(limits.jerk), limits.jerk, SHARPNESS * acceleration)
    return Limits(lower, upper, velocity, acceleration, jerk, limits.effort), warnings


TURN = np.pi  # [rad or m] largest distance from the position nearest to 0


def postures(limits: Limits, count: int = 100, seed: int = 0) -> np.ndarray:
    """Postures (count, n) [rad or m]: the middle of all ranges, then random ones; near 0 within half a turn."""
    nearest = np.clip(0.0, limits.lower, limits.upper)
    low, high = np.maximum(limits.lower, nearest - TURN), np.minimum(limits.upper, nearest + TURN)
    q = np.random.default_rng(seed).uniform(low, high, (count, len(low)))
    q[0] = (low + high) / 2
    return q


KINDS = {"velocity": "min_velocity", "acceleration": "min_acceleration", "jerk": None, "effort": None}
FACTORS = {
    "default_velocity_scaling_factor": "velocity", "default_acceleration_scaling_factor": "acceleration",
}  # fmt: skip
FLAGS = (
    *(f"has_{kind}_limits" for kind in ("position", *KINDS, "deceleration", "soft")), "angle_wraparound",
)  # fmt: skip
NUMBERS = (
    *("min_position", "max_position"), *(f"max_{kind}" for kind in KINDS), *(key for key in KINDS.values() if key),
    *("max_deceleration", "soft_lower_limit", "soft_upper_limit", "k_position", "k_velocity"),
)  # fmt: skip
WRAPPERS = ("/**", "ros__parameters", "robot_description_planning", "move_group")
OTHERS = ("cartesian_limits",)  # keys of other planners in the same file; ignored


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
    factors, table = _document(path)
    names = [prefix + joint for joint in joints]
    known = {joint: table[name] for joint, name in zip(joints, names, strict=True) if name in table}
    if not known:
        shown = ", ".join(map(str, table))
        before = [str(name).removesuffix(joints[0]) for name in table if str(name).endswith(joints[0])]
        hint = f"; they fit with --joint-prefix {before[0]!r}" if before and before[0] != prefix else ""
        raise BadInput(f"{path}: names {shown}; the robot's joints are {', '.join(joints)}{hint}")
    for name in map(str, table):
        meant = _misspelt(name, [n for n in names if n not in table])
        if name not in names and name not in others and meant:
            raise BadInput(f"{path}: joint_limits.{name}: the robot has no such joint; did you mean {meant!r}?")
    arrays = {field.name: getattr(limits, field.name).copy() for field in dataclasses.fields(Limits)}
    for j, joint in enumerate(joints):
        if joint in known:
            _apply(arrays, j, known[joint], f"{path}: joint_limits.{prefix}{joint}")
    warnings = []
    for key, factor in factors.items():
        arrays[FACTORS[key]] *= factor
        if factor != 1:
            warnings.append(f"{path.name}: {key} {factor:g}: all limits on {FACTORS[key]} are multiplied by it")
    return Limits(**arrays), warnings


def _misspelt(name: str, joints: Sequence[str]) -> str | None:
    """The joint with a very similar name and the same digits: another number is another joint."""
    digits = [c for c in name if c.isdigit()]
    found = get_close_matches(name, [j for j in joints if [c for c in j if c.isdigit()] == digits], 1, 0.75)
    return found[0] if found else None


def names_in(path: Path) -> list[str]:
    """The joints that a limits file names."""
    return [str(name) for name in _document(path)[1]]


def _document(path: Path) -> tuple[dict[str, float], dict[Any, dict[str, Any]]]:
    """Scaling factors that are given, and the table of joints; every key of both is known."""
    document = read_yaml(path)
    for _ in range(len(WRAPPERS)):
        if isinstance(document, dict) and "joint_limits" not in document:
            inner = [document[key] for key in WRAPPERS if isinstance(document.get(key), dict)]
            document = inner[0] if inner else document
    table = document.get("joint_limits") if isinstance(document, dict) else None
    if not isinstance(document, dict) or not isinstance(table, dict) or not table:
        raise BadInput(f"{path}: no joint_limits table; expected MoveIt's joint_limits.yaml")
    factors = _checked(document, (), tuple(FACTORS), ("joint_limits", *OTHERS), f"{path}", f"{path}: ")
    for key, value in factors.items():
        if not 0 < value <= 1:
            raise BadInput(f"{path}: {key} = {value:g}; expected a factor above 0 and at most 1")
    out = {}
    for name, row in table.items():
        where = f"{path}: joint_limits.{name}"
        if not isinstance(row, dict):
            raise BadInput(f"{where}: not a table of limits")
        out[name] = _checked(row, FLAGS, NUMBERS, (), where, f"{where}.")
    return factors, out


def _checked(
    table: Mapping[Any, Any], flags: Sequence[str], numbers: Sequence[str], others: Sequence[str], where: str, at: str
) -> dict[str, Any]:
    """Flags and numbers that a table has; `at` is the prefix of a key in messages.

    Raises:
        BadInput: a key is not known, a flag is not true or false, or a value is not a number.
    """
    out: dict[str, Any] = {}
    known = (*flags, *numbers, *others)
    for key, value in table.items():
        if key not in known:
            raise BadInput(f"{where}: unknown key {key!r}{near(str(key), known) or '; known are ' + ', '.join(known)}")
        if key in flags:
            if not isinstance(value, bool):
                raise BadInput(f"{at}{key} = {value!r}; expected true or false, without quotes")
            out[key] = value
        elif key in numbers and value is not None:
            try:
                if isinstance(value, bool) or not isinstance(value, (int, float)) or np.isnan(value):
                    raise TypeError
                out[key] = float(value)
            except (TypeError, OverflowError):
                raise BadInput(f"{at}{key} = {str(value)[:40]!r} is not a number") from None
    return out


def _apply(arrays: dict[str, np.ndarray], j: int, row: Mapping[str, Any], where: str) -> None:
    """Apply one joint's entry of a limits file to the bounds of joint j."""
    low, high = row.get("min_position"), row.get("max_position")
    if row.get("has_position_limits", low is not None or high is not None):
        arrays["lower"][j] = arrays["lower"][j] if low is None else low
        arrays["upper"][j] = arrays["upper"][j] if high is None else high
    elif "has_position_limits" in row:
        arrays["lower"][j], arrays["upper"][j] = -np.inf, np.inf
    if row.get("has_soft_limits", False):
        for key, side, narrower in (("soft_lower_limit", "lower", max), ("soft_upper_limit", "upper", min)):
            if (value := row.get(key)) is not None:
                arrays[side][j] = narrower(arrays[side][j], value)
    if ("has_position_limits" in row or low is not None or high is not None) and not (
        arrays["lower"][j] < arrays["upper"][j]
    ):
        raise BadInput(f"{where}: min_position is not below max_position")
    for kind, lowest in KINDS.items():
        size = _size(row, kind, lowest, where)
        if row.get(f"has_{kind}_limits", size is not None):
            if size is None:
                raise BadInput(f"{where}: has_{kind}_limits is true, but max_{kind} is missing")
            arrays[kind][j] = size
        elif f"has_{kind}_limits" in row:
            arrays[kind][j] = np.inf
    braking = row.get("max_deceleration")
    if row.get("has_deceleration_limits", braking is not None):
        if not braking or abs(braking) < SMALLEST:
            raise BadInput(f"{where}: has_deceleration_limits is true, but max_deceleration is missing or as good as 0")
        arrays["acceleration"][j] = min(arrays["acceleration"][j], abs(braking))


def _size(row: Mapping[str, Any], kind: str, lowest: str | None, where: str) -> float | None:
    """Bound on a magnitude, from max_<kind> and the key for the other direction; None if there is none."""
    if row.get(f"has_{kind}_limits") is False:
        return None
    largest = row.get(f"max_{kind}")
    other = None if lowest is None else row.get(lowest)
    if largest is not None and largest <= 0:
        raise BadInput(f"{where}.max_{kind} = {largest:g}; expected a number above 0")
    if other is not None and other >= 0:
        raise BadInput(f"{where}.{lowest} = {other:g}; expected a number below 0")
    given = [abs(value) for value in (largest, other) if value is not None]
    if given and min(given) < SMALLEST:
        raise BadInput(f"{where}.max_{kind} = {min(given):g}; expected {SMALLEST:g} or more")
    return min(given) if given else None
