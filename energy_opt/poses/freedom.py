"""Better positions within a pose's freedom: redundancy, free axes, tolerance.

Costs are functions of joint positions that are cheap to evaluate. After a solve the cost is that of the solved motion,
bent towards the other end,

    q(t) + (end' - end) s(t),   s(x) = x^3 (10 - 15 x + 6 x^2),

an upper bound of the least energy with that end. At an optimum without binding limits it has the same derivative with
respect to the end (envelope theorem), so a step that lowers it lowers the energy of the next solve.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from energy_opt.cell.cell import Cell
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.reshape.open import bending
from energy_opt.motion.trajectory import Trajectory
from energy_opt.poses.distance import keeps
from energy_opt.poses.estimate import energies
from energy_opt.poses.inverse import LENGTH, SMALL, ToolKinematics, jacobian_of, solve
from energy_opt.poses.pose import TURNS, Freedom, Pose, about

Cost = Callable[[np.ndarray], np.ndarray]  # (M, n) positions to (M,) J

STEP = 1e-3  # [rad, m] step of difference quotients
SMALL_STEP = 1e-6  # [rad, m] the same, for values in free directions
FARTHEST = 0.6  # [rad, m] longest step
SHARES = np.array([1.6, 1.0, 0.5, 0.2, 0.06, 0.02])  # shares of a step to try
ROUNDS = 10
FLAT = 1e-6  # relative: singular values of the pose's Jacobian below this leave a direction free
WIDE = 1e-5  # [m, rad] least tolerance worth using
LESS = 1.0, 0.8, 0.5  # shares of a tolerance to try: free directions turn with the pose, and their range may end there
MARGIN = 5e-9  # [m, rad] unused part of a tolerance, for errors of inverse kinematics
SAMPLES = 81
PLACES = 181  # along a free turn: every two degrees
PRICE = 10.0  # penalty for broken limits: times the loss and the squared excess; real motions adapt to limits locally
BINDING = 0.98  # share of a limit from which it counts as binding


def has_freedom(tool: ToolKinematics, pose: Pose) -> bool:
    """True if a pose leaves a continuum of joint positions."""
    return bool(pose.free) or tool.moving.sum() > 6 or max(pose.tolerance) > WIDE


def places(pose: Pose) -> tuple[np.ndarray, float]:
    """Poses (K, 4, 4) of the tool along the only free turn of a pose, and the distance [m] of others from these.

    It is that of a point `LENGTH` from the tool's origin; infinite if other directions are free.
    """
    turn = pose.free[0] if pose.free else Freedom("rz", 0.0, 0.0)
    if len(pose.free) > 1 or turn.axis not in TURNS:
        return pose.matrix[None], np.inf
    low, high = (turn.low, turn.high) if turn.high - turn.low < 2 * np.pi else (-np.pi, np.pi)
    turns = np.tile(np.eye(4), (PLACES, 1, 1))
    turns[:, :3, :3] = about(TURNS.index(turn.axis), np.linspace(low, high, PLACES))
    return pose.matrix @ turns, pose.tolerance[0] + LENGTH * (pose.tolerance[1] + (high - low) / PLACES)


def jacobian(tool: ToolKinematics, pose: Pose, q: np.ndarray) -> np.ndarray:
    """Derivative (6, n) of the pose's error at q (n,); free directions are excluded, whatever their range."""
    open_ = opened(pose)
    return jacobian_of(tool, open_, q[None], tool.pose_error(open_, q[None]))[0]


def opened(pose: Pose) -> Pose:
    """The pose with its free directions unbounded."""
    return replace(pose, free=tuple(Freedom(f.axis) for f in pose.free))


def _changes(tool: ToolKinematics, pose: Pose, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Singular values of the pose's Jacobian at q (n,), and unit directions (K, n) of the joints that move the tool."""
    _, s, vt = np.linalg.svd(jacobian(tool, pose, q)[:, tool.moving])
    out = np.zeros((len(vt), len(q)))
    out[:, tool.moving] = vt
    return s, out


def directions(tool: ToolKinematics, pose: Pose, q: np.ndarray) -> np.ndarray:
    """Unit directions (K, n) at q (n,) along which the pose is kept."""
    s, vt = _changes(tool, pose, q)
    rank = int(np.sum(s > FLAT * max(s.max(), 1e-12) + 1e-5))
    return np.asarray(vt[rank:])


class PosedGoal:
    """Positions at which the tool keeps a pose, over which an end or a via point of a curve moves: a `Surface`.

    With e(q) the pose's error, J its derivative, n_i the tangents, the surface bends by -J^+ e''[n_i, n_j].

    Args:
        q: (n,) positions that reach the pose.
        work: work of ending at positions (K, n) in addition to that of the motion, (K,) [J].
    """

    def __init__(self, tool: ToolKinematics, pose: Pose, q: np.ndarray, work: Cost) -> None:
        self._tool, self._pose, self._open, self.work = tool, pose, opened(pose), work
        self._first = directions(tool, pose, q)
        self.count = len(self._first)

    def along(self, q: np.ndarray) -> np.ndarray:
        """Orthonormal tangents (count, n) at q (n,): those at the first positions, turned onto the surface there."""
        vt = _changes(self._tool, self._pose, q)[1]
        kept = vt[len(vt) - self.count :]
        left, _, right = np.linalg.svd(self._first @ kept.T)
        return np.asarray(left @ right @ kept)

    def bend(self, q: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Second derivatives (count, count, n) by steps along the tangents, from differences of the pose's error."""
        missed = bending(lambda at: self._tool.pose_error(self._open, at), q, along)
        return np.asarray(-missed @ np.linalg.pinv(jacobian(self._tool, self._pose, q), rcond=1e-4).T)

    def reached(self, q: np.ndarray, step: np.ndarray) -> np.ndarray:
        """The result of inverse kinematics from q + step (n,); q itself if it fails."""
        found, error = solve(self._tool, self._pose, (q + step)[None])
        return found[0] if error[0] < SMALL else q

    def ranges(self, q: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Values (F,) in the free directions, slopes (F, count) along the tangents, and the ranges' ends."""
        around = np.vstack([q, q + SMALL_STEP * along, q - SMALL_STEP * along])
        value = self._tool.free_values(self._pose, around)
        plus, minus = value[1 : 1 + self.count], value[1 + self.count :]
        low, high = (np.array([getattr(f, end) for f in self._pose.free]) for end in ("low", "high"))
        return value[0], (plus - minus).T / (2 * SMALL_STEP), low, high


def improved(tool: ToolKinematics, pose: Pose, q: np.ndarray, cost: Cost, cell: Cell | None) -> np.ndarray:
    """Positions (n,) near q that reach the pose within its tolerance, keep the clearance, and cost no more.

    Args:
        q: (n,) [rad, m] positions that reach the pose. cost: [J] of positions (M, n), which may be infinite.
        cell: bodies to keep clear of, or no nearer than at q; None for nothing.
    """
    best = _descended(tool, pose, q, cost, cell)
    moved = used(tool, pose, best, cost)
    if moved is None:
        return best
    shifted, at = moved
    better = _descended(tool, shifted, at, cost, cell, ROUNDS // 3)
    for found in (better, at):
        if inside(tool, pose, found) and cost(found[None])[0] < cost(best[None])[0] and keeps(cell, found, q):
            return found
    return best


def _descended(
    tool: ToolKinematics, pose: Pose, q: np.ndarray, cost: Cost, cell: Cell | None, rounds: int = ROUNDS
) -> np.ndarray:
    """Newton steps, direction by direction, along the pose's freedom; each is followed by inverse kinematics."""
    limits = tool.robot.limits
    now, best = float(cost(q[None])[0]), q
    for _ in range(rounds if np.isfinite(now) else 0):
        along = directions(tool, pose, best)
        if not len(along):
            return best
        slope, bend = _differences(cost, best, along, now)
        size = np.abs(slope) / np.maximum(np.abs(bend), np.abs(slope) / FARTHEST + 1e-12)
        step = -(np.sign(slope) * np.minimum(size, FARTHEST)) @ along
        if np.abs(step).max() < 1e-5:
            return best
        trials, error = solve(tool, pose, np.clip(best + SHARES[:, None] * step, limits.lower, limits.upper))
        trials = trials[error < SMALL]
        if not len(trials):
            return best
        costs = cost(trials)
        order = [k for k in np.argsort(costs).tolist() if costs[k] < now]
        found = next((k for k in order if keeps(cell, trials[k], q)), None)
        if found is None:
            return best
        gain, now, best = now - costs[found], float(costs[found]), trials[found]
        if gain < 1e-6 * abs(now):
            return best
    return best


def _differences(cost: Cost, q: np.ndarray, along: np.ndarray, now: float) -> tuple[np.ndarray, np.ndarray]:
    """First and second derivatives (K,) of a cost along directions (K, n); one-sided if one neighbour's is infinite."""
    plus, minus = cost(np.vstack([q + STEP * along, q - STEP * along])).reshape(2, -1)
    plus, minus = (
        np.where(np.isfinite(one), one, np.where(np.isfinite(other), 2 * now - other, now))
        for one, other in ((plus, minus), (minus, plus))
    )
    return (plus - minus) / (2 * STEP), (plus + minus - 2 * now) / STEP**2


def used(tool: ToolKinematics, pose: Pose, q: np.ndarray, cost: Cost) -> tuple[Pose, np.ndarray] | None:
    """The pose moved to the cheapest edge of its tolerance, and positions (n,) that reach it; None if none do.

    Args:
        tool: its kinematics. pose: with its tolerance. q: (n,) positions that reach it. cost: of positions (K, n).
    """
    if max(pose.tolerance) <= WIDE:
        return None
    slope, _ = _differences(cost, q, np.eye(len(q)), float(cost(q[None])[0]))
    by_error = np.linalg.pinv(jacobian(tool, pose, q), rcond=1e-4).T @ slope
    parts = []
    for part, allowed in zip((by_error[:3], by_error[3:]), pose.tolerance, strict=True):
        size = float(np.linalg.norm(part))
        parts.append(-part / size * (allowed - MARGIN) if size > 0 and allowed > WIDE else np.zeros(3))
    for share in LESS:
        at = pose.matrix.copy()
        at[:3, 3] += share * at[:3, :3] @ parts[0]
        at[:3, :3] = at[:3, :3] @ Rotation.from_rotvec(share * parts[1]).as_matrix()
        shifted = replace(pose, matrix=at)
        found, error = solve(tool, shifted, q[None])
        if error[0] < SMALL and inside(tool, pose, found[0]):
            return shifted, found[0]
    return None


def inside(tool: ToolKinematics, pose: Pose, q: np.ndarray) -> bool:
    """True if positions q (n,) reach a pose within its tolerance, with a small margin."""
    sizes = (float(np.linalg.norm(x)) for x in np.split(tool.pose_error(pose, q[None])[0], 2))
    return all(size <= allowed - MARGIN / 10 for size, allowed in zip(sizes, pose.tolerance, strict=True))


class Bent:
    """The cost of a solved motion when it is bent to other ends.

    Args:
        fixed: keep its duration; else it is slowed if limits require this, and may be faster if one was binding.
    """

    def __init__(self, scorers: Sequence[Scorer], trajectory: Trajectory, fixed: bool) -> None:
        self._scorers, self._fixed = list(scorers), fixed
        x = np.linspace(0, 1, SAMPLES)
        self._time = x * trajectory.duration
        q, v, a, _ = trajectory.sample(trajectory.time[0] + self._time)
        self._motion = q, v, a
        self.start, self.goal = q[0], q[-1]
        self._shape = x**3 * (10 - 15 * x + 6 * x**2)
        self._speed = 30 * x**2 * (1 - x) ** 2 / trajectory.duration
        self._bend = 60 * x * (1 - x) * (1 - 2 * x) / trajectory.duration**2
        self._share = float(self._duration_share(v[None], a[None])[0])
        self.loss = float(np.mean([scorer.energy(trajectory).loss for scorer in scorers]))

    def __call__(self, start: np.ndarray | None, goal: np.ndarray | None) -> np.ndarray:
        """Energy (M,) [J] with other ends (M, n); None for its own."""
        ends = [own if end is None else end for own, end in ((self.start, start), (self.goal, goal))]
        first, last = (np.atleast_2d(end - own) for own, end in zip((self.start, self.goal), ends, strict=True))
        q, v, a = (
            base + first[:, None] * (one - shape[:, None]) + last[:, None] * shape[:, None]
            for base, shape, one in zip(self._motion, (self._shape, self._speed, self._bend), (1.0, 0, 0), strict=True)
        )
        needed = self._duration_share(v, a)
        held = self._share >= BINDING
        longer = np.maximum(needed / max(self._share, BINDING) if held else needed, 0.5 if held else 1.0)
        if not self._fixed:
            return self._energy(q, v, a, longer)
        energy = self._energy(q, v, a, np.ones(len(q)))
        return np.asarray(energy + PRICE * np.maximum(longer - 1, 0) ** 2 * self.loss)

    def _duration_share(self, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """The share of the duration (M,) that velocity and acceleration limits require."""
        limits = self._scorers[0].robot.limits
        speed = (np.abs(v) / limits.velocity).max(axis=(1, 2))
        return np.asarray(np.maximum(speed, np.sqrt((np.abs(a) / limits.acceleration).max(axis=(1, 2)))))

    def _energy(self, q: np.ndarray, v: np.ndarray, a: np.ndarray, longer: np.ndarray) -> np.ndarray:
        """Energies (K,) [J] of motions, stretched in time.

        Args:
            q, v, a: (K, N, n). longer: (K,) factor of each duration.
        """
        by = longer[:, None, None]
        return energies(self._scorers, q, v / by, a / by**2, self._time * longer[:, None])
