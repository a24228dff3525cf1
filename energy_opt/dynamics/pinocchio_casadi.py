"""Symbolic inverse dynamics by `pinocchio.casadi`, which conda-forge's Pinocchio has and its PyPI wheel has not."""

from __future__ import annotations

import casadi as ca

from energy_opt.dynamics.canonical import NAMES, coupled
from energy_opt.robot.rigid_body import RigidBody


def torque_function(body: RigidBody) -> ca.Function | None:
    """Inverse dynamics (q, v, a, gravity, mass, com) -> tau as in `compact`; None without `pinocchio.casadi`."""
    found = body.on_casadi()
    if found is None:
        return None
    pinocchio, model = found
    count = len(body.tree())
    q, v, a = (ca.SX.sym(name, count) for name in NAMES[:3])
    gravity, mass, com = ca.SX.sym("gravity", 3), ca.SX.sym("mass"), ca.SX.sym("com", 3)
    model.gravity = pinocchio.Motion(gravity, ca.SX.zeros(3))
    last = body.last + 1  # link 0 is the base
    model.inertias[last] = model.inertias[last] + pinocchio.Inertia(mass, com, ca.SX.zeros(3, 3))
    # a continuous joint is stored as cosine and sine
    configuration = ca.vertcat(
        *[ca.vertcat(ca.cos(q[k]), ca.sin(q[k])) if body.continuous[k] else q[k] for k in range(count)]
    )
    tau = pinocchio.rnea(model, model.createData(), configuration, v, a)
    return coupled(ca.Function("tau", [q, v, a, gravity, mass, com], [tau], NAMES, ["tau"]), body.coupling)
