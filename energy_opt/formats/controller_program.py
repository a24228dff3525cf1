"""Programs for a controller: motions and waits, and changes of payload."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.motion.trajectory import Trajectory, whole
from energy_opt.power import PowerModel
from energy_opt.robot import Robot

Load = tuple[float, float, float, float]  # mass [kg] and its centre [m]
STANDING = 3  # samples of a wait
NANOSECOND = 1e-9  # [s]
SAME = 1e-9  # [rad/s^2] accelerations that differ by less count as equal


@dataclass(frozen=True)
class Part:
    """A motion from rest to rest, or a wait.

    Attributes:
        trajectory: its samples, from any time on; of a wait, standing ones.
        waits: True for a wait; mode: of the wait, if the motors do not hold the arm.
        payload: mass [kg] and its centre [m] in the last joint's frame, from its beginning on; None: not known.
    """

    trajectory: Trajectory
    name: str = ""
    waits: bool = False
    mode: str = ""
    payload: Load | None = None


def standing(joints: Sequence[str], q: np.ndarray, seconds: float) -> Trajectory:
    """Samples of standing at q (n,) for so many seconds."""
    samples = np.repeat(q[None], STANDING, axis=0)
    still = np.zeros_like(samples)
    return Trajectory(tuple(joints), np.linspace(0, seconds, STANDING), samples, still, still)


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


def load_of(model: PowerModel) -> Load | None:
    """Payload of a model, with its centre in the last joint's frame; None without a payload."""
    payload = model.get("payload")
    return None if payload is None else (float(payload.values["mass"][0]), *payload.values["com"].tolist())


def in_tool(robot: Robot, load: Load | None) -> Load | None:
    """A payload with its centre in the frame of the link `tool0`, which controllers use; unchanged without it."""
    found = robot.body.link_frames().get("tool0")
    if found is None or load is None:
        return load
    mass, *centre = load
    x, y, z = (np.linalg.inv(found[1]) @ [*centre, 1.0])[:3].tolist()
    return mass, x, y, z
