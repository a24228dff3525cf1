"""A sampled trajectory: the samples of trajectory.csv, and the curve that they describe.

Between two samples the curve is the quintic polynomial with the samples' positions, velocities and accelerations, so
these three are continuous and every judged value can be recomputed from the file alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from energy_opt.arguments import expect
from energy_opt.errors import BadInput, shown
from energy_opt.names import in_order

# Quintic on x in [0, 1] from (q0, q1, h v0, h v1, h^2 a0, h^2 a1); each line has the coefficients of one of x^0 ... x^5
_HERMITE = np.array(
    [
        [1, 0, 0, 0, 0, 0],
        [0, 0, 1, 0, 0, 0],
        [0, 0, 0, 0, 0.5, 0],
        [-10, 10, -6, -4, -1.5, 0.5],
        [15, -15, 8, 7, 1.5, -1],
        [-6, 6, -3, -3, -0.5, 0.5],
    ]
)


ARRAYS = ("time", "position", "velocity", "acceleration", "effort", "power")
CLOSEST = 1e-5  # [s] least time between two samples of a mean
ROW_STEP = 0.004  # [s] largest time between two samples of a trajectory
LEAST_SAMPLES = 200
MOST_SAMPLES = 20_000  # most samples that ROW_STEP gives: longer motions are slower and need no more
STANDING = 3  # samples of a wait
NANOSECOND = 1e-9  # [s]
SAME = 1e-9  # [rad/s^2] accelerations that differ by less count as equal
NEARER = 8  # places in each step of a motion, between which the nearest one to a position is looked for


def whole(time: np.ndarray | float) -> np.ndarray:
    """Times (N,) [s] rounded to whole nanoseconds, the unit of messages.

    Judged times can then be written without a change.
    """
    return np.asarray(np.round(np.asarray(time, dtype=float) * 1e9) / 1e9)


def row_step(duration: float) -> float:
    """Largest time [s] between two samples of a trajectory that takes `duration`, with which it grows beyond 80 s."""
    return max(min(ROW_STEP, duration / (LEAST_SAMPLES - 1)), duration / MOST_SAMPLES)


def _powers(x: np.ndarray, order: int) -> np.ndarray:
    """Derivative of `order` of the powers 0 ... 5 at x (M,), (M, 6)."""
    degree = np.arange(6)
    factor = np.prod([degree - k for k in range(order)], axis=0)
    return factor * x[:, None] ** np.maximum(degree - order, 0)


@lru_cache(maxsize=8)
def _places(factor: int) -> np.ndarray:
    """Matrix (4, factor, 6) from a quintic's data to derivatives 0 ... 3 at `factor` even places between samples."""
    x = np.arange(factor) / factor
    return np.stack([_powers(x, order) @ _HERMITE for order in range(4)])


@dataclass(frozen=True, repr=False, eq=False)
class Trajectory:
    """Samples of a motion: time (N,) [s]; position, velocity, acceleration (N, n) [rad, rad/s, rad/s^2].

    The columns are in the order of `joints`; joints that slide have m in place of rad. effort (N, n) [N m] (the motors'
    torque) and power (N,) [W] are None until a model has been applied. Sequences are accepted, and tables whose columns
    have the names of `joints`, in any order.

    Raises:
        BadInput: an array does not consist of numbers, has another shape, or there are fewer than two samples.
    """

    joints: tuple[str, ...]
    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    effort: np.ndarray | None = None
    power: np.ndarray | None = None

    def __post_init__(self) -> None:
        expect(self.joints, Sequence, "trajectory: joints")
        count, joints = np.size(self.time), len(self.joints)
        if count < 2:
            raise BadInput(f"trajectory: time has {count} samples; expected 2 or more")
        for name in ARRAYS:
            shape, given = (count,) if name in ("time", "power") else (count, joints), getattr(self, name)
            if given is None and name in ("effort", "power"):
                continue
            try:
                given = given if len(shape) == 1 else in_order(given, self.joints, f"trajectory: {name}")
                array = np.asarray(given, dtype=float)
            except (TypeError, ValueError):
                array = np.zeros(())
            if array.shape != shape:
                found = f"has shape {array.shape}" if array.ndim else f"is {shown(given)}"
                raise BadInput(
                    f"trajectory: {name} {found}; expected numbers of shape {shape}, as time and joints have"
                )
            object.__setattr__(self, name, array)

    @property
    def duration(self) -> float:
        """Time from the first to the last sample, s."""
        return float(self.time[-1] - self.time[0])

    def sample(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Position, velocity, acceleration and jerk (M, n) of the curve at `time` (M,) [s], in any order.

        Before the first and after the last sample, the first and the last quintic are continued.
        """
        k = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.time) - 2)
        h = (self.time[k + 1] - self.time[k])[:, None]
        x, data = (time - self.time[k])[:, None] / h, self._pieces(k)
        c = np.tensordot(_HERMITE, data, axes=1)
        out = []
        for order in range(4):
            value = np.zeros_like(x * c[0])
            for degree in range(5, order - 1, -1):
                factor = float(np.prod(np.arange(degree - order + 1, degree + 1)))
                value = value * x + factor * c[degree]
            out.append(value / h**order)
        return out[0] + self.position[k], out[1], out[2], out[3]

    def _pieces(self, k: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Data (6, M, n) of the quintics after samples k (M,), as `_HERMITE` takes them.

        Relative to the first position of each, so that differences of nearly equal positions keep their digits.
        """
        step, state = np.diff(self.time)[k, None], (self.position, self.velocity, self.acceleration)
        data = np.stack([x[k] * step**order for order, row in enumerate(state) for x in (row[:-1], row[1:])])
        data[1] -= data[0]
        data[0] = 0.0
        return data

    def sample_denser(self, factor: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """As `sample` at the times of `denser(factor)`, but many times faster: the places between samples repeat."""
        step, data = np.diff(self.time)[:, None], self._pieces()
        out = []
        for order in range(4):
            between = np.tensordot(_places(factor)[order], data, axes=1)  # (factor, N - 1, n)
            if order == 0:
                between += self.position[:-1]
            else:
                between /= step**order
            out.append(np.concatenate([between.transpose(1, 0, 2).reshape(-1, len(self.joints)), between[-1:, -1]]))
        end = np.tensordot(_powers(np.ones(1), 3) @ _HERMITE, data[:, -1], axes=1) / step[-1] ** 3
        for values, last in zip(
            out, (*(row[-1:] for row in (self.position, self.velocity, self.acceleration)), end), strict=True
        ):
            values[-1] = last
        return out[0], out[1], out[2], out[3]

    def jerk_before_samples(self) -> np.ndarray:
        """Jerk (N - 1, n) just before each sample but the first; it jumps there, `sample` gives the value after."""
        step, data = np.diff(self.time)[:, None], self._pieces()
        return np.asarray(np.tensordot(_powers(np.ones(1), 3) @ _HERMITE, data, axes=1)[0] / step**3)

    def __call__(self, time: np.ndarray, order: int = 0) -> np.ndarray:
        """Derivative of order 0 ... 3 with respect to time, shape (M, n) for `time` (M,) [s]."""
        return self.sample(np.atleast_1d(np.asarray(time, dtype=float)))[order]

    def __repr__(self) -> str:
        return f"Trajectory({len(self.joints)} joints, {len(self.time)} samples, {self.duration:.4g} s)"

    def filled(self, effort: np.ndarray, power: np.ndarray) -> Filled:
        """The trajectory with effort (N, n) [N m] and power (N,) [W]."""
        return Filled(self.joints, self.time, self.position, self.velocity, self.acceleration, effort, power)

    def denser(self, factor: int) -> np.ndarray:
        """Times of a grid `factor` times denser than the samples, samples included; shape ((N - 1) * factor + 1,)."""
        steps = np.arange(factor) / factor
        inner = (self.time[:-1, None] + np.diff(self.time)[:, None] * steps).ravel()
        return np.append(inner, self.time[-1])

    def part(self, samples: slice) -> Trajectory:
        """The trajectory of some consecutive samples, such as `slice(10, 20)`."""
        first = (self.time, self.position, self.velocity, self.acceleration, self.effort, self.power)
        return Trajectory(self.joints, *(None if x is None else x[samples] for x in first))  # type: ignore[arg-type]

    def on_nanoseconds(self) -> Trajectory:
        """The curve with its samples on whole nanoseconds; itself if they already are."""
        time = whole(self.time)
        if np.array_equal(time, self.time):
            return self
        time = np.unique(time)
        q, v, a, _ = self.sample(time)
        for new, old in ((q, self.position), (v, self.velocity), (a, self.acceleration)):
            new[[0, -1]] = old[[0, -1]]
        return Trajectory(self.joints, time, q, v, a)

    def distances_to(self, positions: Sequence[np.ndarray]) -> list[float]:
        """The largest difference [rad, m] of a joint from each position (n,), where the motion is nearest to it."""
        q, out = self.sample_denser(NEARER)[0], []
        step = np.diff(q, axis=0)
        length = np.maximum((step**2).sum(axis=1), np.finfo(float).tiny)
        for position in positions:
            off = position - q[:-1]
            share = np.clip((off * step).sum(axis=1) / length, 0, 1)
            out.append(float(np.abs(off - share[:, None] * step).max(axis=1).min()))
        return out

    def time_nearest_to(self, position: np.ndarray, after: float = -np.inf) -> float:
        """Time [s] after another one at which the motion is nearest to a position (n,)."""
        from scipy.optimize import minimize_scalar

        def distance(time: float) -> float:
            return float(np.linalg.norm(self.sample(np.array([time]))[0][0] - position))

        missed = np.where(self.time > after, np.linalg.norm(self.position - position, axis=1), np.inf)
        k = int(np.argmin(missed))
        ends = max(self.time[max(k - 1, 0)], after), self.time[min(k + 1, len(self.time) - 1)]
        return float(minimize_scalar(distance, bounds=ends, method="bounded", options={"xatol": 1e-12}).x)

    def between(self, begin: float, end: float) -> Trajectory:
        """The motion between two times [s], which are its first and last sample, from time 0."""
        inner = self.time[(self.time > begin + CLOSEST) & (self.time < end - CLOSEST)]
        time = np.array([begin, *inner, end])
        return Trajectory(self.joints, time - begin, *self.sample(time)[:3])

    def averaged(self, width: float) -> Trajectory:
        """The mean of the curve over the last `width` s, at rest before and after: `width` s longer.

        This increases no velocity, acceleration or jerk, and turns a jump d of the acceleration into a jerk of d /
        width. With the integral Q of the position: (Q(t) - Q(t - width)) / width, and so on for its derivatives.
        """
        last = whole(self.time[-1] - self.time[0] + width)
        marks = np.concatenate([self.time, self.time + width]) - self.time[0]
        marks = np.unique(whole(marks))
        keep = np.concatenate([[True], np.diff(marks) > CLOSEST]) & (marks < last - CLOSEST)
        time = np.append(marks[keep], last)
        end = time.astype(np.longdouble) + self.time[0]  # an error of time causes an error of q times error / width
        now, then = (self._position_integral(t) for t in (end, end - width))
        q, v, a = (np.asarray((x - y) / width, dtype=float) for x, y in zip(now, then, strict=True))
        still = self._is_at_rest(time - width, time)  # set rest exactly, without rounding
        q[still] = self.sample(np.clip(self.time[0] + time[still], *self.time[[0, -1]]))[0]
        v[still] = a[still] = 0.0
        q[[0, -1]], v[[0, -1]], a[[0, -1]] = self.position[[0, -1]], 0.0, 0.0
        return Trajectory(self.joints, time, q, v, a)

    def _is_at_rest(self, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        """(M,) True if the arm is at rest from `begin` to `end`, times [s] (M,) after the first sample."""
        at_rest = ((self.velocity == 0) & (self.acceleration == 0)).all(axis=1)
        moves = (self.position[:-1] != self.position[1:]).any(axis=1) | ~at_rest[:-1] | ~at_rest[1:]
        moved = np.concatenate([[0], np.cumsum(moves)])
        time = self.time - self.time[0]
        near = np.minimum(CLOSEST, (end - begin) / 4)  # a mean may be over microseconds
        first = np.clip(np.searchsorted(time, begin + near, side="right") - 1, 0, len(moves))
        after = np.clip(np.searchsorted(time, end - near, side="left"), 0, len(moves))
        return moved[after] <= moved[first]

    def _position_integral(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Integral of the position from the first sample, position and velocity (M, n) at `time` (M,), in long double.

        The arm is at rest beyond both ends.
        """
        inside = np.clip(time, self.time[0], self.time[-1])
        step = np.diff(self.time.astype(np.longdouble))[:, None]
        q, v, a = (x.astype(np.longdouble) for x in (self.position, self.velocity, self.acceleration))
        pieces = step * (q[:-1] + q[1:]) / 2 + step**2 * (v[:-1] - v[1:]) / 10 + step**3 * (a[:-1] + a[1:]) / 120
        whole_pieces = np.concatenate([np.zeros_like(q[:1]), np.cumsum(pieces, axis=0)])
        k = np.clip(np.searchsorted(self.time, inside, side="right") - 1, 0, len(self.time) - 2)
        h, x = step[k], (inside - self.time[k])[:, None] / step[k]
        data = np.stack([q[k], q[k + 1], h * v[k], h * v[k + 1], h**2 * a[k], h**2 * a[k + 1]])
        c = np.tensordot(_HERMITE.astype(np.longdouble), data, axes=1)
        part = h * sum(c[d] * x ** (d + 1) / (d + 1) for d in range(6))
        beyond = (time - inside)[:, None]
        position, velocity, _, _ = self.sample(inside.astype(float))
        velocity = np.where(beyond == 0, velocity, 0.0)
        return whole_pieces[k] + part + beyond * position, position, velocity

    def slowed(self, duration: float) -> Trajectory:
        """The same path with time stretched evenly to `duration` (s)."""
        k = duration / self.duration
        time = self.time[0] + (self.time - self.time[0]) * k
        return Trajectory(self.joints, time, self.position, self.velocity / k, self.acceleration / k**2)


def standing(joints: Sequence[str], q: np.ndarray, seconds: float, samples: int = STANDING) -> Trajectory:
    """Samples of standing at q (n,) for so many seconds."""
    position = np.repeat(q[None], samples, axis=0)
    still = np.zeros_like(position)
    return Trajectory(tuple(joints), np.linspace(0, seconds, samples), position, still, still)


def joined(trajectories: Sequence[Trajectory]) -> Trajectory:
    """Motions that follow one another as one, samples on whole nanoseconds.

    If the acceleration jumps between two motions, both samples are kept, a nanosecond apart. This breaks a jerk limit,
    as the motions themselves do. The longest wait is shortened by these nanoseconds.
    """
    jumps = [
        k > 0 and np.abs(t.acceleration[0] - trajectories[k - 1].acceleration[-1]).max() > SAME
        for k, t in enumerate(trajectories)
    ]
    owed = NANOSECOND * sum(jumps)
    still = [k for k, t in enumerate(trajectories) if not t.velocity.any() and t.duration > 2 * owed]
    pays = max(still, key=lambda k: trajectories[k].duration, default=None)
    times: list[np.ndarray] = []
    samples: list[list[np.ndarray]] = []
    at = 0.0
    for k, t in enumerate(trajectories):
        at += NANOSECOND * jumps[k]
        first = 0 if k == 0 or jumps[k] else 1  # skip the sample at which the motion before ended
        time = t.time - t.time[0]
        if k == pays:
            time = time * (1 - owed / time[-1])
        times.append(at + time[first:])
        samples.append([x[first:] for x in (t.position, t.velocity, t.acceleration)])
        at += float(time[-1])
    q, v, a = (np.concatenate(part) for part in zip(*samples, strict=True))
    return Trajectory(trajectories[0].joints, whole(np.concatenate(times)), q, v, a)


class Filled(Trajectory):
    """A trajectory to which a model has been applied: it has effort and power. Its arrays cannot be changed."""

    effort: np.ndarray
    power: np.ndarray

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ARRAYS:
            array = getattr(self, name).view()
            array.flags.writeable = False  # a certificate states what is judged, not what is changed later
            object.__setattr__(self, name, array)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Of a copy, whose arrays cannot be changed either."""
        self.__dict__.update(state)
        self.__post_init__()
