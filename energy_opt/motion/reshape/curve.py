"""Curves of a shape, q(t) = sum of control points times quintic B-splines of u = t / T, and the outcome of a search."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from energy_opt.motion.reshape.layout import Ends, Shape


@dataclass(frozen=True)
class Curve:
    """A move over u = t / T in [0, 1].

    Attributes:
        points: (controls, n) [rad, m] its control points.
        duration: T [s].
        via_u: (vias,) the times u at which it passes the via points.
    """

    shape: Shape
    points: np.ndarray
    duration: float
    via_u: np.ndarray

    def position(self, u: np.ndarray) -> np.ndarray:
        """Positions (M, n) at u (M,)."""
        return self.shape.basis.matrix(u) @ self.points

    def derivatives(self, u: np.ndarray) -> list[np.ndarray]:
        """Position, velocity, acceleration and jerk (M, n) at t = u T."""
        return [self.shape.basis.matrix(u, k) @ self.points / self.duration**k for k in range(4)]


SPENT = "iterations"
STOPPED = {
    "sqp": "the search stopped where no further step lowers the energy, as at a kink of dry friction",
    SPENT: "the search stopped when all its iterations were spent",
    "Maximum_Iterations_Exceeded": "the search stopped when all its iterations were spent",
    "Infeasible_Problem_Detected": "the search stopped where the limits leave no room for a further step",
}


@dataclass(frozen=True)
class Outcome:
    """The result of a solve.

    Attributes:
        cost: of the objective (J for energy), standby included.
        broken: worst excess at nodes and control points as a share of a bound, or largest error [rad, m] at a via
            point; clearance from bodies does not count.
        status: "sqp", `SPENT`, or that of IPOPT.
    """

    curve: Curve
    cost: float
    broken: float
    converged: bool
    status: str
    iterations: int

    @property
    def why(self) -> str:
        """Why the solve did not converge."""
        return STOPPED.get(self.status, f"the solver stopped with {self.status}")


def fitted(
    shape: Shape, u: np.ndarray, q: np.ndarray, ends: Ends, duration: float, via_u: np.ndarray | None = None
) -> Curve:
    """The curve of `shape` closest to positions, by least squares, with exact end conditions.

    Args:
        u, q: (M,) in [0, 1], and the positions (M, n) [rad, m] there.
        ends: positions and velocities at both ends; accelerations are zero there if the shape does not free them.
        duration: T [s]. via_u: (vias,) times of the via points, which the fit does not hold; None for none.
    """
    zero = None if shape.free_acceleration else np.zeros(shape.joints)
    head = shape.basis.ends(ends.start, ends.v_start * duration, zero, False)
    tail = shape.basis.ends(ends.goal, ends.v_goal * duration, zero, True)
    places = np.zeros(0) if via_u is None else via_u
    return Curve(shape, shape.basis.fit(u, q, head, tail), duration, places)


def between(a: Curve, b: Curve, share: float) -> Curve:
    """The mixture (1 - share) a + share b of two curves of one shape: of control points, T and via times."""
    mixed = [(1 - share) * x + share * y for x, y in ((a.points, b.points), (a.via_u, b.via_u))]
    return Curve(a.shape, mixed[0], (1 - share) * a.duration + share * b.duration, mixed[1])


def refined(curve: Curve, shape: Shape, ends: Ends) -> Curve:
    """The same curve with the control points of another shape."""
    u = np.linspace(0, 1, 6 * shape.basis.controls)
    return fitted(shape, u, curve.shape.basis.matrix(u) @ curve.points, ends, curve.duration, curve.via_u)
