"""The sums of a retiming over its points, as CasADi functions of path acceleration a and squared speed b.

A point's share of the energy is weight P(a, b) / sqrt(b), with the power law of the model. In it

    sign(v)      is exactly that of q': the path is passed forwards; a joint that the path does not move is held by
                 friction: max(|tau| - level, 0) is convex in (a, b), and so is its square over sqrt(b)
    max(x, 0)    of a drive power x becomes sqrt(b) psi(x / sqrt(b)), psi(y) = (y + sqrt(y^2 + d^2) - d) / 2

x / sqrt(b), energy per length, is convex in (a, b) (quadratic over concave), and psi is convex and does not fall, so
the smoothed problem is as convex as the exact one. psi never exceeds the exact law, so lower bounds remain valid.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache

import casadi as ca
import numpy as np

from energy_opt.effects import COBOT, ArmSize, Kinks, Signals
from energy_opt.effects.parameter import bearing
from energy_opt.motion.limits.base import Limit, State
from energy_opt.motion.path_dynamics import PathDynamics, offsets
from energy_opt.numerics.batch import Batch
from energy_opt.power import drive_terms
from energy_opt.power.structure import SharedByStructure

# Widths of the smoothed kinks, as multiples of those in each law. Wide kinks come first only where a solve with narrow
# ones failed.
NARROW, WIDE = 1.0, 100.0


@dataclass(frozen=True)
class AlongPath(Kinks):
    """Kinks for a path that is passed forwards at speed `rate` = sqrt(b); `typical` is a usual value of it.

    `width` multiplies the smoothing width of every kink. Signs, and powers with their sign, are exact: they are fixed
    along the path.
    """

    rate: ca.SX
    typical: ca.SX
    width: ca.SX
    size: ArmSize = COBOT

    def direction(self, v: ca.SX, load: ca.SX, level: ca.SX) -> ca.SX:
        """sign(v) of a joint that the path moves; otherwise the direction in which friction carries the load."""
        return ca.if_else(v == 0, bearing(load, level), ca.sign(v))

    def magnitude(self, x: ca.SX, width: float) -> ca.SX:
        """|x|, smoothed; see `smooth`."""
        return self.smooth(x, width * self.width)

    def positive(self, x: ca.SX, width: float) -> ca.SX:
        """sqrt(b) psi(x / sqrt(b)), see the module: max(x, 0) smoothed in energy per length."""
        y = x / self.rate
        return self.rate * (y + self.smooth(y, width * self.width / self.typical)) / 2

    def smooth(self, x: ca.SX, d: ca.SX) -> ca.SX:
        """sqrt(x^2 + d^2) - d."""
        return ca.sqrt(x * x + d * d) - d

    def moving(self, v: ca.SX) -> ca.SX:
        """1: the arm moves along the whole path."""
        return ca.SX(1)


class Tangents(AlongPath):
    """The supporting lines of the exact kinks, with the slopes of the smoothed kinks at the same point.

    A clamp is nowhere below slope * x for any slope between 0 and 1, and with fixed slopes the law is convex: its
    bounds are bounds of the exact law, without the smoothed law's offset of half its width.
    """

    def smooth(self, x: ca.SX, d: ca.SX) -> ca.SX:
        """The supporting line of |x| with the slope of the smoothed function: x times x / sqrt(x^2 + d^2)."""
        return x * x / ca.sqrt(x * x + d * d)


@dataclass(frozen=True)
class Expanded(AlongPath):
    """Smoothed kinks, expanded to second order at a point, with second derivatives that are given.

    `found`: of each kink its argument x, width d, the symbol of x at the point and that of the second derivative.
    """

    found: list[tuple[ca.SX, ca.SX, ca.SX, ca.SX]] = field(default_factory=list)

    def smooth(self, x: ca.SX, d: ca.SX) -> ca.SX:
        """The expansion of sqrt(x^2 + d^2) - d."""
        at, second = ca.SX.sym("at", *x.shape), ca.SX.sym("second", *x.shape)
        self.found.append((ca.densify(x), d * ca.SX.ones(*x.shape), at, second))
        root = ca.sqrt(at * at + d * d)
        return root - d + at / root * (x - at) + second / 2 * (x - at) ** 2


def _triangle(h: ca.SX) -> ca.SX:
    """The upper triangle of a matrix, column by column."""
    full = ca.densify(h)
    return ca.vertcat(*(full[i, j] for j in range(h.shape[1]) for i in range(j + 1)))


Form = Callable[[ca.SX, ca.SX, ca.SX, ArmSize], AlongPath]  # from rate, typical, width and size


@dataclass(frozen=True)
class Law:
    """The model's law at a point, (z, at, shared) -> the state there, with motor torque and power.

    Attributes:
        z: (2, 1) path acceleration a and squared path speed b, in `unit`.
        at: (N, 1) q, q', q'', M, C, G (see `path_dynamics.offsets`) and the time [s], for effects that depend on it.
        shared: the model's values, the unit of a and b [1/s^2] and the width of the kinks.
    """

    z: ca.SX
    at: ca.SX
    shared: ca.SX
    state: State
    kinks: AlongPath


@lru_cache(maxsize=16)
def law(shared_by: SharedByStructure, n: int, form: Form = AlongPath) -> Law:
    """The law of a model's structure on n joints; built once.

    Args:
        form: the kinks: `AlongPath` smoothed, `Tangents` their supporting lines, `Expanded` to second order.
    """
    parts = offsets(shared_by.model, n)
    z, at = ca.SX.sym("z", 2), ca.SX.sym("at", parts[-1] + 1)
    unit, width = ca.SX.sym("unit"), ca.SX.sym("width")
    p = shared_by.model.symbols(n)
    q, q1, q2, inertial, centrifugal, gravity = ca.vertsplit(at[:-1], parts)
    a, b = unit * z[0], unit * z[1]
    rate = ca.sqrt(b)
    tau = inertial * a + centrifugal * b + gravity
    signals = Signals(q, q1 * rate, q1 * a + q2 * b, tau, at[-1])
    kinks = form(rate, ca.sqrt(unit), width, shared_by.size)
    drive = drive_terms(shared_by.model, signals, p, kinks, holds=True)
    state = State(signals.q, signals.v, signals.a, drive.tau_m, drive.power, signals.t, drive.powers)
    return Law(z, at, ca.vertcat(p, unit, width), state, kinks)


@lru_cache(maxsize=16)
def law_function(shared_by: SharedByStructure, n: int, form: Form = AlongPath) -> ca.Function:
    """(z, at, shared) -> power [W], motor torque (n, 1) [N m]; the inputs are those of `Law`, `form` that of `law`."""
    built = law(shared_by, n, form)
    return ca.Function("law", [built.z, built.at, built.shared], [built.state.power, built.state.effort])


@lru_cache(maxsize=16)
def general_terms(shared_by: SharedByStructure, n: int) -> list[ca.Function]:
    """A point's share of the cost, weight / sqrt(b) (energy P + time), for any model.

    z = (a, b) in the problem's unit; `at` is that of the law, then the weight; `shared` is that of the law, then the
    factors of energy and time.

    Returns:
        (z, at, shared) -> cost and its gradient (2, 1);
        (z, at, shared) -> the smoothed kinks' arguments and widths, (k, 1) each;
        (z, second, at, shared) -> upper triangle (3, 1) of the Hessian, with `second` (k, 1) for the second derivatives
        of the kinks.
    """

    def share(built: Law) -> tuple[ca.SX, list[ca.SX]]:
        given = [built.z, ca.vertcat(built.at, weight), ca.vertcat(built.shared, factors)]
        return weight / ca.sqrt(built.z[1]) * (factors[0] * built.state.power + factors[1]), given

    weight, factors = ca.SX.sym("weight"), ca.SX.sym("factors", 2)
    built, expanded = law(shared_by, n), law(shared_by, n, Expanded)
    (cost, given), (local, at) = share(built), share(expanded)
    assert isinstance(expanded.kinks, Expanded)
    found = expanded.kinks.found
    x, d, second = (ca.vertcat(ca.SX(0, 1), *(ca.vec(kink[i]) for kink in found)) for i in (0, 1, 3))
    hessian = _triangle(ca.hessian(local, expanded.z)[0])
    for argument, _, place, _ in reversed(found):  # the arguments of later kinks may contain earlier ones
        hessian, x, d = ca.substitute([hessian, x, d], [place], [argument])
    return [
        ca.Function("value", given, [cost, ca.densify(ca.gradient(cost, built.z))]),
        ca.Function("kinks", at, [ca.densify(x), ca.densify(d)]),
        ca.Function("curvature", [at[0], second, *at[1:]], [ca.densify(hessian)]),
    ]


def _monomials(a: np.ndarray, b: np.ndarray) -> list[np.ndarray]:
    """1, a, b, a^2, a b, b^2, sqrt(b), a sqrt(b), b sqrt(b)."""
    root = b**0.5
    return [1 + 0 * a, a, b, a * a, a * b, b * b, root, root * a, root * b]


DEGREES = np.array([0, 1, 1, 2, 2, 2, 0.5, 1.5, 1.5])  # degrees of the monomials in (a, b)
_PROBES = np.array(
    [(0, 0.02), (0, 0.15), (0, 0.4), (0, 0.8), (0, 1.3), (5, 0.05), (5, 0.4), (5, 1.2), (-4, 0.2), (-2, 0.9)],
    dtype=float,
).T
_INVERSE = np.linalg.pinv(np.stack(_monomials(*_PROBES), axis=1))
_RESIDUAL = np.eye(_PROBES.shape[1]) - np.stack(_monomials(*_PROBES), axis=1) @ _INVERSE


@lru_cache(maxsize=16)
def _probed(shared_by: SharedByStructure, n: int) -> ca.Function:
    """(at (N, 1), shared) -> power at every probe, (10, 1)."""
    built, function = law(shared_by, n), law_function(shared_by, n)
    power = ca.vertcat(*(function(ca.DM(probe), built.at, built.shared)[0] for probe in _PROBES.T))
    return ca.Function("probed", [built.at, built.shared], [power])


def compressed(shared_by: SharedByStructure, n: int, at: np.ndarray, shared: np.ndarray) -> np.ndarray | None:
    """Coefficients of the power's monomials at points; None if the law has other terms.

    Copper loss, viscous friction and all affine terms reduce to 1, a, b, a^2, a b, b^2 and sqrt(b) times 1, a, b. The
    coefficients are fitted to the law at ten probes, one more than the unknowns.

    Args:
        n: number of joints. at: (N, M) the law's input at each point. shared: (values + 2,), see `Law`.

    Returns:
        (9, M) [W] for a and b in the unit that `shared` holds.
    """
    power = Batch(_probed(shared_by, n), at.shape[1])(at.T, shared)[0].T
    if np.abs(_RESIDUAL @ power).max() > 1e-9 * np.abs(power).max():
        return None
    return _INVERSE @ power


@dataclass(frozen=True, eq=False)
class LimitByStructure:
    """A limit that equals any other of the same structure: the cache key of built functions."""

    limit: Limit

    def __hash__(self) -> int:
        return hash(self.limit.structure)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, LimitByStructure) and other.limit.structure == self.limit.structure


@lru_cache(maxsize=32)
def limit_terms(shared_by: SharedByStructure, n: int, by: LimitByStructure) -> tuple[ca.Function, ca.Function]:
    """A limit's constraints: (z, at, shared) -> value (m, 1), Jacobian (m, 2); and (z, multipliers, at, shared) ->
    upper triangle (3, 1) of their weighted Hessians.

    Args:
        n: number of joints. by: the limit, which has symbolic constraints.

    Returns:
        Both functions. Their `z` and `at` are those of the law, `shared` that of the law, then the limit's values.
    """
    built, limit = law(shared_by, n), by.limit
    values, multiplier = ca.SX.sym("values", len(limit.values)), ca.SX.sym("multiplier", limit.scale.size)
    constraints = ca.densify(limit.expression(built.state, values))
    given = [built.z, built.at, ca.vertcat(built.shared, values)]
    held = ca.hessian(ca.dot(multiplier, constraints), built.z)[0]
    return (
        ca.Function("limited", given, [constraints, ca.densify(ca.jacobian(constraints, built.z))]),
        ca.Function("limited_curvature", [built.z, multiplier, *given[1:]], [_triangle(held)]),
    )


def point_numbers(d: PathDynamics, time: np.ndarray) -> np.ndarray:
    """The input `at` of the law at the M points of `d`, (N, M), with `time` (M,) [s] in its last line; see `Law`."""
    return np.vstack([d.q.T, d.q1.T, d.q2.T, d.M.T, d.C.T, d.G.T, time])
