"""Symbolic inverse dynamics from Pinocchio itself. Both sources need more than a plain install.

`from_templates` uses Pinocchio's C++ templates, compiled as the extension `energy_opt_pinsx` (see
extensions/pinocchio_sx). `from_pinocchio` uses `pinocchio.casadi`, if Pinocchio was built with it; its PyPI wheel was
not.
"""

from __future__ import annotations

import casadi as ca

from energy_opt.dynamics.canonical import NAMES, coupled, snapped
from energy_opt.errors import BadInput
from energy_opt.robot.rigid_body import RigidBody


def from_templates(body: RigidBody) -> ca.Function | None:
    """Inverse dynamics (q, v, a, gravity, mass, com) -> tau as in `compact`; None without the extension.

    Raises:
        BadInput: the last joint of the tree is not the outermost, to which the payload is attached.
    """
    try:
        import energy_opt_pinsx
    except ImportError:
        return None
    if body.last != len(body.tree()) - 1:
        raise BadInput("--dynamics templates: the tree's longest branch must be its last one; use compact")
    links = [
        energy_opt_pinsx.Link(
            prismatic=link.prismatic,
            parent=link.parent,
            placement=snapped(link.placement).tolist(),
            axis=snapped(link.axis).tolist(),
            mass=link.mass,
            lever=link.lever.tolist(),
            inertia=link.inertia.tolist(),
            armature=link.armature,
        )
        for link in body.tree()
    ]
    return coupled(energy_opt_pinsx.inverse_dynamics(links), body.coupling)


def from_pinocchio(body: RigidBody) -> ca.Function | None:
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
