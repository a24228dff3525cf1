"""Standard moves as files: a neutral YAML, and a URScript program of `movej`.

UR's `movej(q, a, v, t, r)` takes speed and acceleration of the leading axis, the one that has furthest to go, and r,
how far from the tool's target [m] the blend into the next move begins. Written for motion version 1, the only one
before PolyScope 5.22: constant acceleration in both ramps. The controller shapes the blends itself; the r written is
the smaller of the two distances at which this blend leaves the first line and joins the second, so that the
controller's stays inside the corner that was judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from energy_opt.files import write_text
from energy_opt.formats.urscript import JOINTS, check_start, vector
from energy_opt.profiles.chain import Chain
from energy_opt.profiles.plan import StandardMoves
from energy_opt.robot import RigidBody
from energy_opt.robot.kinematics import Kinematics


def tool_point(body: RigidBody, q: np.ndarray) -> np.ndarray:
    """Origin of the last joint's frame in the base frame, (3,) [m]."""
    return np.asarray(Kinematics(body.tree())(q[None]).origin[0, body.last])


def blend_radii(chain: Chain, body: RigidBody) -> np.ndarray:
    """How far from each via point its blend begins or ends, whichever is nearer, (K,) [m] at the last joint's frame."""
    w, out = chain.velocities, []
    for i, corner in enumerate(chain.corners[1:-1], start=1):
        half = chain.ramps[i] / 2
        ends = corner - w[i - 1] * half, corner + w[i] * half
        at = tool_point(body, corner)
        out.append(min(float(np.linalg.norm(tool_point(body, q) - at)) for q in ends))
    return np.array(out)


def leading(chain: Chain) -> tuple[np.ndarray, np.ndarray]:
    """Speed [rad/s] and acceleration [rad/s^2] of each move's leading axis, (K + 1,) each.

    The first move's acceleration is that of its start, the last one's that of its end, and that of a move between two
    via points the larger of its blends'.
    """
    speed = np.abs(chain.velocities).max(axis=1)
    peaks = np.abs(chain.accelerations).max(axis=1)
    inner = np.maximum(peaks[1:-2], peaks[2:-1])
    acceleration = np.concatenate([peaks[:1], inner, peaks[-1:]]) if len(speed) > 1 else peaks[:1]
    return speed, acceleration


def write_urscript(moves: StandardMoves, body: RigidBody, path: Path) -> None:
    """Write a program of one `movej` a line; it refuses to begin where the arm does not stand at the start."""
    chain = moves.chain
    speed, acceleration = leading(chain)
    radii = [*blend_radii(chain, body), 0.0]
    lines = [
        f"# {', '.join(moves.trajectory.joints)}",
        f"# Planned for {chain.duration:.6f} s, for motion version 1 (constant acceleration in ramps).",
        "# v and a are those of the leading axis, r is at the last joint's frame. Blends are the controller's own:",
        "# run it slowly first, pace = 0.1 in the line below (blends then differ more).",
        "def energy_opt_moves():",
        "  local pace = 1.0",
        *check_start(chain.corners[0]),
    ]
    for q, v, a, r in zip(chain.corners[1:], speed, acceleration, radii, strict=True):
        lines.append(f"  movej({vector(q)}, a={a:.6f} * pace * pace, v={v:.6f} * pace, r={r:.6f})")
    write_text(path, "\n".join([*lines, "end", ""]))


def write_yaml(moves: StandardMoves, body: RigidBody, path: Path) -> None:
    """Write corners, times and what most controllers ask for, in plain terms."""
    chain = moves.chain
    speed, acceleration = leading(chain)
    radii = [*blend_radii(chain, body), 0.0]
    sliding = [joint for joint, slides in zip(body.joints, body.slides, strict=True) if slides]
    unit = "rad" + (f" ({', '.join(sliding)}: m)" if sliding else "")
    lines = [
        "format: energy-opt/moves/1",
        f"kind: {moves.kind}",
        f"joints: [{', '.join(moves.trajectory.joints)}]",
        f"start: {_list(chain.corners[0])}  # {unit}, at rest",
        f"duration: {chain.duration!r}  # s",
        "moves:  # joint moves; at a blend the ramp from one line's velocity to the next's stands for the via point",
    ]
    for i, q in enumerate(chain.corners[1:]):
        lines += [
            f"- to: {_list(q)}  # rad",
            f"  velocity: {_list(chain.velocities[i])}  # rad/s on the line, all joints together",
            f"  leading_velocity: {float(speed[i])!r}  # rad/s",
            f"  leading_acceleration: {float(acceleration[i])!r}  # rad/s^2",
            f"  blend_radius: {float(radii[i])!r}  # m, of the last joint's frame; 0: the move ends there",
        ]
    lines.append("ramps:  # changes of velocity, in order")
    for start, tau, u, peak in zip(chain.ramp_starts, chain.ramps, chain.rises, chain.accelerations, strict=True):
        lines += [
            f"- start: {float(start)!r}  # s",
            f"  duration: {float(tau)!r}  # s",
            f"  rise: {float(u)!r}  # s in which the acceleration reaches its peak, and falls again at the end",
            f"  acceleration: {_list(peak)}  # rad/s^2, peak",
        ]
    write_text(path, "\n".join([*lines, ""]))


def write(moves: StandardMoves, body: RigidBody, out: Path) -> list[str]:
    """Write moves.yaml, and moves.script where the arm has six joints; the files' names."""
    write_yaml(moves, body, out / "moves.yaml")
    names = ["moves.yaml"]
    if len(moves.chain.corners[0]) == JOINTS:
        write_urscript(moves, body, out / "moves.script")
        names.append("moves.script")
    return names


def _list(values: Sequence[float] | np.ndarray) -> str:
    return "[" + ", ".join(repr(float(x)) for x in values) + "]"
