"""Standard moves as files: a neutral YAML, and a URScript program of `movej`.

UR's `movej(q, a, v, t, r)` takes speed and acceleration of the leading axis, the one with the longest travel, and r,
the distance from the tool's target [m] at which the blend into the next move begins. Written for motion version 1, the
only one before PolyScope 5.22: constant acceleration in both ramps. The controller shapes the blends itself; the r
written is the smaller of the two distances at which this blend leaves the first line and joins the second, so that the
controller's stays inside the corner that was judged. Every axis gets the leading one's speed and acceleration times its
share of the travel, and no more than its limits allow.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.files import read_text, read_yaml, write_text
from energy_opt.formats.controller_files import Written, assumed_kinds, worst_of
from energy_opt.formats.judging import Judging
from energy_opt.formats.urscript import JOINTS, check_start, vector
from energy_opt.motion.limits.base import Violation
from energy_opt.names import commented
from energy_opt.profiles.chain import Chain
from energy_opt.profiles.plan import StandardMoves
from energy_opt.robot import RigidBody, Robot
from energy_opt.robot.kinematics import Kinematics


def tool_point(body: RigidBody, q: np.ndarray) -> np.ndarray:
    """Origin of the last joint's frame in the base frame, (3,) [m]."""
    return np.asarray(Kinematics(body.tree())(q[None]).origin[0, body.last])


def blend_radii(chain: Chain, body: RigidBody) -> np.ndarray:
    """The distance of each via point from the nearer end of its blend, (K,) [m] at the last joint's frame."""
    w, out = chain.velocities, []
    for i, corner in enumerate(chain.corners[1:-1], start=1):
        half = chain.ramps[i] / 2
        ends = corner - w[i - 1] * half, corner + w[i] * half
        at = tool_point(body, corner)
        out.append(min(float(np.linalg.norm(tool_point(body, q) - at)) for q in ends))
    return np.array(out)


def shares(corners: np.ndarray) -> np.ndarray:
    """Each axis' share of the leading axis' travel in each move, (K + 1, n), for corners (K + 2, n)."""
    way = np.abs(np.diff(corners, axis=0))
    return np.asarray(way / np.maximum(way.max(axis=1, keepdims=True), 1e-12))


def leading(chain: Chain, limit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Speed [rad/s] and acceleration [rad/s^2] of each move's leading axis, (K + 1,) each.

    The first move's acceleration is that of its start, the last one's that of its end, and that of a move between two
    via points the larger of its blends', reduced to the limits (n,) [rad/s^2] of each axis' share of it.
    """
    speed = np.abs(chain.velocities).max(axis=1)
    peaks = np.abs(chain.accelerations).max(axis=1)
    inner = np.maximum(peaks[1:-2], peaks[2:-1])
    acceleration = np.concatenate([peaks[:1], inner, peaks[-1:]]) if len(speed) > 1 else peaks[:1]
    most = np.min(limit / np.maximum(shares(chain.corners), 1e-12), axis=1)
    return speed, np.minimum(acceleration, most)


def write_urscript(moves: StandardMoves, robot: Robot, path: Path) -> None:
    """Write a program with one `movej` per line; it refuses to begin if the arm is not at the start.

    Args:
        moves: to write. robot: for limits and blend radii. path: the file.
    """
    chain = moves.chain
    speed, acceleration = leading(chain, robot.limits.acceleration)
    radii = [*blend_radii(chain, robot.body), 0.0]
    lines = [
        f"# {', '.join(map(commented, moves.trajectory.joints))}",
        f"# Planned for {chain.duration:.6f} s, for motion version 1 (constant acceleration in ramps).",
        "# v and a are those of the leading axis, r is at the last joint's frame. Blends are the controller's own:",
        "# run it slowly first, pace = 0.1 in the line below (blends then differ more).",
        "def energy_opt_moves():",
        "  local pace = 1.0",
        *check_start(chain.corners[0]),
    ]
    for q, v, a, r in zip(chain.corners[1:], speed, acceleration, radii, strict=True):
        lines.append(f"  movej({vector(q)}, a={a:.9f} * pace * pace, v={v:.9f} * pace, r={r:.6f})")
    write_text(path, "\n".join([*lines, "end", ""]))


def write_yaml(moves: StandardMoves, robot: Robot, path: Path) -> None:
    """Write corners, times and the usual settings of controllers.

    Args:
        moves: to write. robot: for limits, blend radii and units. path: the file.
    """
    chain = moves.chain
    speed, acceleration = leading(chain, robot.limits.acceleration)
    radii = [*blend_radii(chain, robot.body), 0.0]
    sliding = [joint for joint, slides in zip(robot.joints, robot.slides, strict=True) if slides]
    unit = "rad" + (f" ({', '.join(map(commented, sliding))}: m)" if sliding else "")
    lines = [
        "format: energy-opt/moves/1",
        f"kind: {moves.kind}",
        f"joints: {json.dumps(moves.trajectory.joints)}",
        f"start: {_list(chain.corners[0])}  # {unit}, at rest",
        f"duration: {chain.duration!r}  # s",
        "moves:  # joint moves; at a blend the ramp from one line's velocity to the next's replaces the via point",
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


def write(moves: StandardMoves, robot: Robot, judge: Judging, out: Path, names: Sequence[str]) -> list[Written]:
    """Write files of standard moves; each is read back and judged.

    Args:
        moves: to write. robot: the arm. judge: of the motion. out: the folder.
        names: of the files; moves.script is added if the arm has six joints.
    """
    names = [*names, *(["moves.script"] if robot.n == JOINTS else [])]
    for name in names:
        (write_yaml if name.endswith(".yaml") else write_urscript)(moves, robot, out / name)
    return [judged(out / name, moves, judge) for name in names]


def read(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corners (K + 2, n), and speed and acceleration (K + 1,) of each move's leading axis, from a file of `write`.

    Raises:
        BadInput: it is no such file.
    """
    if path.suffix == ".yaml":
        document = read_yaml(path)
        constraints = [(m["to"], m["leading_velocity"], m["leading_acceleration"]) for m in document["moves"]]
        start = document["start"]
    else:
        text = read_text(path)
        found = re.search(r"local start = \[(.*)\]", text)
        calls = re.findall(r"movej\(\[(.*)\], a=([\d.]+) \* pace \* pace, v=([\d.]+) \* pace", text)
        if found is None or not calls:
            raise BadInput(f"{path}: not a program of standard moves")
        start = list(map(float, found[1].split(",")))
        constraints = [(list(map(float, q.split(","))), float(v), float(a)) for q, a, v in calls]
    corners, speed, acceleration = zip(*constraints, strict=True)
    return np.array([start, *corners]), np.array(speed), np.array(acceleration)


def judged(path: Path, moves: StandardMoves, judge: Judging) -> Written:
    """A file of standard moves, judged as a controller runs it: each axis with its share of speed and acceleration.

    Between two moves the blends are the planned ones.
    """
    corners, speed, acceleration = read(path)
    robot, chain = judge.scorer.robot, moves.chain
    spans = np.abs(np.diff(corners, axis=0)).max(axis=1) / speed
    certificate = judge(Chain(corners, spans, chain.ramps, chain.rises).trajectory(robot.joints))
    found = list(certificate.found)
    starts = chain.ramp_starts
    for name, most in (("velocity", speed), ("acceleration", acceleration)):
        value, bound = shares(corners) * most[:, None], getattr(robot.limits, name)
        k, j = (int(i) for i in np.unravel_index(int(np.argmax(value / bound)), value.shape))
        excess = float(value[k, j] / bound[j] - 1)
        found.append(Violation(name, excess, robot.joints[j], float(starts[k]), float(value[k, j]), float(bound[j])))
    certificate = replace(certificate, found=tuple(found))
    text = (
        f"standard moves, {chain.duration:.6g} s, each axis with its share of the leading one's speed and acceleration"
    )
    kind = "urscript" if path.suffix == ".script" else "moves"
    worst = worst_of(certificate)
    return Written(path.name, kind, None, certificate.valid, worst, text, assumed_kinds(robot))


def _list(values: Sequence[float] | np.ndarray) -> str:
    return "[" + ", ".join(repr(float(x)) for x in values) + "]"
