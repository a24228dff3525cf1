"""Inverse dynamics of a tree in which joints follow others, from those of the same tree in which none does."""

from __future__ import annotations

import casadi as ca

from energy_opt.dynamics.frames import all_joints
from energy_opt.robot.coupling import Coupling

NAMES = ["q", "v", "a", "gravity", "mass", "com"]


def coupled(function: ca.Function, coupling: Coupling) -> ca.Function:
    """(q, v, a, gravity, mass, com) -> tau of the n joints that move by themselves, from a function of all L.

    By virtual work a joint's torque is its own and that of each follower times its ratio.
    """
    if coupling.trivial:
        return function
    q, v, a = (ca.SX.sym(name, len(coupling.own)) for name in NAMES[:3])
    gravity, mass, com = ca.SX.sym("gravity", 3), ca.SX.sym("mass"), ca.SX.sym("com", 3)
    tau = function(*all_joints(coupling, q, v, a), gravity, mass, com)
    joined = ca.mtimes(ca.sparsify(ca.DM(coupling.matrix)).T, tau)
    return ca.Function("tau", [q, v, a, gravity, mass, com], [joined], NAMES, ["tau"])
