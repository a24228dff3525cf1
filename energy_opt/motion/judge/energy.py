"""The energy of a trajectory under a power model: Pinocchio's torque, the exact laws, a dense grid."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import casadi as ca
import numpy as np

from energy_opt.motion.trajectory import Trajectory
from energy_opt.numerics.batch import Batch
from energy_opt.power import PowerModel, drive_function
from energy_opt.power.rigid import rigid_inputs, rigid_torque
from energy_opt.robot import Robot

DENSER = 10  # places between two rows at which a trajectory is judged; even, for Simpson's rule


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


@dataclass(frozen=True)
class Dense:
    """A trajectory on a grid that is `factor` times denser than its rows, by Pinocchio's torque and the exact laws.

    time (M,) [s] from 0; q, v, a, jerk (M, n); effort (M, n) [N m] the motors' torque; power (M,) [W] and its parts
    by effect (M, parts). Every `factor`-th of them is a row.
    """

    trajectory: Trajectory
    factor: int
    time: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    jerk: np.ndarray
    effort: np.ndarray
    power: np.ndarray
    parts: np.ndarray

    @cached_property
    def weight(self) -> np.ndarray:
        """Simpson's weights (M,) [s] of an integral over time; `factor` is even.

        At 4 ms between rows and ten places between them the rule errs by about 1e-10 of a smooth integral, and
        by a tenth of a row where a law has a kink.
        """
        step = np.diff(self.trajectory.time) / self.factor
        pattern = np.tile([2.0, 4.0], self.factor // 2) / 3
        weight = np.append((step[:, None] * pattern).ravel(), 0.0)
        pairs = step / 3  # an interval's first and last place count once on either side
        weight[:: self.factor] = np.append(pairs, 0.0) + np.append(0.0, pairs)
        return weight

    @property
    def filled(self) -> Trajectory:
        """The trajectory with effort and power at its rows."""
        return replace(self.trajectory, effort=self.effort[:: self.factor], power=self.power[:: self.factor])


class Scorer:
    """Scores trajectories of one robot under one model; build it once, use it for many."""

    def __init__(self, robot: Robot, model: PowerModel) -> None:
        model.check(robot.n)
        self.robot, self.model = robot, model
        self._drive, self.parts = drive_function(model, robot.n)
        self._values = model.values(robot.n)

    def drive(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray, t: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Motor torque (N, n) [N m], power (N,) [W] and its parts (N, len(self.parts)) [W] by the exact laws."""
        tau = rigid_torque(self.model, self.robot.body, q, v, a)
        tau_m, power, parts = Batch(self._drive, len(q))(q, v, a, tau, t[:, None], self._values)
        return tau_m, power[:, 0], parts

    def stored(self, trajectory: Trajectory) -> float:
        """Change of potential plus kinetic energy between the trajectory's ends, J."""
        payload, gravity = rigid_inputs(self.model, self.robot.body)
        ends_q, ends_v = trajectory.position[[0, -1]], trajectory.velocity[[0, -1]]
        out = float(np.diff(self.robot.body.energy(ends_q, ends_v, payload, gravity))[0])
        for weight, member in self.model.weighted:
            for effect in member.effects:
                if effect.stores:
                    p = effect.named(ca.DM(effect.full(self.robot.n)), self.robot.n)
                    at = [float(effect.stored(ca.DM(q), ca.DM(v), p)) for q, v in zip(ends_q, ends_v, strict=True)]
                    out += weight * (at[1] - at[0])
        return out

    def dense(self, trajectory: Trajectory, factor: int = DENSER) -> Dense:
        """The trajectory on a grid `factor` times denser than its rows: what energy and limits are read from."""
        time = trajectory.denser(factor) - trajectory.time[0]
        q, v, a, jerk = trajectory.sample_denser(factor)
        return Dense(trajectory, factor, time, q, v, a, jerk, *self.drive(q, v, a, time))

    def energy(self, trajectory: Trajectory) -> Energy:
        """Energy of the curve that the rows stand for."""
        return self.energy_of(self.dense(trajectory))

    def energy_of(self, dense: Dense) -> Energy:
        """Energy of a trajectory that lies on a dense grid already (of an even factor), by Simpson's rule."""
        q, v, a, weight = dense.q, dense.v, dense.a, dense.weight
        by_effect = dict(zip(self.parts, (weight @ dense.parts).tolist(), strict=True))
        total = float(weight @ dense.power)
        standby = sum(by_effect[name] for name in dict.fromkeys(e.name for e in self.model.effects if e.overhead))
        stored = self.stored(dense.trajectory)
        rigid = list(dict.fromkeys(e.name for e in self.model.effects if e.stage == "rigid"))
        tau = rigid_torque(self.model, self.robot.body, q, v, a) if rigid else None
        for name in rigid:  # its share of the rigid body's mechanical work, against the model without it
            bare = rigid_torque(self.model.without(name), self.robot.body, q, v, a)
            share = float(weight @ np.sum((tau - bare) * v, axis=1))
            by_effect[name] = share
            by_effect["mechanical"] -= share
        return Energy(total, standby, stored, total - standby - stored, by_effect)

    def filled(self, trajectory: Trajectory) -> Trajectory:
        """The trajectory with effort and power at its rows."""
        return self.dense(trajectory, 1).filled
