"""Joint limits: the URDF's, overlaid by published ones, overlaid by the user's file with MoveIt's keys."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.robot.units import unit_of

ASSUMED_VELOCITY = np.pi  # [rad/s] where no limit is known
RAMP = 5.0  # [1/s] acceleration over velocity limit where none is known: full speed in no less than 0.2 s
FASTEST = 50.0  # [rad/s^2] and no more than this: the light arms that do more publish it
SHARPNESS = 100.0  # [1/s] jerk over acceleration limit where none is known: full acceleration in no less than 0.01 s
SMALLEST = 1e-6  # in SI units: slower, weaker than this nothing moves
PLACEHOLDER = 1e4  # a velocity limit of this size or more is no limit
DOUBTFUL_VELOCITY = 100.0  # [rad/s] a limit from here on is named, but used
TURNS = 50.0  # [rad] further no joint without limits is turned; eight turns


@dataclass(frozen=True)
class Limits:
    """Bounds per joint, (n,) each, inf where there is none.

    lower, upper [rad]; velocity [rad/s], acceleration [rad/s^2], jerk [rad/s^3] and effort [N m] hold both ways; of
    joints that slide m in place of rad, and N.
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

    def replace(self, **bounds: np.ndarray) -> Limits:
        """The same limits with some of them changed."""
        return dataclasses.replace(self, **bounds)


def look_like_degrees(
    limits: Limits, position: np.ndarray, beyond: float, slides: Sequence[bool]
) -> tuple[int, int] | None:
    """Row and joint of the first position that only makes sense as degrees, None where positions may be radians.

    Args:
        position: (N, n) or (n,), said to be rad.
        beyond: how far outside a limit one must lie [rad], while in degrees all would be inside (or nearly).
        slides: (n,) the joints that have no angle; they are not looked at.
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
    """Replace zero, missing and placeholder limits of position and velocity by assumptions, and name them in warnings.

    Acceleration and jerk always have a bound; that these are assumed is said with the robot's `sources`.
    Efforts are those that `believed_efforts` leaves. `slides` (n,) are the joints with m in place of rad.
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
