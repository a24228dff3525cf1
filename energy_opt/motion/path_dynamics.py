"""The dynamics of an arm on a fixed path, as functions of path acceleration a and squared path speed b.

    velocity      q' sqrt(b)
    acceleration  q' a + q'' b
    jerk          (q' w + 3 q'' a + q''' b) sqrt(b)          with w = da/ds
    torque        M a + C b + G                              rigid body, affine
    motor torque  the rigid body's plus every torque effect

The path is passed forwards, so the sign of a joint's velocity is that of q' and Coulomb friction depends only on s.
"""

from __future__ import annotations

import copy
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from energy_opt.effects import EXACT, Signals
from energy_opt.motion.path import JointPath
from energy_opt.numerics.batch import Batch
from energy_opt.power import PowerModel, drive_terms
from energy_opt.power.drive_law import rigid_torque
from energy_opt.power.structure import SharedByStructure
from energy_opt.robot import Robot, Tool

AFFINE = 1e-9  # relative: torque that deviates less from its tangent counts as affine
CRAWL = 1e-9  # [1/s^2] squared path speed for "about to move": friction has its sign, other dynamic terms vanish


def offsets(model: PowerModel, n: int) -> list[int]:
    """Where q, q', q'' (n each) and M, C, G (n each for every body of the model) begin in one column, and its end."""
    return np.cumsum([0, n, n, n, *[n * len(model.bodies)] * 3]).tolist()


@lru_cache(maxsize=32)
def _motor_torque(shared: SharedByStructure, n: int) -> ca.Function:
    """(a, b, [q, q', q'', M, C, G], p) -> motor torque and its derivatives with respect to a and b, (n, 1) each."""
    a, b, at = ca.SX.sym("a"), ca.SX.sym("b"), ca.SX.sym("at", int(offsets(shared.model, n)[-1]))
    q, q1, q2, inertial, centrifugal, gravity = ca.vertsplit(at, offsets(shared.model, n))
    tau = inertial * a + centrifugal * b + gravity
    p = shared.model.symbols(n)
    x = Signals(q, q1 * ca.sqrt(b), q1 * a + q2 * b, tau, ca.SX(0))
    tau_m = drive_terms(shared.model, x, p, EXACT).tau_m
    out = [ca.densify(x) for x in (tau_m, ca.jacobian(tau_m, a), ca.jacobian(tau_m, b))]
    return ca.Function("motor_torque", [a, b, at, p], out)


@lru_cache(maxsize=16)
def _exact_power(shared_by: SharedByStructure, n: int) -> ca.Function:
    """(q, v, a, tau, t, p) -> power [W] by the exact laws, and that under each member of a mixture."""
    q, v, a = (ca.SX.sym(name, n) for name in ("q", "v", "a"))
    tau = ca.SX.sym("tau", n * len(shared_by.model.bodies))
    t, p = ca.SX.sym("t"), shared_by.model.symbols(n)
    terms = drive_terms(shared_by.model, Signals(q, v, a, tau, t), p, holds=True)
    return ca.Function("exact_power", [q, v, a, tau, t, p], [terms.power, terms.powers])


def has_torque_effects(model: PowerModel) -> bool:
    """Does the motors' torque differ from the rigid body's?"""
    return any(e.stage == "torque" for e in model.effects)


class PathDynamics:
    """Coefficients at path positions s (M,): q, q1, q2 (path and derivatives; (M, n) each), M, C, G (torque).

    The coefficients of torque are (M, n B), those of the model's B `bodies` one after the other. Torque limits apply to
    the first one.
    """

    def __init__(self, robot: Robot, model: PowerModel, path: JointPath, s: np.ndarray) -> None:
        self.robot, self.model, self.path, self.s = robot, model, path, s
        self.q, self.q1, self.q2 = (path(s, order) for order in range(3))
        self._affine: bool | None = None
        self._tools: dict[Tool, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}

    @property
    def M(self) -> np.ndarray:
        """Torque per path acceleration, (M, n B) [N m s^2]."""
        return self._torque[0]

    @property
    def C(self) -> np.ndarray:
        """Torque per squared path speed, (M, n B) [N m s^2]."""
        return self._torque[1]

    @property
    def G(self) -> np.ndarray:
        """Holding torque, (M, n B) [N m]."""
        return self._torque[2]

    @cached_property
    def _torque(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        zero = np.zeros_like(self.q)
        # three inverse dynamics in one call, so that payload and tilt are applied once
        torque = rigid_torque(
            self.model,
            self.robot.body,
            np.concatenate([self.q] * 3),
            np.concatenate([zero, zero, self.q1]),
            np.concatenate([zero, self.q1, self.q2]),
        )
        holding, inertial, centrifugal = np.split(torque, 3)
        return inertial - holding, centrifugal - holding, holding

    def at(self, s: np.ndarray) -> PathDynamics:
        """The same at other path positions (K,)."""
        return PathDynamics(self.robot, self.model, self.path, s)

    def under(self, model: PowerModel) -> PathDynamics:
        """The same for a model with the same payloads and tilts."""
        other = copy.copy(self)
        other.model, other._affine = model, None
        return other

    def motor_torque(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Torque of the motors (M, n) [N m] by the exact laws, at path accelerations a and squared speeds b (M,)."""
        if not has_torque_effects(self.model):
            return (self.M * a[:, None] + self.C * b[:, None] + self.G)[:, : self.robot.n]
        return self._evaluated(a, b)[0]

    def power(self, a: np.ndarray, b: np.ndarray, time: np.ndarray | None = None) -> np.ndarray:
        """Power (M,) [W] by the exact laws, at path accelerations a, squared speeds b and times (M,), 0 by default."""
        return self._powers(a, b, time)[0].ravel()

    def powers(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """The same under each member of a mixture, (M, K) [W]."""
        return self._powers(a, b)[1]

    def _powers(self, a: np.ndarray, b: np.ndarray, time: np.ndarray | None = None) -> list[np.ndarray]:
        a, b = a[:, None], b[:, None]
        t = np.zeros_like(b) if time is None else time[:, None]
        columns = (self.q, self.q1 * np.sqrt(b), self.q1 * a + self.q2 * b, self.M * a + self.C * b + self.G, t)
        law = Batch(_exact_power(SharedByStructure(self.model), self.robot.n), len(self.s))
        return law(*columns, self.model.values(self.robot.n))

    def tool_motion(self, tool: Tool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A tool's poses (M, 4, 4) in the base frame, and the motion of its origin.

        Velocity per path speed [m] and acceleration per squared path speed [m], (M, 3) each; path acceleration adds its
        multiple of the former to the acceleration.
        """
        if tool not in self._tools:
            pose = np.array(tool.pose)
            self._tools[tool] = self.robot.body.frame_motion(tool.joint, pose, self.q, self.q1, self.q2)
        return self._tools[tool]

    def affine_torque(self, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(ma, mb, m0), (M, n) each: the tangent m0 + ma a + mb b of the motors' torque at (a, b).

        It is exact everywhere if the effects are affine (Coulomb friction, armature, spring); for viscous friction,
        which grows with sqrt(b), the tangent lies above it on the driving side.
        """
        if not has_torque_effects(self.model):
            own = slice(self.robot.n)
            return self.M[:, own], self.C[:, own], self.G[:, own]
        here, ma, mb = self._evaluated(a, b)
        return ma, mb, here - ma * a[:, None] - mb * np.maximum(b, CRAWL)[:, None]

    def affine(self, b: float) -> bool:
        """Is the motors' torque affine in (a, b)? Tested near the squared path speed b."""
        if self._affine is None:
            self._affine = not has_torque_effects(self.model) or self._deviation(b) <= AFFINE
        return self._affine

    def _deviation(self, b: float) -> float:
        one = np.full(len(self.s), b)
        ma, mb, m0 = self.affine_torque(0 * one, one)
        tried = [(a, c, self.motor_torque(a, c)) for a, c in ((-one, 0.3 * one), (one, 0.7 * one))]
        off = [np.abs(ma * a[:, None] + mb * c[:, None] + m0 - t).max() / (1 + np.abs(t).max()) for a, c, t in tried]
        return float(max(off))

    def _evaluated(self, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        n = self.robot.n
        at = np.hstack([self.q, self.q1, self.q2, self.M, self.C, self.G])
        law = Batch(_motor_torque(SharedByStructure(self.model), n), len(self.s))
        tau_m, ma, mb = law(a[:, None], np.maximum(b, CRAWL)[:, None], at, self.model.values(n))
        return tau_m, ma, mb


def points_of(path: JointPath, count: int) -> np.ndarray:
    """About `count` evenly spaced path positions (M,), with points close to both sides of every knot of the path."""
    inner = path.knots[1:-1]
    return np.unique(np.concatenate([np.linspace(0, 1, count), inner - 1e-9, inner]))
