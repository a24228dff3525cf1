"""Limits of joints: as files state them, completed by assumptions; and files like MoveIt's joint_limits.yaml.

Limits of such a file hold in both directions: of two different sizes the smaller one is used. Its table may stand by
itself, or where ROS parameters have it (robot_description_planning, ros__parameters)."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import AfterValidator, Field, StrictBool, model_validator

from energy_opt.errors import BadInput, read_each, refuse
from energy_opt.files import is_number, read_yaml
from energy_opt.schema import Table, parse, reads

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
TURNS = 50.0  # [rad, m] largest plausible position of a joint: eight turns
Factors = Mapping[str, float]  # by which all limits on "velocity" and "acceleration" are multiplied
UNSCALED: Factors = {"velocity": 1.0, "acceleration": 1.0}


@dataclass(frozen=True, eq=False)
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

    def scaled(self, factors: Factors, assumed_jerk: np.ndarray) -> Limits:
        """The same limits times `factors`; jerks that are assumed (n,) stay in proportion to the accelerations."""
        by = factors["acceleration"]
        jerk = np.where(assumed_jerk, by * self.jerk, self.jerk)
        return self.replace(
            velocity=factors["velocity"] * self.velocity, acceleration=by * self.acceleration, jerk=jerk
        )


def look_like_degrees(
    limits: Limits, position: np.ndarray, beyond: float, slides: Sequence[bool], turns: float = np.inf
) -> tuple[int, int] | None:
    """Row and joint of the first position that only makes sense as degrees, None if positions may be radians.

    Args:
        position: (N, n) or (n,), said to be rad.
        beyond: how far outside a limit one must lie [rad], while in degrees all would be inside (or nearly).
        slides: (n,) True for joints without an angle, which are ignored.
        turns: the largest plausible position [rad] of a joint without limits; many turns are possible.
    """
    endless = np.isinf(limits.lower) & np.isinf(limits.upper)
    q = np.where(np.asarray(slides), np.clip(0.0, limits.lower, limits.upper), np.atleast_2d(position))
    far = (q < limits.lower - beyond) | (q > limits.upper + beyond) | ((np.abs(q) > turns) & endless)
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
        elif TURNS <= max(abs(lower[j]), abs(upper[j])) < np.inf:
            unit, other = ("m", "mm") if slides[j] else ("rad", "degrees")
            warnings.append(
                f"{joint}: position limits [{lower[j]:g}, {upper[j]:g}] {unit} (are these {other}?); assumed: as stated"
            )
        if not SMALLEST <= velocity[j] < PLACEHOLDER:
            stated = f"velocity limit {velocity[j]:g} {speed}" if 0 < velocity[j] < np.inf else "no velocity limit"
            warnings.append(f"{joint}: {stated}; assumed: {ASSUMED_VELOCITY:.4g} {speed}")
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
        kinds = [kind for kind in ("position", *KINDS, "deceleration") if row.get(f"has_{kind}_limits") is False]
        off = [f"{extreme}_{kind}" for kind in kinds for extreme in EXTREMES]
        return {key: value for key, value in row.items() if key not in off}

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
) -> tuple[Limits, Factors, list[str]]:
    """`limits` with those of a joint_limits.yaml instead, its factors, and warnings.

    A warning names each factor that is not 1, and each limit that is removed although one is assumed in its place.

    The factors are for the complete limits: they scale assumed ones, too.

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
    absent = [name for name in names if name not in table]
    refuse(
        f"{path}: joint_limits.{name}: the robot has no such joint; did you mean {meant!r}?"
        for name in table
        if name not in names and name not in others and (meant := _misspelt(name, absent))
    )
    arrays = {field.name: getattr(limits, field.name).copy() for field in dataclasses.fields(Limits)}
    entries = ((arrays, j, table.get(name, {}), f"{path}: joint_limits.{name}") for j, name in enumerate(names))
    read_each(_apply, entries)
    factors, warnings = {}, []
    for kind in ("acceleration", "jerk"):  # `with_assumptions` says so of velocities
        removed = np.isfinite(getattr(limits, kind)) & np.isinf(arrays[kind])
        if removed.any():
            listed = ", ".join(joint for joint, without in zip(joints, removed, strict=True) if without)
            warnings.append(f"{listed}: {path.name} removes the limit on {kind}; an assumed one replaces it")
    for kind in UNSCALED:
        key = f"default_{kind}_scaling_factor"
        factors[kind] = factor = getattr(document, key) or 1.0
        if factor != 1:
            warnings.append(f"{path.name}: {key} {factor:g}: all limits on {kind} are multiplied by it")
    return Limits(**arrays), factors, warnings


def _misspelt(name: str, joints: Sequence[str]) -> str | None:
    """The joint with a very similar name and the same digits: another number is another joint."""
    digits = [c for c in name if c.isdigit()]
    found = get_close_matches(name, [j for j in joints if [c for c in j if c.isdigit()] == digits], 1, 0.75)
    return found[0] if found else None


def names_in(path: Path) -> list[str]:
    """The joints that a limits file names."""
    return list(_document(path).joint_limits)


def limits_in(document: Any) -> dict[Any, Any] | None:
    """The table with `joint_limits` that a document is, or holds; None without one."""
    for _ in range(len(WRAPPERS)):
        if isinstance(document, dict) and "joint_limits" not in document:
            inner = [document[key] for key in WRAPPERS if isinstance(document.get(key), dict)]
            document = inner[0] if inner else document
    return document if isinstance(document, dict) and "joint_limits" in document else None


def _document(path: Path) -> LimitsTable:
    """The limits of a file, taken out of the parameters around them.

    Raises:
        BadInput: no such table, an unknown key, or a value that is none.
    """
    document = limits_in(read_yaml(path))
    if document is None:
        raise BadInput(f"{path}: no joint_limits table; expected MoveIt's joint_limits.yaml")
    return parse(LimitsTable, {str(key): value for key, value in document.items()}, str(path))


def _apply(arrays: dict[str, np.ndarray], j: int, entry: dict[str, Any], where: str) -> None:
    """Apply one joint's entry of a limits file to the bounds of joint j; BadInput that begins with `where`."""
    row = parse(JointTable, entry, where)
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
