"""Bounds of joints with their units, and what is assumed where none is stated."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

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
            stated = f"velocity limit {velocity[j]:g} {speed}" if velocity[j] > 0 else "no velocity limit"
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
