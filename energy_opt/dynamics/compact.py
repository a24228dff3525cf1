"""Symbolic inverse dynamics with a short expression graph: the Newton-Euler recursion on scalars.

The tree is rewritten numerically first (see `canonical`), so most constants of the recursion are 0 or +-1 and CasADi
folds them. Per link, with angular velocity w, angular acceleration dw and acceleration l of its origin (gravity
included as an upward acceleration of the base):

    U = [dw]x + [w]x [w]x
    f = m l + U h                              force
    t = h x l + integral of r x (U r) dm       torque about the origin
      where (integral)_i = sum_k (U_jk S_ki' - ...) is written out below from U and the second moment S

Forward kinematics of a tool come from the same tree. Per link, with angular velocity w, angular acceleration dw,
velocity o and acceleration l of its origin, all in its own frame, from the base down:

    w' = R^T w + z v            o' = R^T (o + w x r)                    (prismatic: o' + z v)
    dw' = R^T dw + w' x z v + z a       l' = R^T (l + dw x r + w x (w x r))     (prismatic: l' + 2 w' x z v + z a)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from energy_opt.dynamics.canonical import (
    NAMES,
    JointFrame,
    Vector,
    all_joints,
    canonical,
    coupled,
    cross,
    plus,
    snapped,
    times,
)
from energy_opt.robot import Tool
from energy_opt.robot.kinematics import Coupling, Link, outermost


def _wrench(
    inertia: Sequence[Sequence[ca.SX]], w: Vector, dw: Vector, origin: Vector
) -> tuple[list[Vector], Vector, Vector]:
    """Force and torque of a link by its motion, and U.

    With U = [dw]x + [w]x [w]x, a point r of the link has the acceleration l + U r. The force is the integral of this
    over the mass, m l + U h. The torque about the origin is the integral of r x (l + U r) dm = h x l + integral of r x
    U r dm. With the second moment S, the integral of r (U r)^T dm is S U^T, so component x of the last term is (U S)_zy
    - (U S)_yz.

    Args:
        inertia: (4, 4) pseudo-inertia. w, dw: angular velocity [rad/s] and acceleration [rad/s^2]. origin: acceleration
            l of the origin [m/s^2], gravity included. All in the link's frame.

    Returns:
        U (3, 3), force (3,) [N], torque (3,) [N m].
    """
    xx, yy, zz = w[0] * w[0], w[1] * w[1], w[2] * w[2]
    xy, xz, yz = w[0] * w[1], w[0] * w[2], w[1] * w[2]
    u = [
        [-(yy + zz), xy - dw[2], xz + dw[1]],
        [xy + dw[2], -(xx + zz), yz - dw[0]],
        [xz - dw[1], yz + dw[0], -(xx + yy)],
    ]
    s, h, m = inertia, [inertia[i][3] for i in range(3)], inertia[3][3]
    force = plus([m * x for x in origin], times(u, h))
    # (integral of r x U r)_x = (U S)_zy - (U S)_yz; the product with the diagonal of U leaves (U_zz - U_yy) S_yz
    spin = [
        u[2][0] * s[0][1] + u[2][1] * s[1][1] - u[1][0] * s[0][2] - u[1][2] * s[2][2] + (zz - yy) * s[1][2],
        u[0][1] * s[1][2] + u[0][2] * s[2][2] - u[2][0] * s[0][0] - u[2][1] * s[0][1] + (xx - zz) * s[0][2],
        u[1][0] * s[0][0] + u[1][2] * s[0][2] - u[0][1] * s[1][1] - u[0][2] * s[1][2] + (yy - xx) * s[0][1],
    ]
    return u, force, plus(cross(h, origin), spin)


def torque_function(tree: Sequence[Link]) -> ca.Function:
    """Inverse dynamics (q, v, a, gravity, mass, com) -> tau.

    q, v, a (n, 1) of the joints that move by themselves; gravity (3, 1) [m/s^2] in the base frame; a payload's mass
    [kg] and centre com (3, 1) [m] in the last joint's frame; tau (n, 1) [N m]. Call it with numbers for gravity and
    payload to get their shorter graph.
    """
    return coupled(_of_all(tree), Coupling.of(tree))


def _of_all(tree: Sequence[Link]) -> ca.Function:
    """Inverse dynamics of the tree as if all of its L joints were independent; arguments as `torque_function`."""
    n, last = len(tree), outermost(tree)
    links = canonical(tree)
    q, v, a = (ca.SX.sym(name, n) for name in ("q", "v", "a"))
    gravity, mass, com = ca.SX.sym("gravity", 3), ca.SX.sym("mass"), ca.SX.sym("com", 3)
    zero: Vector = [ca.SX(0)] * 3

    # A point mass m at x adds m [x; 1] [x; 1]^T to the pseudo-inertia.
    point = ca.mtimes(ca.DM(links[last].from_original), ca.vertcat(com, 1))
    inertias = [ca.SX(ca.DM(link.pseudo_inertia)) for link in links]
    inertias[last] = inertias[last] + mass * ca.mtimes(point, point.T)

    joints: list[JointFrame] = []
    us: list[list[Vector]] = []
    ws: list[Vector] = []
    dws: list[Vector] = []
    origins: list[Vector] = []
    forces: list[Vector] = []
    torques: list[Vector] = []
    for k, link in enumerate(links):
        joint, p = JointFrame(link, q[k]), link.parent
        root = p < 0
        w, dw = joint.down(zero if root else ws[p]), joint.down(zero if root else dws[p])
        above = [-gravity[i] for i in range(3)] if root else plus(origins[p], times(us[p], joint.offset))
        origin = joint.down(above)
        if link.prismatic:
            origin = plus(origin, [2 * (w[1] * v[k]), -2 * (w[0] * v[k]), a[k]])
        else:
            dw = [dw[0] + w[1] * v[k], dw[1] - w[0] * v[k], dw[2] + a[k]]
            w = [w[0], w[1], w[2] + v[k]]
        scalars = [[inertias[k][i, j] for j in range(4)] for i in range(4)]
        u, force, torque = _wrench(scalars, w, dw, origin)
        joints.append(joint)
        ws.append(w)
        dws.append(dw)
        origins.append(origin)
        us.append(u)
        forces.append(force)
        torques.append(torque)

    # From the tips to the base: sum forces and torques, and take the component along each joint's axis z.
    tau = [ca.SX(0)] * n
    for k in reversed(range(n)):
        link = links[k]
        tau[k] = (forces if link.prismatic else torques)[k][2] + float(link.armature) * a[k]
        if link.parent >= 0:
            force = joints[k].up(forces[k])
            forces[link.parent] = plus(forces[link.parent], force)
            moment = plus(joints[k].up(torques[k]), cross(joints[k].offset, force))
            torques[link.parent] = plus(torques[link.parent], moment)
    return ca.Function("tau", [q, v, a, gravity, mass, com], [ca.vertcat(*tau)], NAMES, ["tau"])


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
    """Position and motion of a tool as expressions.

    Args:
        tree: the links. tool: the joint that carries it, and its pose (4, 4) there. q, v, a: (n, 1) of the independent
            joints.

    Returns:
        The `ToolState`. The recursions are those of the module's text, from the base to the tool's joint; the last step
            is from that joint's origin to the tool's.
    """
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
