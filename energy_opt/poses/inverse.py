"""All joint positions that bring the tool to a pose: Levenberg-Marquardt steps from seeded starts, within limits.

    minimise |e(q)|^2,   (J^T J + lambda I) dq = -J^T e,   lower <= q <= upper

for many starts at once. e is the error of the pose within its freedom, shift and rotation vector in the wanted tool's
frame. J follows from the tool's Jacobian and the derivative of the rotation vector,

    d log(R) = J_l(log R)^-1 w,   J_l(p)^-1 = 1 - [p]/2 + (1 - t/2 cot(t/2)) / t^2 [p]^2,   t = |p|

(w: angular velocity in the wanted frame), or from differences if several turns are free. Solutions
of arms without redundancy are isolated (the branches); for others the starts sample the whole set.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from energy_opt.motion.carried import Carried
from energy_opt.poses.pose import EXACT, Pose, about, free_values, pose_error
from energy_opt.robot import Robot, tool_of

STARTS = 320
STEPS = 40
SMALL = 1e-9  # [m, rad] a smaller error counts as zero
DIFFERENCE = 1e-6  # [rad, m] step of difference quotients
SAME = 1e-3  # [rad, m] positions that differ by less are the same
TURN = 2 * np.pi
ROUNDING = 1e-13  # share of the normal matrix's trace: least damping, so that it can be inverted
LENGTH = 0.3  # [m] length that weighs as much as a radian
BALANCED = 8  # most weights to try for an error within the tolerance
# least effect of a free turn on the error; below it the axis points the opposite way and every turn is equivalent
OPPOSITE = 1e-3


@dataclass(frozen=True)
class Reached:
    """The results of the starts.

    Attributes:
        positions: (K, n) [rad, m] that reach the pose.
        nearest: (n,) nearest to the pose, if none reaches it; distance [m] and angle [rad] are its error, where
            `LENGTH` weighs as much as a radian, or which uses least of the pose's tolerance if it has one.
        beyond: the joint, and in words the limit that it would have to exceed, and how far; empty if the pose is out of
            reach even without limits.
    """

    positions: np.ndarray
    nearest: np.ndarray
    distance: float
    angle: float
    beyond: tuple[str, str] = ("", "")


class ToolKinematics(Carried):
    """The tool of a robot at many configurations.

    Attributes:
        moving: (n,) which joints move the tool, by themselves or by a follower. A pose leaves the others alone.
        turning: (n,) which of them turn.
    """

    def __init__(self, robot: Robot, tool: str | None = None) -> None:
        super().__init__(robot.body, tool_of(robot.body, tool))
        self.robot = robot
        self.moving = robot.body.coupling.reach_back(self._moves.astype(float)) > 0
        self.turning = self.moving & ~np.array(robot.slides, dtype=bool)

    def __call__(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotation (N, 3, 3) and origin (N, 3) [m] of the tool in the base frame at q (N, n)."""
        poses = self.poses(q)
        return poses[:, :3, :3], poses[:, :3, 3]

    def out_of_reach(self, pose: Pose) -> bool:
        """True if a pose is farther from the base than the stretched arm; False does not mean that it is reached."""
        robot = self.robot
        if not robot.body.coupling.trivial or any(freedom.axis in "xyz" for freedom in pose.free):
            return False
        if not np.isfinite((robot.limits.upper - robot.limits.lower)[list(robot.slides)]).all():
            return False
        farthest = robot.reach + np.linalg.norm(self._pose[:3, 3]) + pose.tolerance[0]
        return bool(np.linalg.norm(pose.matrix[:3, 3]) > farthest)

    def free_values(self, pose: Pose, q: np.ndarray) -> np.ndarray:
        """Positions of the tool along the pose's free directions at q (N, n), (N, F); see `pose.free_values`."""
        found = free_values(pose, *self(q))
        return np.array([found[freedom.axis] for freedom in pose.free]).reshape(-1, len(q)).T

    def pose_error(self, pose: Pose, q: np.ndarray) -> np.ndarray:
        """Error (N, 6) of the tool's pose at q (N, n), see `pose.pose_error`."""
        return pose_error(pose, *self(q))


def reach(
    tool: ToolKinematics, pose: Pose, *, seed: int = 0, near: np.ndarray | None = None, starts: int = STARTS
) -> Reached:
    """Joint positions that reach a pose, from many seeded starts.

    Args:
        near: (n,) positions to try first, towards which joints are shifted by whole turns; joints that do not move the
            tool keep theirs.
    """
    limits = tool.robot.limits
    low, high = (np.where(np.isfinite(x), x, s * np.pi) for x, s in ((limits.lower, -1), (limits.upper, 1)))
    rng = np.random.default_rng(seed)
    q = rng.uniform(low, high, size=(starts, len(low)))
    if near is not None:
        q[0] = np.clip(near, limits.lower, limits.upper)
        q[:, ~tool.moving] = q[0, ~tool.moving]
    at_first = q
    q, error = solve(tool, pose, at_first)
    good = error < SMALL
    if not good.any():
        q, distance, angle = _nearest(tool, pose, q)
        beyond = _limiting_joint(tool, pose, at_first)
        return Reached(np.zeros((0, len(low))), q, distance, angle, beyond)
    found = distinct(turned_near(q[good], near, tool))
    return Reached(found, found[0], 0.0, 0.0)


def _nearest(tool: ToolKinematics, pose: Pose, q: np.ndarray) -> tuple[np.ndarray, float, float]:
    """The positions (n,) nearest to a pose, from the results q (N, n) of `solve`; their distance [m] and angle [rad].

    One weight of length against angle may leave an error outside the tolerance where another one does not.
    """
    length, given = LENGTH, pose.tolerance != EXACT
    allowed = np.maximum(pose.tolerance, EXACT) if given else np.array([LENGTH, 1.0])
    for _ in range(BALANCED):
        error = np.linalg.norm(tool.pose_error(pose, q).reshape(-1, 2, 3), axis=2)
        used = error / allowed
        k = int(np.argmin(used.max(axis=1) if given else np.sum(used**2, axis=1)))
        if not given or used[k].max() <= 1:
            break
        length *= np.sqrt(np.divide(*np.maximum(used[k, ::-1], SMALL)))
        q, _ = solve(tool, pose, q, length=length)
    return q[k], *error[k].tolist()


def _limiting_joint(tool: ToolKinematics, pose: Pose, q: np.ndarray) -> tuple[str, str]:
    """The joint that exceeds its limits most, for the solution from q (N, n) with the least excess."""
    robot, limits = tool.robot, tool.robot.limits
    q, error = solve(tool, pose, q, limited=False)
    turning = ~np.array(robot.slides, dtype=bool)
    for sign, over in ((-1, q - limits.upper), (1, limits.lower - q)):  # whole turns towards the limits
        q = q + sign * TURN * turning * np.ceil(np.maximum(over, 0.0) / TURN - 0.5)
    excess = np.maximum(np.maximum(q - limits.upper, limits.lower - q), 0.0)
    if not (error < SMALL).any():
        return "", ""
    k = int(np.argmin(np.where(error < SMALL, excess.sum(axis=1), np.inf)))
    j = int(np.argmax(excess[k]))
    bound = limits.upper[j] if q[k, j] > limits.upper[j] else limits.lower[j]
    unit = "m" if robot.slides[j] else "rad"
    name = robot.joints[j]
    return name, f"{name} would have to be at {q[k, j]:.4g} {unit}, its limit is {bound:.4g} {unit}"


def solve(
    tool: ToolKinematics, pose: Pose, q: np.ndarray, limited: bool = True, length: float = LENGTH
) -> tuple[np.ndarray, np.ndarray]:
    """Positions (N, n) reached from the starts q (N, n), and the largest error of each (N,) [m, rad].

    Args:
        limited: within the joints' limits. length: [m] that weighs as much as a radian.
    """
    limits = tool.robot.limits
    lower, upper = (limits.lower, limits.upper) if limited else (-np.inf, np.inf)
    weight = np.array([1 / length] * 3 + [1.0] * 3)
    n, q = q.shape[1], np.clip(q, lower, upper)
    e = tool.pose_error(pose, q) * weight
    damping = np.clip(np.sum(e**2, axis=1), 1e-9, 1e-2)  # small if the start is near
    for _ in range(STEPS):
        open_ = np.flatnonzero(np.abs(e).max(axis=1) > SMALL / 10)
        if not len(open_):
            break
        at, now = q[open_], e[open_]
        jacobian = jacobian_of(tool, pose, at, now / weight) * weight[:, None]
        gradient = np.einsum("kij,ki->kj", jacobian, now)
        # a joint at its limit whose step would leave it is held
        held = ((at <= lower) & (gradient > 0)) | ((at >= upper) & (gradient < 0))
        jacobian *= ~held[:, None]
        gradient *= ~held
        normal = np.einsum("kij,kil->kjl", jacobian, jacobian)
        least = damping[open_] + ROUNDING * np.trace(normal, axis1=1, axis2=2)
        normal += least[:, None, None] * np.eye(n)
        trial = np.clip(at - np.linalg.solve(normal, gradient[..., None])[..., 0], lower, upper)
        there = tool.pose_error(pose, trial) * weight
        better = np.sum(there**2, axis=1) < np.sum(now**2, axis=1)
        q[open_[better]], e[open_[better]] = trial[better], there[better]
        damping[open_] = np.clip(np.where(better, damping[open_] / 5, damping[open_] * 4), 1e-12, 1e6)
    return q, np.abs(e / weight).max(axis=1)


def jacobian_of(tool: ToolKinematics, pose: Pose, q: np.ndarray, e: np.ndarray) -> np.ndarray:
    """Derivative (N, 6, n) of the error e (N, 6) of a pose at q (N, n)."""
    ranges = {freedom.axis: freedom for freedom in pose.free}
    turns = [k for k, axis in enumerate("xyz") if f"r{axis}" in ranges]
    if len(turns) > 1:
        steps = q[:, None] + DIFFERENCE * np.eye(q.shape[1])
        there = tool.pose_error(pose, steps.reshape(-1, q.shape[1])).reshape(*steps.shape[:2], 6)
        return np.asarray((there - e[:, None]).transpose(0, 2, 1) / DIFFERENCE * tool.moving)
    wanted = pose.matrix[:3, :3]
    rotation, origin = tool(q)
    jacobian = tool.jacobian(q)
    shift, turn = wanted.T @ jacobian[:, :3], wanted.T @ jacobian[:, 3:]
    inner = (origin - pose.matrix[:3, 3]) @ wanted
    for k, axis in enumerate("xyz"):
        if axis in ranges:
            inside = (inner[:, k] >= ranges[axis].low) & (inner[:, k] <= ranges[axis].high)
            shift[:, k] *= ~inside[:, None]
    inverse = _log_derivative(e[:, 3:])
    if not turns:
        return np.concatenate([shift, inverse @ turn], axis=1)
    k = turns[0]
    of = ranges[f"r{'xyz'[k]}"]
    angle = free_values(pose, rotation, origin)[of.axis]
    inside = (angle >= of.low) & (angle <= of.high)
    moved = inverse @ about(k, -np.clip(angle, of.low, of.high)) @ turn
    along = inverse[:, :, k]  # effect of the free turn itself on the error
    follows = moved[:, k] / np.where(np.abs(along[:, k]) > OPPOSITE, along[:, k], 1.0)[:, None]
    moved = moved - along[:, :, None] * follows[:, None] * inside[:, None, None]
    return np.concatenate([shift, moved], axis=1)


def _log_derivative(vector: np.ndarray) -> np.ndarray:
    """J_l^-1 (N, 3, 3) at rotation vectors (N, 3)."""
    t = np.linalg.norm(vector, axis=1)
    half = np.maximum(t, 1e-6) / 2
    factor = np.where(t > 1e-4, (1 - half / np.tan(half)) / np.maximum(t, 1e-4) ** 2, 1 / 12)
    x, y, z = vector.T
    cross = np.zeros((len(t), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -z, y, -x
    cross -= cross.transpose(0, 2, 1)
    return np.asarray(np.eye(3) - cross / 2 + factor[:, None, None] * (cross @ cross))


def turned_near(q: np.ndarray, near: np.ndarray | None, tool: ToolKinematics) -> np.ndarray:
    """Positions with revolute joints shifted by whole turns, within the limits, towards other positions.

    Args:
        q: (K, n) [rad, m]. near: (n,); None changes nothing. tool: its joints turn, within their limits.
    """
    if near is None:
        return q
    out, limits = q.copy(), tool.robot.limits
    for j in np.flatnonzero(tool.turning):
        whole = np.round((near[j] - q[:, j]) / TURN)
        for turns in (whole, whole - np.sign(whole)):
            moved = q[:, j] + TURN * turns
            inside = (moved >= limits.lower[j]) & (moved <= limits.upper[j])
            nearer = np.abs(moved - near[j]) < np.abs(out[:, j] - near[j])
            out[:, j] = np.where(inside & nearer, moved, out[:, j])
    return out


def other_turns(q: np.ndarray, near: np.ndarray | None, tool: ToolKinematics) -> np.ndarray:
    """Positions (K, n) that differ from q (n,) by a whole turn of one revolute joint.

    Args:
        near: (n,) each turn is to the other side of these; None: to both sides.
        tool: its joints turn, within their limits.
    """
    limits = tool.robot.limits
    signs = (-1, 1) if near is None else (np.where(q > near, -1, 1),)
    out = np.vstack([q + np.diag(TURN * tool.turning * sign) for sign in signs])
    inside = ((out >= limits.lower) & (out <= limits.upper)).all(axis=1) & (out != q).any(axis=1)
    return np.asarray(out[inside])


def distinct(q: np.ndarray) -> np.ndarray:
    """Positions (K, n), no two of which are nearer than `SAME`."""
    kept: list[np.ndarray] = []
    for row in q[np.lexsort(np.round(q.T[::-1], 4))]:
        if not kept or np.abs(np.array(kept) - row).max(axis=1).min() > SAME:
            kept.append(row)
    return np.array(kept).reshape(-1, q.shape[1])
