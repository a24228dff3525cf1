"""Inverse dynamics of an arm as a CasADi function, written down by Pinocchio's own templates on `casadi::SX`."""

from __future__ import annotations

import casadi as ca  # first: the extension then binds to the library that is already loaded

from energy_opt_pinsx import _core

if ca.__version__ != _core.casadi_version:
    raise ImportError(
        f"energy_opt_pinsx was built for casadi {_core.casadi_version}, but {ca.__version__} is installed; "
        "build it again against that version"
    )

Link = _core.Link

__all__ = ["Link", "inverse_dynamics"]


def inverse_dynamics(links: list[Link]) -> ca.Function:
    """Function (q, v, a, gravity, mass, com) -> tau of a tree of one-degree-of-freedom joints.

    Args:
        links: parents before children. Per link: `prismatic`; `parent` (index, -1 for the base); `placement` (4, 4) of
            the joint's frame in the parent's; unit `axis` (3,); `mass` [kg]; `lever` (3,) [m] to the centre of mass;
            `inertia` (3, 3) [kg m^2] about it; `armature` [kg m^2].

    Returns:
        q, v, a and tau (n, 1); gravity (3, 1) [m/s^2] in the base frame; a payload's mass [kg] and centre com (3, 1)
        [m] in the last link's frame. A revolute joint's position is its angle, whether it has an end or not.

    Raises:
        ValueError: no link, or a parent that does not come before its child.
    """
    return ca.Function.deserialize(_core.inverse_dynamics(links))
