"""Symbolic inverse dynamics with a short expression graph: the Newton-Euler recursion on scalars.

The tree is rewritten numerically first (see `canonical`), so most constants of the recursion are 0 or +-1 and CasADi
folds them. Per link, with angular velocity w, angular acceleration dw and acceleration l of its origin (gravity
included as an upward acceleration of the base):

    U = [dw]x + [w]x [w]x
    f = m l + U h                              force
    t = h x l + integral of r x (U r) dm       torque about the origin
      where (integral)_i = sum_k (U_jk S_ki' - ...) is written out below from U and the second moment S
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from energy_opt.dynamics.canonical import NAMES, JointFrame, Vector, canonical, coupled, cross, plus, times
from energy_opt.robot.kinematics import Coupling, Link, outermost


def _wrench(
    inertia: Sequence[Sequence[ca.SX]], w: Vector, dw: Vector, origin: Vector
) -> tuple[list[Vector], Vector, Vector]:
    """U, force and torque about the origin of a link with pseudo-inertia `inertia` (4 x 4)."""
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
    """Inverse dynamics as if every joint moved by itself."""
    n, last = len(tree), outermost(tree)
    links = canonical(tree)
    q, v, a = (ca.SX.sym(name, n) for name in ("q", "v", "a"))
    gravity, mass, com = ca.SX.sym("gravity", 3), ca.SX.sym("mass"), ca.SX.sym("com", 3)
    zero: Vector = [ca.SX(0)] * 3

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
