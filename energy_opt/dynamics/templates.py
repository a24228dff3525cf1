"""Symbolic inverse dynamics from Pinocchio's own templates, where the extension `energy_opt_pinsx` is installed.

The extension is built from extensions/pinocchio_sx; a plain install does not need it.
"""

from __future__ import annotations

import casadi as ca

from energy_opt.dynamics.canonical import snapped
from energy_opt.dynamics.coupled import coupled
from energy_opt.errors import BadInput
from energy_opt.robot.rigid_body import RigidBody


def torque_function(body: RigidBody) -> ca.Function | None:
    """Inverse dynamics (q, v, a, gravity, mass, com) -> tau as in `compact`; None without the extension.

    Raises:
        BadInput: the last joint of the tree is not the outermost, which is where the payload hangs.
    """
    try:
        import energy_opt_pinsx
    except ImportError:
        return None
    if body.last != len(body.tree()) - 1:
        raise BadInput("--dynamics templates: not for trees whose longest branch is not the last; compact is")
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
