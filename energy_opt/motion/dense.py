"""A trajectory on a dense grid, from which limits and energy are computed.

The motion on the grid and the rigid body's torque there do not depend on effects of the drives. So they are cached by
the samples: a plan under several models, or one that compares baselines, computes them once.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from threading import Lock

import numpy as np

from energy_opt.effects import Effect
from energy_opt.motion.trajectory import Filled, Trajectory
from energy_opt.power import PowerModel
from energy_opt.power.drive_law import rigid_torque
from energy_opt.robot import RigidBody, Tool

LONG = 700_000  # largest grid [places times joints] that is kept: 40 MB
KEPT = 4 * LONG  # the same of all grids that are kept: a job's legs and baselines are judged again under other models


@dataclass(frozen=True, eq=False)
class Grid:
    """The motion of a trajectory at the places of a grid, and the rigid body's torque there under any model.

    time (M,) [s] from 0; q, v, a, jerk (M, n).
    """

    time: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    jerk: np.ndarray
    _torques: dict[tuple[RigidBody, tuple[Effect, ...]], np.ndarray] = field(default_factory=dict, repr=False)

    def torque(self, model: PowerModel, body: RigidBody) -> np.ndarray:
        """As `rigid_torque`, (M, n B) [N m]; models with the same payload, tilt and links share it."""
        out = []
        for one in model.bodies:
            key = body, tuple(effect for effect in one.effects if effect.stage == "rigid")
            if key not in self._torques:
                self._torques[key] = rigid_torque(one, body, self.q, self.v, self.a)
            out.append(self._torques[key])
        return out[0] if len(out) == 1 else np.hstack(out)


def grid_of(trajectory: Trajectory, factor: int) -> Grid:
    """A grid `factor` times denser than the samples of a trajectory; short grids are cached."""
    if factor * trajectory.position.size > LONG:
        return _dense_motion(trajectory, factor)
    key = _TrajectoryKey(trajectory), factor
    with _changing:
        found = _grids.pop(key, None)
    found = _dense_motion(trajectory, factor) if found is None else found
    with _changing:
        _grids[key] = found
        while sum(grid.q.size for grid in _grids.values()) > KEPT:  # the one that was used the longest time ago
            del _grids[next(iter(_grids))]
    return found


class _TrajectoryKey:
    """A trajectory as a key: equal to those with the same samples, whatever their effort and power."""

    def __init__(self, trajectory: Trajectory) -> None:
        self.trajectory = trajectory
        state = trajectory.time, trajectory.position, trajectory.velocity, trajectory.acceleration
        self._key = tuple(x.tobytes() for x in state)  # not their identities: a user may write into the arrays

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _TrajectoryKey) and self._key == other._key


def _dense_motion(trajectory: Trajectory, factor: int) -> Grid:
    q, v, a, jerk = trajectory.sample_denser(factor)
    # jerk jumps at samples: the larger of both values counts
    before, at = trajectory.jerk_before_samples(), jerk[factor::factor]
    jerk[factor::factor] = np.where(np.abs(before) > np.abs(at), before, at)
    return Grid(trajectory.denser(factor) - trajectory.time[0], q, v, a, jerk)


_grids: dict[tuple[_TrajectoryKey, int], Grid] = {}
_changing = Lock()


@dataclass(frozen=True)
class Dense:
    """A trajectory on a grid that is `factor` times denser than its samples, by Pinocchio's torque and the exact laws.

    time (M,) [s] from 0; q, v, a, jerk (M, n); rigid (M, n B) [N m] as `rigid_torque`, effort (M, n) the motors';
    power (M,) [W] and its parts by effect (M, parts); powers (M, K) [W] under each member of a mixture. Every
    `factor`-th place is a sample.
    """

    trajectory: Trajectory
    body: RigidBody
    factor: int
    time: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    jerk: np.ndarray
    rigid: np.ndarray
    effort: np.ndarray
    power: np.ndarray
    parts: np.ndarray
    powers: np.ndarray
    _tools: dict[Tool, tuple[np.ndarray, np.ndarray, np.ndarray]] = field(default_factory=dict, repr=False)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.trajectory.joints

    def tool_motion(self, tool: Tool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A tool's poses (M, 4, 4), velocity [m/s] and acceleration [m/s^2] of its origin (M, 3), in the base frame."""
        if tool not in self._tools:
            self._tools[tool] = self.body.frame_motion(tool.joint, np.array(tool.pose), self.q, self.v, self.a)
        return self._tools[tool]

    @cached_property
    def weight(self) -> np.ndarray:
        """Simpson's weights (M,) [s] of an integral over time; `factor` is even.

        At 4 ms between samples and ten places between them, the relative error of a smooth integral is about 1e-10; at
        a kink of a law the error is a tenth of a sample's share.
        """
        step = np.diff(self.trajectory.time) / self.factor
        pattern = np.tile([2.0, 4.0], self.factor // 2) / 3
        weight = np.append((step[:, None] * pattern).ravel(), 0.0)
        pairs = step / 3  # an interval's first and last place count once on either side
        weight[:: self.factor] = np.append(pairs, 0.0) + np.append(0.0, pairs)
        return weight

    @property
    def filled(self) -> Filled:
        """The trajectory with effort and power at its samples."""
        return self.trajectory.filled(self.effort[:: self.factor], self.power[:: self.factor])
