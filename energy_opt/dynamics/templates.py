"""Symbolic inverse dynamics from Pinocchio's own templates, where the extension `energy_opt_pinsx` is installed.

The extension is built from extensions/pinocchio_sx; a plain install does not need it.
"""

from __future__ import annotations

import casadi as ca

from energy_opt.dynamics.canonical import snapped
from energy_opt.robot.rigid_body import RigidBody


def torque_function(body: RigidBody) -> ca.Function | None:
    """Inverse dynamics (q, v, a, gravity, mass, com) -> tau as in `compact`; None without the extension."""
    try:
        import energy_opt_pinsx
    except ImportError:
        return None
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
    return energy_opt_pinsx.inverse_dynamics(links)
