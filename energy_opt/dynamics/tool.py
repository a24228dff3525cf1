"""Symbolic forward kinematics of a tool, from the same compact tree as the inverse dynamics.

Per link, with angular velocity w, angular acceleration dw, velocity o and acceleration l of its origin, all in its own
frame, from the base down:

    w' = R^T w + z v            o' = R^T (o + w x r)                    (prismatic: o' + z v)
    dw' = R^T dw + w' x z v + z a       l' = R^T (l + dw x r + w x (w x r))     (prismatic: l' + 2 w' x z v + z a)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from energy_opt.dynamics.canonical import JointFrame, Vector, all_joints, canonical, cross, plus, snapped, times
from energy_opt.robot import Link, Tool
from energy_opt.robot.kinematics import Coupling


@dataclass(frozen=True)
class ToolState:
    """A tool's origin and axes as expressions.

    position (3, 1) [m] and rotation (3, 3), of which the columns are the tool's axes, in the base frame; velocity
    (3, 1) [m/s] and acceleration (3, 1) [m/s^2], gravity aside, in a frame that turns with the tool.
    """

    position: ca.SX
    rotation: ca.SX
    velocity: ca.SX
    acceleration: ca.SX


def tool_state(tree: Sequence[Link], tool: Tool, q: ca.SX, v: ca.SX, a: ca.SX) -> ToolState:
    """Where a tool is and how it moves, for joint positions, velocities and accelerations (n, 1)."""
    links = canonical(tree)
    q, v, a = all_joints(Coupling.of(tree), q, v, a)
    chain = [tool.joint]
    while links[chain[0]].parent >= 0:
        chain.insert(0, links[chain[0]].parent)
    pose = snapped(links[tool.joint].from_original @ np.asarray(tool.pose))
    point: Vector = [ca.SX(float(x)) for x in pose[:3, 3]]
    frames = [JointFrame(links[k], q[k]) for k in chain]
    w: Vector = [ca.SX(0)] * 3
    dw, origin, pull = w, w, w
    for k, frame in zip(chain, frames, strict=True):
        swing = cross(w, frame.offset)
        origin = frame.down(plus(origin, swing))
        pull = frame.down(plus(pull, plus(cross(dw, frame.offset), cross(w, swing))))
        w, dw = frame.down(w), frame.down(dw)
        if links[k].prismatic:
            pull = plus(pull, [2 * w[1] * v[k], -2 * w[0] * v[k], a[k]])
            origin = plus(origin, [ca.SX(0), ca.SX(0), v[k]])
        else:
            dw = [dw[0] + w[1] * v[k], dw[1] - w[0] * v[k], dw[2] + a[k]]
            w = [w[0], w[1], w[2] + v[k]]
    swing = cross(w, point)
    velocity = plus(origin, swing)
    acceleration = plus(pull, plus(cross(dw, point), cross(w, swing)))
    place, axes = point, [[ca.SX(float(x)) for x in column] for column in pose[:3, :3].T]
    for frame in reversed(frames):
        place = plus(frame.up(place), frame.offset)
        axes = [frame.up(axis) for axis in axes]
    turned = times(pose[:3, :3].T.tolist(), velocity), times(pose[:3, :3].T.tolist(), acceleration)
    return ToolState(
        ca.vertcat(*place), ca.horzcat(*(ca.vertcat(*axis) for axis in axes)), *(ca.vertcat(*x) for x in turned)
    )
