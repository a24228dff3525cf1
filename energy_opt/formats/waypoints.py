"""Samples from files: positions of named joints, with times if the file has them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.motion.trajectory import Trajectory
from energy_opt.tables import IMPORT

LARGEST = 1e9  # largest plausible value [rad or m, and per second, ...]
SHORTEST = 1e-10  # [s] least step between two samples: messages count nanoseconds
LONGEST = 1e5  # [s] longest motion, more than a day: times of a longer one are in another unit
FEWEST = 8  # least samples for comparing rates
# factor from which rates are not those of the positions; largest share of the squares that it may leave unexplained
SLIP, UNLIKE = 1.25, 0.1
LEAST_CHANGE = 0.01  # [rad, m, and per second] of a joint whose rates are compared: smaller changes may be errors
KINDS = ("position", "velocity", "acceleration", "effort")


@dataclass(frozen=True)
class Samples:
    """Positions (N, n) of joints by name [rad or m], and further signals of a file.

    Attributes:
        where: the file, and the place in it where that is not plain, for messages.
        joints: (n,) names, as the file has them.
        time: (N,) s; None where the samples are waypoints, to be passed at any time.
        velocity, acceleration, effort: (N, n), None where the file has none.
        untimed: how the file could state times, for the message where they are missing.
        planned: a plan for a controller, which begins and ends at rest unless it states otherwise; a recording may be
            in motion at both ends.
        notes: remarks for the reader, a line each.
        timed: the unit of the times is sure; a table's header may not name it.
        steps: [Hz] of a controller that takes the positions one by one; None: it moves on between them.
    """

    where: str
    joints: tuple[str, ...]
    position: np.ndarray
    time: np.ndarray | None = None
    velocity: np.ndarray | None = None
    acceleration: np.ndarray | None = None
    effort: np.ndarray | None = None
    untimed: str = "a trajectory has rising times"
    planned: bool = False
    notes: tuple[str, ...] = ()
    timed: bool = True
    steps: float | None = None

    def __post_init__(self) -> None:
        for kind in KINDS:
            block = getattr(self, kind)
            if block is not None and block.shape != self.position.shape:
                raise BadInput(
                    f"{self.where}: {kind} has shape {block.shape}; expected that of the positions, "
                    f"{self.position.shape}"
                )
            if block is not None and not np.isfinite(block).all():
                raise BadInput(f"{self.where}: {kind} has values that are not finite")
            if block is not None and block.size and np.abs(block).max() > LARGEST:
                raise BadInput(f"{self.where}: {kind} {np.abs(block).max():g}; expected at most {LARGEST:g}")
        if self.time is not None and (len(self.time) != len(self.position) or not np.isfinite(self.time).all()):
            raise BadInput(f"{self.where}: expected one finite time for each of the {len(self.position)} rows")
        if self.time is not None and len(self.time) > 1:
            shortest = float(np.diff(self.time).min())
            if np.abs(self.time).max() > 10 * LARGEST or shortest < SHORTEST:
                raise BadInput(
                    f"{self.where}: times up to {np.abs(self.time).max():g} s, {shortest:g} s apart; expected steps of "
                    f"{SHORTEST:g} s or more"
                )
            if self.time[-1] - self.time[0] > LONGEST:
                raise BadInput(
                    f"{self.where}: lasts {self.time[-1] - self.time[0]:g} s; expected at most {LONGEST:g} (are its "
                    "times in ms, us or ns? expected seconds)"
                )

    @property
    def doubtful(self) -> np.ndarray | None:
        """Times (N,) whose unit is not sure; None where there are none."""
        return None if self.timed else self.time

    def of(self, joints: Sequence[str], prefix: str = "", following: Iterable[str] = ()) -> Samples:
        """The same samples for the robot's `joints`, in their order; in the file their names begin with `prefix`.

        Joints of the file that the robot does not have are left out. A note names those that move, except those
        `following` the robot's.

        Raises:
            BadInput: a joint of the robot is missing; says which prefix would find all of them, if there is one.
        """
        wanted = [prefix + joint for joint in joints]
        missing = [name for name in wanted if name not in self.joints]
        if missing:
            names = ", ".join(self.joints[:12]) + (", ..." if len(self.joints) > 12 else "")
            other = fitting_prefix(self.joints, joints)
            hint = f"; they fit with --joint-prefix {other!r}" if other else ""
            if other is None and self.time is not None:
                hint = f"; is it another robot's (--robot, --lock)? {IMPORT}"
            raise BadInput(f"{self.where}: joint {missing[0]} is missing; the file has {names}{hint}")
        index = [self.joints.index(name) for name in wanted]
        columns = {kind: getattr(self, kind) for kind in KINDS}
        chosen: dict[str, Any] = {kind: block if block is None else block[:, index] for kind, block in columns.items()}
        known = {*wanted, *(prefix + name for name in following)}
        moves = np.ptp(self.position, axis=0) > LEAST_CHANGE
        others = [name for name, moving in zip(self.joints, moves, strict=True) if moving and name not in known]
        if others:
            names = ", ".join(others[:12]) + (", ..." if len(others) > 12 else "")
            note = f"{self.where}: motion of {names} does not count: the arm has no such joint, or it is locked"
            chosen["notes"] = (*self.notes, note)
        return replace(self, joints=tuple(joints), **chosen)

    def trajectory(self) -> Trajectory:
        """The samples as a trajectory; velocity and acceleration by cubic splines where they are missing.

        Raises:
            BadInput: there are no times, or fewer than two samples.
        """
        from scipy.interpolate import CubicSpline

        if self.time is None:
            raise BadInput(f"{self.where}: waypoints without times; {self.untimed}")
        if len(self.time) < 2:
            raise BadInput(f"{self.where}: one row; a trajectory has at least two")
        velocity, acceleration = self.velocity, self.acceleration
        self._check_rates("velocity", velocity, self.position)
        if velocity is None:
            resting = np.full(2, True) if self.planned else _resting(self.time, self.position)
            ends = tuple("clamped" if still else "not-a-knot" for still in resting)
            velocity = CubicSpline(self.time, self.position, bc_type=ends)(self.time, 1)
            velocity[[0, -1]] *= ~resting[:, None]
        self._check_rates("acceleration", acceleration, velocity)
        if acceleration is None:
            acceleration = CubicSpline(self.time, velocity)(self.time, 1)
        return Trajectory(self.joints, self.time, self.position, velocity, acceleration, self.effort)

    def _check_rates(self, kind: str, given: np.ndarray | None, of: np.ndarray) -> None:
        """Refuse rates (N, n) that differ from those of `of` (N, n) by one factor: their unit or timing is wrong.

        What the rates add up to is compared with `of`: sums, unlike differences, contain little noise. Between two
        samples a rate may be anywhere between theirs, as at a step of acceleration: by as much a factor may differ.

        Raises:
            BadInput: names the joint, and says by which factor they differ.
        """
        from scipy.integrate import cumulative_trapezoid

        if given is None or self.time is None or len(self.time) < FEWEST:
            return
        total = cumulative_trapezoid(given, self.time, axis=0, initial=0.0)
        total, change = total - total.mean(axis=0), of - of.mean(axis=0)
        between = np.abs(np.diff(given, axis=0)).T @ np.diff(self.time)
        for joint, summed, wanted, jumps in zip(self.joints, total.T, change.T, between, strict=True):
            if np.ptp(wanted) < LEAST_CHANGE:
                continue
            size = float(wanted @ wanted)
            factor = float(summed @ wanted) / size
            left = float(np.sum((summed - factor * wanted) ** 2))
            most = SLIP * (1 + jumps / float(np.ptp(wanted)))
            if left < UNLIKE * factor**2 * size and not 1 / most < factor < most:
                unit = "deg" if abs(np.degrees(1) / factor - 1) < 0.1 else "another unit, direction or timing"
                raise BadInput(
                    f"{self.where}: {kind} of {joint} is {factor:.4g} times the rate at which its "
                    f"{'position changes' if of is self.position else 'velocity changes'}: in {unit}? Expected rad and "
                    f"s (m for joints that slide): multiply by {1 / factor:.4g}"
                )


def _resting(time: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Whether a motion rests at its start and end (2,): there a spline's velocity is zero within its own error.

    Its error is its difference from the velocity of a spline through every second sample. A few samples are a plan,
    which rests at its ends.
    """
    from scipy.interpolate import CubicSpline

    if len(time) < FEWEST:
        return np.full(2, True)
    fine = CubicSpline(time, position)(time[[0, -1]], 1)
    halves = np.s_[::2], np.s_[(len(time) - 1) % 2 :: 2]  # with the first sample, and with the last
    coarse = [CubicSpline(time[k], position[k])(end, 1) for k, end in zip(halves, time[[0, -1]], strict=True)]
    return np.asarray(np.linalg.norm(fine, axis=1) <= np.linalg.norm(fine - coarse, axis=1))


def repeated(time: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Mask (N,) of samples with the time and the positions of the one before: some planners repeat an end."""
    return np.concatenate([[False], (np.diff(time) == 0) & (np.diff(position, axis=0) == 0).all(axis=1)])


def fitting_prefix(names: Sequence[str], joints: Sequence[str]) -> str | None:
    """The common prefix of all `joints` in `names`; None if there is none."""
    for name in names:
        if name.endswith(joints[0]):
            prefix = name[: len(name) - len(joints[0])]
            if all(prefix + joint in names for joint in joints):
                return prefix
    return None
