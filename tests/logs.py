"""What tests of logged data write: tables of a motion, files, and the log.toml of a set."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from energy_opt.robot import Robot, load_robot

Z1, PANDA, UR = (load_robot(name) for name in ("z1", "panda", "ur5e"))
SIX, SEVEN = range(6), range(7)


def motion(n: int, seconds: float, step: float = 0.01) -> tuple[np.ndarray, np.ndarray]:
    """Rests, moves there and back at several speeds, and rests again: times (N,) and an angle (N,) rad."""
    t = np.arange(round(seconds / step) + 1) * step
    speed = np.zeros(len(t))
    for k, (begin, rate) in enumerate(((0.1, 0.5), (0.3, 1.0), (0.45, 0.7), (0.7, 1.2), (0.8, 0.4))[:n]):
        at = (t - begin * seconds) / 0.7
        speed += (-1) ** k * rate * np.where((at > 0) & (at < 1), np.sin(np.pi * at) ** 2, 0.0)
    return t, np.cumsum(speed) * step


def lines(header: str, columns: list[np.ndarray], form: str = "%.6f", delimiter: str = ",") -> str:
    rows = [delimiter.join(form % x for x in row) for row in np.column_stack(columns)]
    return "\n".join([header, *rows]) + "\n"


def put(path: Path, text: str | bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def log(folder: Path, robot: str, rest: str) -> Path:
    put(folder / "log.toml", f'format = "energy-opt/log/1"\nrobot = "{robot}"\n{rest}')
    return folder


def arm(
    robot: Robot, seconds: float = 8.0, step: float = 0.01
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """t, q (N, n) about the middle of the limits, v, and a power that follows the motion."""
    t, x = motion(5, seconds, step)
    middle = np.clip((robot.limits.lower + robot.limits.upper) / 2, -1.5, 1.5)
    q = np.where(np.isfinite(middle), middle, 0.0) + np.outer(x, 0.5 + 0.1 * np.arange(robot.n))
    v = np.gradient(q, t, axis=0)
    return t, q, v, 60 + 40 * np.abs(v).sum(axis=1) + 10 * (v**2).sum(axis=1)
