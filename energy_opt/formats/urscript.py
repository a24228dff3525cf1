"""URScript: a program that runs a trajectory on an arm of Universal Robots.

The program refuses to begin unless the arm stands at the trajectory's start. It then follows the quintics between the
points with `servoj`, one command for every step of the controller (2 ms on the e-series, 8 ms on CB3), at the pace
`speed`: 1.0 is the trajectory as it was planned, and 0.1 a good first try. At 500 Hz the positions stand in the program
one by one, and nothing is computed on the controller.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.files import write_text
from energy_opt.motion.trajectory import Trajectory

JOINTS = 6
NEAR = 0.01  # [rad] how far from the start the arm may stand
LOOKAHEAD, GAIN = 0.03, 500  # [s], - of servoj: the least smoothing that it takes, and a firm but quiet gain
STREAM_RATE = 500.0  # [Hz] of positions that are streamed one by one
STOP = 4.0  # [rad/s^2] deceleration where the program ends or is refused

_SERVO = f"servoj(q, 0, 0, dt, {LOOKAHEAD}, {GAIN})"


def vector(values: np.ndarray) -> str:
    """Numbers as a list of URScript, with nine decimals: a billionth of a radian."""
    return "[" + ",".join(f"{x:.9f}" for x in values.tolist()) + "]"


def check_start(start: np.ndarray) -> list[str]:
    """Lines that stop the program where the arm does not stand at `start` (6,)."""
    return [
        f"  local start = {vector(start)}",
        "  local here = get_actual_joint_positions()",
        "  local j = 0",
        f"  while j < {JOINTS}:",
        f"    if norm(here[j] - start[j]) > {NEAR}:",
        '      popup("the arm does not stand at the start of this motion", "energy_opt", False, True, True)',
        "      halt",
        "    end",
        "    j = j + 1",
        "  end",
    ]


def check_arm(trajectory: Trajectory) -> None:
    """Raise BadInput where the arm cannot be one of Universal Robots."""
    if len(trajectory.joints) != JOINTS:
        raise BadInput(f"--write urscript: for arms of six joints; this one has {len(trajectory.joints)}")


def write(trajectory: Trajectory, path: Path) -> None:
    """Write a program that follows the rows of a trajectory; evenly spaced ones at 500 Hz are streamed.

    Raises:
        BadInput: the arm does not have six joints.
    """
    check_arm(trajectory)
    steps = np.diff(trajectory.time)
    if len(steps) > 1 and np.allclose(steps[:-1], 1 / STREAM_RATE, rtol=1e-6):
        lines = _streamed(trajectory)
    else:
        lines = _quintics(trajectory)
    goal = f"  servoj({vector(trajectory.position[-1])}, 0, 0, dt, {LOOKAHEAD}, {GAIN})"
    write_text(path, "\n".join([*_head(trajectory), *lines, goal, f"  stopj({STOP})", "end", ""]))


def _head(trajectory: Trajectory) -> list[str]:
    return [
        f"# {', '.join(trajectory.joints)}",
        f"# {trajectory.duration:.9f} s from start to end. Run it slowly first: speed = 0.1 in the line below.",
        "def energy_opt_motion():",
        "  local speed = 1.0",
        *check_start(trajectory.position[0]),
        "  local dt = get_steptime()",
        "  local t = dt * speed",
    ]


def _quintics(trajectory: Trajectory) -> list[str]:
    """A function that runs one quintic, and a call for every two rows; `t` carries what is left of a step over.

    All that the function uses is handed to it: whether it sees what is `local` to the program is not left to the scope.

    With x = t / h and the differences d = q1 - q0 - h v0 - h^2 a0 / 2, e = h (v1 - v0 - h a0), f = h^2 (a1 - a0):
    q = q0 + h v0 x + h^2 a0 x^2 / 2 + (10 d - 4 e + f/2) x^3 + (-15 d + 7 e - f) x^4 + (6 d - 3 e + f/2) x^5.
    """
    lines = [
        "  def quintic(h, q0, v0, a0, q1, v1, a1, begin, dt, speed):",
        "    local t = begin",
        "    local q = q0",
        "    while t <= h:",
        "      local x = t / h",
        "      local j = 0",
        f"      while j < {JOINTS}:",
        "        local d = q1[j] - q0[j] - h * v0[j] - h * h * a0[j] / 2",
        "        local e = h * (v1[j] - v0[j] - h * a0[j])",
        "        local f = h * h * (a1[j] - a0[j])",
        "        local c = 10 * d - 4 * e + f / 2 + x * (7 * e - 15 * d - f + x * (6 * d - 3 * e + f / 2))",
        "        q[j] = q0[j] + x * (h * v0[j] + x * (h * h * a0[j] / 2 + x * c))",
        "        j = j + 1",
        "      end",
        f"      {_SERVO}",
        "      t = t + dt * speed",
        "    end",
        "    return t - h",
        "  end",
    ]
    rows = [(vector(q), vector(v), vector(a)) for q, v, a in zip(
        trajectory.position, trajectory.velocity, trajectory.acceleration, strict=True
    )]  # fmt: skip
    for step, before, after in zip(np.diff(trajectory.time), rows, rows[1:], strict=False):
        lines.append(f"  t = quintic({step:.9f},{','.join(before)},{','.join(after)},t,dt,speed)")
    return lines


def _streamed(trajectory: Trajectory) -> list[str]:
    """One servoj for every row; a slower pace lasts longer at each."""
    command = f"servoj({{}}, 0, 0, {1 / STREAM_RATE:.9f} / speed, {LOOKAHEAD}, {GAIN})"
    return [f"  {command.format(vector(q))}" for q in trajectory.position[1:-1]]
