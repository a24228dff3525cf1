"""The functions of one collocation node: all parts of a problem that depend on the robot and its model.

The rest of a reshaping problem is linear algebra with constant matrices, so only these few functions are
differentiated, compiled and cached. A node's variables are z = (q, q', q'', T): position and its derivatives with
respect to u = t / T, and the duration; then v = q' / T and a = q'' / T^2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from energy_opt.dynamics import torque_function
from energy_opt.effects import COBOT, ArmSize, RigidEffect, Signals, Smooth
from energy_opt.errors import BadInput
from energy_opt.motion.limits.base import Limit, State
from energy_opt.motion.move import OBJECTIVES
from energy_opt.power import PowerModel, drive_terms
from energy_opt.power.drive_law import body_of
from energy_opt.robot import RigidBody


@dataclass(frozen=True)
class NodeFunctions:
    """CasADi functions of one node; `u` is its place in [0, 1], `p` holds the model's values and `values_of` limits.

    cost: (z, u, p) -> (e, de/dz) with e the rate of the objective per unit of u.
    limited: (z, u, p) -> (g, dg/dz) with g (m, 1) the limited quantities at a node, such as motor torque.
    curvature: (z, u, p, s, lam) -> Hessian of s e + lam^T g, dense (nz, nz).
    value: (z, u, p) -> (e, g), without derivatives.
    kinked: the laws have kinks, so that the width over which they are smoothed matters.
    """

    cost: ca.Function
    limited: ca.Function
    curvature: ca.Function
    value: ca.Function
    kinked: bool = False

    def as_list(self) -> list[ca.Function]:
        """All functions, in the order in which they are compiled."""
        return [self.cost, self.limited, self.curvature, self.value]


@dataclass(frozen=True)
class NodeSymbols:
    """A node's variables as CasADi symbols, and derived quantities: v [rad/s], a [rad/s^2], t [s]."""

    q: ca.SX
    q1: ca.SX
    q2: ca.SX
    duration: ca.SX
    u: ca.SX

    @classmethod
    def of(cls, joints: int) -> NodeSymbols:
        """Fresh symbols for an arm of `joints` joints."""
        q, q1, q2 = (ca.SX.sym(name, joints) for name in ("q", "q1", "q2"))
        return cls(q, q1, q2, ca.SX.sym("T"), ca.SX.sym("u"))

    @property
    def v(self) -> ca.SX:
        """Velocity (n, 1) [rad/s]: q' / T."""
        return self.q1 / self.duration

    @property
    def a(self) -> ca.SX:
        """Acceleration (n, 1) [rad/s^2]: q'' / T^2."""
        return self.q2 / self.duration**2

    @property
    def t(self) -> ca.SX:
        """Time [s]: u T."""
        return self.u * self.duration

    @property
    def z(self) -> ca.SX:
        """The variables of differentiation: q, q', q'' and T, (3 n + 1, 1)."""
        return ca.vertcat(self.q, self.q1, self.q2, self.duration)


def symbolic_torque(model: PowerModel, body: RigidBody, q: ca.SX, v: ca.SX, a: ca.SX, p: ca.SX, dynamics: str) -> ca.SX:
    """Rigid-body torque (n B, 1) [N m] of the model's B `bodies`, one after the other.

    Args:
        q, v, a: (n, 1) the joints' motion.
        p: the model's values, laid out as `PowerModel.values`: payload and tilt stay symbols. Deviating links enter as
            numbers.
        dynamics: source of the dynamics, see `dynamics.torque_function`.
    """
    out: dict[int, ca.SX] = {}
    for _, one, number, values_of_one in model.shares(body.n, p):
        if number in out:
            continue
        own = body_of(one, body)
        gravity, mass, com = ca.SX(ca.DM(own.gravity)), ca.SX(0), ca.SX.zeros(3)
        for effect, where in zip(one.effects, one.slices(own.n), strict=True):
            if isinstance(effect, RigidEffect):
                values = effect.named(values_of_one[where], own.n)
                gravity = effect.gravity(gravity, values)
                mass, com = effect.point_mass(values) or (mass, com)
        out[number] = torque_function(own, dynamics)(q, v, a, gravity, mass, com)
    return out[0] if len(out) == 1 else ca.cse(ca.vertcat(*out.values()))


def node_functions(
    model: PowerModel,
    body: RigidBody,
    limits: Sequence[Limit],
    objective: str = "energy",
    dynamics: str = "auto",
    size: ArmSize = COBOT,
) -> NodeFunctions:
    """Build the node functions of a model's and the limits' structure on a robot; values enter as parameters.

    Args:
        limits: those with symbolic constraints (a `scale`) are constrained at nodes, in this order.
        objective: "energy" (J, without the conservative work, which depends on the ends alone: in the cost it would
            only let the solver exploit the quadrature of a term that changes sign), "torque" (integral of |tau_m|^2
            over time), "power_squared" (integral of sum (tau_m v)^2 over time), "path_length" (integral of |q'|^2 over
            u) or "time" (T).
        dynamics: source of the dynamics, see `dynamics.torque_function`.
        size: the arm's, for the widths of smoothed kinks.

    Raises:
        BadInput: an unknown objective.
    """
    if objective not in OBJECTIVES:
        raise BadInput(f"objective {objective!r}; expected one of {', '.join(OBJECTIVES)}")
    n = body.n
    x = NodeSymbols.of(n)
    p, v, a, width = model.symbols(n), x.v, x.a, ca.SX.sym("width")
    tau = symbolic_torque(model, body, x.q, v, a, p, dynamics)
    terms = drive_terms(model, Signals(x.q, v, a, tau, x.t), p, Smooth(width, size), holds=True)
    rate = {
        "energy": lambda: x.duration * (terms.power - terms.conservative),
        "torque": lambda: x.duration * ca.dot(terms.tau_m, terms.tau_m),
        "power_squared": lambda: x.duration * ca.sumsqr(terms.tau_m * v),
        "path_length": lambda: ca.dot(x.q1, x.q1),
        "time": lambda: x.duration,
    }[objective]()
    state = State(x.q, v, a, terms.tau_m, terms.power, x.t, terms.powers)
    constraints, values = [], []
    for limit in limits:
        if limit.scale.size:
            values.append(ca.SX.sym(limit.name, len(limit.values)))
            constraints.append(limit.expression(state, values[-1]))
    return derived(rate, ca.vertcat(*constraints), x, ca.vertcat(p, *values), width)


def derived(rate: ca.SX, limited: ca.SX, x: NodeSymbols, p: ca.SX, width: ca.SX | None = None) -> NodeFunctions:
    """The node functions, with exact derivatives, of expressions in a node's symbols.

    Args:
        rate: cost per unit of u. limited: (m, 1) the limited quantities.
        x: the symbols. p: symbols of all values; `width` is appended to them.
        width: symbol for the factor of the widths of smoothed kinks; None if there are none.
    """
    p = ca.vertcat(p, ca.SX.sym("width") if width is None else width)
    z, u, s, lam = x.z, x.u, ca.SX.sym("s"), ca.SX.sym("lam", limited.numel())
    jacobian = ca.densify(ca.jacobian(limited, z))
    hessian = ca.densify(ca.hessian(s * rate + ca.dot(lam, limited), z)[0])
    names = ["z", "u", "p"]
    return NodeFunctions(
        cost=ca.Function("cost", [z, u, p], [rate, ca.densify(ca.gradient(rate, z))], names, ["e", "grad"]),
        limited=ca.Function("limited", [z, u, p], [ca.densify(limited), jacobian], names, ["g", "jac"]),
        curvature=ca.Function("curvature", [z, u, p, s, lam], [hessian], [*names, "s", "lam"], ["hess"]),
        value=ca.Function("value", [z, u, p], [rate, ca.densify(limited)], names, ["e", "g"]),
        kinked=width is not None and bool(ca.depends_on(ca.vertcat(rate, limited), width)),
    )
