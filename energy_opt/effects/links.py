"""Links that are not quite as the URDF says: every arm's masses and centres of mass are off by some percent."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import casadi as ca

from energy_opt.effects.parameter import Parameter
from energy_opt.effects.stages import Link, RigidEffect


class LinkInertia(RigidEffect):
    """Deviation of every link from the URDF: its mass, its centre of mass and its inertia about that centre.

    Links are those that the joints carry, in the joints' order; what is welded to a link belongs to it. Links of joints
    that follow others (mimic) stay as the URDF has them.
    """

    name = "link_inertia"
    parameters = (
        Parameter("mass", "kg", 0.0, -1e3, 1e3, "joint"),
        Parameter("com", "m", 0.0, -10.0, 10.0, ("joint", 3)),
        Parameter("inertia", "kg m^2", 0.0, -1e3, 1e3, ("joint", 6)),
    )
    same_on_all_joints = False
    bakes = True

    @classmethod
    def links(cls, nominal: Sequence[Link], p: SimpleNamespace) -> list[Link] | None:
        out = []
        for j, (mass, com, inertia) in enumerate(nominal):
            xx, xy, yy, xz, yz, zz = (p.inertia[6 * j + i] for i in range(6))
            turned = ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))
            out.append((mass + p.mass[j], com + p.com[3 * j : 3 * j + 3], inertia + turned))
        return out
