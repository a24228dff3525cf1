"""Symbolic inverse dynamics of a robot, from one of several sources, compared with Pinocchio before use.

A source is a function from a `RigidBody` to a CasADi function (q, v, a, gravity, mass, com) -> tau (see
`compact.torque_function`). It returns None if it is not available on this machine.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from energy_opt.dynamics import compact, pinocchio_casadi
from energy_opt.errors import BadInput, EnergyOptError
from energy_opt.robot import PointMass, RigidBody

STATES = 8  # random states at which a function is compared with Pinocchio
TOLERANCE = 1e-9  # relative to the largest torque of each state
SOURCES = ("auto", "pinocchio", "compact")


_BUILDERS: dict[str, Callable[[RigidBody], ca.Function | None]] = {
    "pinocchio": pinocchio_casadi.torque_function,
    "compact": lambda body: compact.torque_function(body.tree()),
}


def torque_function(body: RigidBody, source: str = "auto") -> ca.Function:
    """Symbolic inverse dynamics (q, v, a, gravity, mass, com) -> tau, compared with `pin.rnea` at random states.

    Args:
        body: the rigid body.
        source: "compact" (this package's recursion, which has the shortest graph), "pinocchio" (`pinocchio.casadi`), or
            "auto", which is "compact".

    Returns:
        A function of q, v, a (n, 1), gravity (3, 1) [m/s^2] in the base frame, a payload's mass [kg] and centre
            (3, 1) [m] in the last joint's frame; tau is (n, 1) [N m].

    Raises:
        BadInput: an unknown source, or one that is not on this machine.
        EnergyOptError: the torque differs from Pinocchio's by more than 1e-9 of the largest torque.
    """
    if source not in SOURCES:
        raise BadInput(f"--dynamics {source!r}; expected one of {', '.join(SOURCES)}")
    function = _BUILDERS["compact" if source == "auto" else source](body)
    if function is None:
        raise BadInput(f"--dynamics {source}: not available on this machine; compact always is")
    verify(function, body)
    return function


def verify(function: ca.Function, body: RigidBody) -> float:
    """Largest relative difference from `pin.rnea` at STATES random states with random gravity and payload.

    Raises:
        EnergyOptError: it exceeds TOLERANCE.
    """
    rng = np.random.default_rng(0)
    worst = 0.0
    for _ in range(STATES):
        q, v, a = rng.uniform(-3, 3, body.n), rng.normal(size=body.n), rng.normal(size=body.n)
        gravity, mass, com = rng.normal(size=3) * 9.81, rng.uniform(0, 3), rng.normal(size=3) / 10
        expected = body.torque(q, v, a, PointMass(mass, com), gravity)[0]
        error = np.abs(np.array(function(q, v, a, gravity, mass, com)).ravel() - expected).max()
        worst = float(np.maximum(worst, error / max(np.abs(expected).max(), 1e-9)))  # NaN stays NaN
    if not worst <= TOLERANCE:
        raise EnergyOptError(f"symbolic torque differs from Pinocchio's by {worst:.1e} relative (at most 1e-9)")
    return worst
