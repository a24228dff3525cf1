"""The energy of a trajectory under a power model: Pinocchio's torque, the exact laws, a dense grid."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel, drive_function
from energy_opt.power.past import idle_time, returned_power, store_of
from energy_opt.power.rigid import body_of, rigid_inputs, rigid_torque
from energy_opt.robot import Robot

# Gauss-Legendre nodes and weights on [0, 1], applied between every two rows: exact for polynomials of degree 7.
_X, _W = np.polynomial.legendre.leggauss(4)
NODES, WEIGHTS = (_X + 1) / 2, _W / 2


@dataclass(frozen=True)
class Energy:
    """Energy of a motion, J, as result.json reports it.

    total = standby + stored + loss, and by_effect adds up to total. standby is constant overhead times duration (with
    its drift); stored is the change of potential and kinetic energy between the ends (of rotors and springs too).
    """

    total: float
    standby: float
    stored: float
    loss: float
    by_effect: dict[str, float] = field(default_factory=dict)

    def document(self) -> dict[str, object]:
        """As it stands in result.json."""
        return {
            "total": self.total,
            "standby": self.standby,
            "stored": self.stored,
            "loss": self.loss,
            "by_effect": self.by_effect,
        }


class Scorer:
    """Scores trajectories of one robot under one model; build it once, use it for many."""

    def __init__(self, robot: Robot, model: PowerModel) -> None:
        model.check(robot.n)
        self.robot, self.model = robot, model
        self._drive, self.parts = drive_function(model, robot.n, past=True)
        self._values = model.values(robot.n)

    def drive(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray, t: np.ndarray, step: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Motor torque (N, n) [N m], power (N,) [W] and its parts (N, len(self.parts)) [W] by the exact laws.

        Instants are in order of time; each stands for `step` (N,) s, by default for the time to its neighbours.
        """
        tau = rigid_torque(self.model, self.robot.body, q, v, a)
        columns = [x.T for x in (q, v, a, tau)]
        values = np.repeat(self._values[:, None], len(q), axis=1)
        idle, back = idle_time(t, v)[None], np.zeros((1, len(q)))
        tau_m, power, parts, bus = self._drive(*columns, np.atleast_2d(t), idle, back, values)
        if store_of(self.model) is not None and len(q) > 1:
            step = np.gradient(t) if step is None else step
            back = returned_power(self.model, step, np.array(bus).ravel())[None]
            tau_m, power, parts, _ = self._drive(*columns, np.atleast_2d(t), idle, back, values)
        return np.array(tau_m).T, np.array(power).ravel(), np.array(parts).T

    def stored(self, trajectory: Trajectory) -> float:
        """Change of potential plus kinetic energy between the trajectory's ends, J."""
        body = body_of(self.model, self.robot.body)
        payload, gravity = rigid_inputs(self.model, body)
        ends_q, ends_v = trajectory.position[[0, -1]], trajectory.velocity[[0, -1]]
        out = float(np.diff(body.energy(ends_q, ends_v, payload, gravity))[0])
        for effect in self.model.effects:
            if effect.stores:
                p = effect.named(ca.DM(effect.full(self.robot.n)), self.robot.n)
                at = [float(effect.stored(ca.DM(q), ca.DM(v), p)) for q, v in zip(ends_q, ends_v, strict=True)]
                out += at[1] - at[0]
        return out

    def energy(self, trajectory: Trajectory) -> Energy:
        """Energy of the curve that the rows stand for, by Gauss quadrature between rows."""
        step = np.diff(trajectory.time)
        time = (trajectory.time[:-1, None] + step[:, None] * NODES).ravel()
        weight = (step[:, None] * WEIGHTS).ravel()
        q, v, a, _ = trajectory.sample(time)
        _, power, parts = self.drive(q, v, a, time - trajectory.time[0], weight)
        by_effect = dict(zip(self.parts, (weight @ parts).tolist(), strict=True))
        total = float(weight @ power)
        standby = sum(by_effect[e.name] for e in self.model.effects if e.overhead)
        stored = self.stored(trajectory)
        rigid = [e.name for e in self.model.effects if e.stage == "rigid"]
        tau = rigid_torque(self.model, self.robot.body, q, v, a) if rigid else None
        for name in rigid:  # its share of the rigid body's mechanical work, against the model without it
            bare = rigid_torque(self.model.without(name), self.robot.body, q, v, a)
            share = float(weight @ np.sum((tau - bare) * v, axis=1))
            by_effect[name] = share
            by_effect["mechanical"] -= share
        return Energy(total, standby, stored, total - standby - stored, by_effect)

    def filled(self, trajectory: Trajectory) -> Trajectory:
        """The trajectory with effort and power at its rows."""
        t = trajectory.time - trajectory.time[0]
        tau_m, power, _ = self.drive(trajectory.position, trajectory.velocity, trajectory.acceleration, t)
        return replace(trajectory, effort=tau_m, power=power)
