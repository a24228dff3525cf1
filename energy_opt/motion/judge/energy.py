"""The energy of a trajectory under a power model: Pinocchio's torque, the exact laws, a dense grid.

The energy is the integral of the power at the meter over the curve between the samples, by Simpson's rule. It is split
into standby, stored energy (which depends on the ends alone) and loss: only the loss can be optimized in a given time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np

from energy_opt.effects.parameter import MOVING_SPEED
from energy_opt.motion.dense import Dense, grid_of
from energy_opt.motion.judge.analytic import TorqueBound
from energy_opt.motion.trajectory import Filled, Trajectory
from energy_opt.numerics.batch import Batch
from energy_opt.power import PowerModel, drive_function
from energy_opt.power.drive_law import body_of, returned_power, rigid_inputs, rigid_torque, store_of
from energy_opt.power.motions import idle_time
from energy_opt.robot import Robot

DENSER = 10  # places per sample interval at which a trajectory is judged; even, for Simpson's rule
COARSER = 2  # the same for differences under added friction and draws, which change the power smoothly
# most places evaluated at once: some 200 MB for seven joints
BLOCK = 300_000
LONGEST = 0.01  # [s] longest sample interval under effects that end while the arm is at rest


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
        """As result.json has it."""
        return asdict(self)


@dataclass(frozen=True)
class Past:
    """What came before a motion.

    Attributes:
        time: s since the first sample. idle: s since the last motion ended; -1 if there was none.
        stored: J in the model's store.
    """

    time: float = 0.0
    idle: float = -1.0
    stored: float = 0.0


NONE = Past()


def _finely_sampled(trajectory: Trajectory) -> Trajectory:
    """The same curve with sample intervals of at most `LONGEST`."""
    counts = np.ceil(np.diff(trajectory.time) / LONGEST - 1e-6).astype(int)
    if counts.max() <= 1:
        return trajectory
    begins, step = np.repeat(trajectory.time[:-1], counts), np.repeat(np.diff(trajectory.time) / counts, counts)
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    time = np.append(begins + within * step, trajectory.time[-1])
    return Trajectory(trajectory.joints, time, *trajectory.sample(time)[:3])


def blocks(trajectory: Trajectory, factor: int) -> list[slice]:
    """The samples of a trajectory in slices that share their ends, each of at most `BLOCK` places."""
    last = len(trajectory.time) - 1
    step = max(BLOCK // factor, 1)
    return [slice(first, min(first + step, last) + 1) for first in range(0, last, step)]


class Scorer:
    """Scores trajectories of one robot under one model; build it once, use it for many."""

    def __init__(self, robot: Robot, model: PowerModel) -> None:
        model.check(robot.n)
        self.robot, self.model = robot, model
        self._laws: dict[str, ca.Function] = {}
        self._drive, self.parts = drive_function(model, robot.n, past=True, holds=True)
        self._values = model.values(robot.n)

    @cached_property
    def adds_torque(self) -> bool:
        """True if any effect changes the rigid body's torque."""
        return any(e.stage == "torque" for _, member in self.model.weighted for e in member.effects)

    @cached_property
    def remembers(self) -> bool:
        """True if power depends on the past: a store, or power drawn for a while after a motion."""
        effects = [effect for _, member in self.model.weighted for effect in member.effects]
        return store_of(self.model) is not None or any(effect.follows for effect in effects)

    @property
    def depends_on_past(self) -> bool:
        """True if the energy of a motion depends on what came before it."""
        return self.remembers or any(effect.drifts for _, one in self.model.weighted for effect in one.effects)

    @cached_property
    def _waits(self) -> bool:
        """True if power depends on the time since a motion ended."""
        return any("idle" in effect.follows for _, member in self.model.weighted for effect in member.effects)

    @cached_property
    def torque_bounds(self) -> list[TorqueBound]:
        """Bounds on the torque between places, of each of the model's rigid bodies."""
        return [TorqueBound(model, self.robot.body) for model in self.model.bodies]

    def law_of(self, name: str) -> ca.Function:
        """The law's output "tau_m" or "powers" as a function of (q, v, a, tau, t), for models without memory."""
        if name not in self._laws:
            n = self.robot.n
            q, v, a, tau = (
                ca.SX.sym(*of) for of in (("q", n), ("v", n), ("a", n), ("tau", n * len(self.model.bodies)))
            )
            t = ca.SX.sym("t")
            out = self._drive(q=q, v=v, a=a, tau=tau, t=t, idle=-1, returned=0, p=self._values)[name]
            self._laws[name] = ca.Function(name, [q, v, a, tau, t], [out])
        return self._laws[name]

    def drive(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray, t: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Motor torque (N, n) [N m], power (N,) [W] and its parts (N, len(self.parts)) [W] by the exact laws.

        Friction holds a joint at rest: the power includes this, the limited torque does not.
        Instants are in order of time; each counts for half the time to both neighbours.
        """
        rigid = rigid_torque(self.model, self.robot.body, q, v, a)
        return self._law(q, v, a, rigid, t, *self._past(q, v, a, rigid, t)[:2])[:3]

    def momentary(self, q: np.ndarray, v: np.ndarray, a: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Power (N,) [W] by the exact laws at instants that are no motion: there is no past, and stores are empty."""
        rigid = rigid_torque(self.model, self.robot.body, q, v, a)
        return self._law(q, v, a, rigid, t, np.full(len(q), -1.0), np.zeros(len(q)))[1]

    def holding(self, q: np.ndarray) -> np.ndarray:
        """Power (K,) [W] of standing still at positions q (K, n)."""
        return self.drive(q, np.zeros_like(q), np.zeros_like(q), np.zeros(len(q)))[1]

    def _past(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray, rigid: np.ndarray, t: np.ndarray, before: Past = NONE
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """The past of instants in order: time since motion ended (N,) [s], and power that a store returns (N,).

        Also the energy [J] in the store at the end.
        """
        if not self.remembers:
            return np.full(len(q), -1.0), np.zeros(len(q)), before.stored
        idle, back = idle_time(t, v, before.idle), np.zeros(len(q))
        if store_of(self.model) is None or len(q) < 2:
            return idle, back, before.stored
        bus = self._law(q, v, a, rigid, t, idle, back)[4]
        return idle, *returned_power(self.model, np.gradient(t), bus, before.stored)

    def _law(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray, rigid: np.ndarray, t: np.ndarray, idle: np.ndarray,
        back: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
        """Motor torque, power, its parts, powers, and the power (N,) at the DC link, from the rigid body's torque."""
        law = Batch(self._drive, len(q))
        tau_m, power, parts, bus, powers = law(q, v, a, rigid, t[:, None], idle[:, None], back[:, None], self._values)
        return tau_m, power[:, 0], parts, powers, bus[:, 0]

    def single_joint_parts(self, dense: Dense, joint: int) -> np.ndarray:
        """Parts of the power (N, len(self.parts)) [W] on a dense grid as if only one joint moved and had a torque."""
        own = np.arange(self.robot.n) == joint
        law, still = Batch(self._drive, len(dense.q)), np.zeros((len(dense.q), 1))
        past = idle_time(dense.time, dense.v)[:, None], still
        alone = own * dense.v, own * dense.a, np.tile(own, len(self.model.bodies)) * dense.rigid
        return law(dense.q, *alone, dense.time[:, None], *past, self._values)[2]

    def stored(self, trajectory: Trajectory) -> float:
        """Change of potential plus kinetic energy between the trajectory's ends, J."""
        ends_q, ends_v, out = trajectory.position[[0, -1]], trajectory.velocity[[0, -1]], 0.0
        for weight, member in self.model.weighted:
            out += weight * float(np.diff(self._rigid_energy(member, ends_q, ends_v))[0])
            for effect in member.effects:
                if effect.stores:
                    p = effect.named(ca.DM(effect.full(self.robot.n)), self.robot.n)
                    at = [float(effect.stored(ca.DM(q), ca.DM(v), p)) for q, v in zip(ends_q, ends_v, strict=True)]
                    out += weight * (at[1] - at[0])
        return out

    def _rigid_energy(self, model: PowerModel, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Potential and kinetic energy (K,) [J] of a model's rigid body at q, v (K, n)."""
        body = body_of(model, self.robot.body)
        return body.energy(q, v, *rigid_inputs(model, body))

    def potential(self, q: np.ndarray) -> np.ndarray:
        """Potential energy (K,) [J] of the arm at rest at q (K, n), times the share that drives and supply pass on.

        Its change between two ends is the part of a motion's energy that depends only on the ends.
        """
        n, still, out = self.robot.n, np.zeros_like(q), np.zeros(len(q))
        for weight, member in self.model.weighted:
            named = [(effect, effect.named(ca.DM(effect.full(n)), n)) for effect in member.effects]
            passed = np.prod([float(effect.return_factor(values)) for effect, values in named])
            springs = [
                [float(effect.stored(ca.DM(row), ca.DM(still[0]), values)) for row in q]
                for effect, values in named
                if effect.stores
            ]
            out += weight * passed * (self._rigid_energy(member, q, still) + np.sum(springs, axis=0))
        return out

    def dense(self, trajectory: Trajectory, factor: int = DENSER, samples: slice | None = None) -> Dense:
        """The trajectory on a grid `factor` times denser than its samples, for energy and limits.

        `samples`: those to use (None: all); time counts from the trajectory's first sample.
        """
        if samples is None:
            return self._dense(trajectory, factor)[0]
        return self._dense(trajectory.part(samples), factor, Past(trajectory.time[samples.start] - trajectory.time[0]))[
            0
        ]

    def _dense(self, trajectory: Trajectory, factor: int, past: Past = NONE) -> tuple[Dense, Past]:
        """The trajectory on a grid, and the past at its end."""
        grid = grid_of(trajectory, factor)
        time, q, v, a = grid.time + past.time, grid.q, grid.v, grid.a
        rigid = grid.torque(self.model, self.robot.body)
        idle, back, stored = self._past(q, v, a, rigid, time, past)
        driven = self._law(q, v, a, rigid, time, idle, back)[:4]
        dense = Dense(trajectory, self.robot.body, factor, time, q, v, a, grid.jerk, rigid, *driven)
        moved = bool(np.abs(v).max() > MOVING_SPEED)  # if it does not move on, its motion has just ended
        return dense, Past(float(time[-1]), 0.0 if moved and idle[-1] < 0 else float(idle[-1]), stored)

    def between(self, dense: Dense, time: np.ndarray) -> Dense:
        """A trajectory of a dense grid at other times (M,); its past is that of the preceding places."""
        q, v, a, jerk = dense.trajectory.sample(time + (dense.trajectory.time[0] - dense.time[0]))
        idle, back, _ = self._past(dense.q, dense.v, dense.a, dense.rigid, dense.time)
        before = np.searchsorted(dense.time, time, side="right") - 1
        still = (np.abs(v).max(axis=1) <= MOVING_SPEED) & (idle[before] >= 0)
        idle = np.where(still, idle[before] + time - dense.time[before], -1.0)
        rigid = rigid_torque(self.model, self.robot.body, q, v, a)
        driven = self._law(q, v, a, rigid, time, idle, np.interp(time, dense.time, back))[:4]
        return Dense(dense.trajectory, dense.body, 1, time, q, v, a, jerk, rigid, *driven)

    def energy(self, trajectory: Trajectory, factor: int = DENSER) -> Energy:
        """Energy of the curve through the samples, on a grid `factor` (even) times denser."""
        return self.energy_after(NONE, trajectory, factor)[0]

    def energy_after(self, past: Past, trajectory: Trajectory, factor: int = DENSER) -> tuple[Energy, Past]:
        """As `energy`, of a motion that has a past; and the past at its end.

        Args:
            past: what came before the first sample. factor: even, places for each sample interval.
        """
        if self._waits:
            trajectory = _finely_sampled(trajectory)
        pieces = []
        for part in blocks(trajectory, factor):
            dense, past = self._dense(trajectory.part(part), factor, past)
            pieces.append(self.energy_of_piece(dense))
        return self.energy_of_pieces(trajectory, pieces), past

    def energy_of(self, dense: Dense) -> Energy:
        """Energy of a trajectory that is already on a dense grid (of an even factor), by Simpson's rule."""
        return self.energy_of_pieces(dense.trajectory, [self.energy_of_piece(dense)])

    def energy_of_pieces(self, trajectory: Trajectory, spent: Sequence[tuple[float, dict[str, float]]]) -> Energy:
        """The energy of a trajectory, from those of its pieces in `spent` (see `energy_of_piece`)."""
        total = sum(whole for whole, _ in spent)
        by_effect = {name: sum(parts[name] for _, parts in spent) for name in spent[0][1]}
        standby = sum(by_effect[name] for name in dict.fromkeys(e.name for e in self.model.effects if e.overhead))
        stored = self.stored(trajectory)
        return Energy(total, standby, stored, total - standby - stored, by_effect)

    def energy_of_piece(self, dense: Dense) -> tuple[float, dict[str, float]]:
        """Energy [J] of a piece of a trajectory, in all and by effect."""
        weight = dense.weight
        by_effect = dict(zip(self.parts, (weight @ dense.parts).tolist(), strict=True))
        total = float(weight @ dense.power)
        rigid = list(dict.fromkeys(e.name for e in self.model.effects if e.stage == "rigid"))
        for name in rigid:  # its share of the rigid body's mechanical work, compared with the model without it
            grid = grid_of(dense.trajectory, dense.factor)
            added = sum(
                w * (grid.torque(one, self.robot.body) - grid.torque(one.without(name), self.robot.body))
                for w, one in self.model.weighted
            )
            share = float(weight @ np.sum(added * dense.v, axis=1))
            by_effect[name] = share
            by_effect["mechanical"] -= share
        return total, by_effect

    def filled(self, trajectory: Trajectory, past: Past = NONE) -> Filled:
        """The trajectory with effort and power at its samples."""
        return self._dense(trajectory, 1, past)[0].filled


APART = 0.01  # relative difference above which the joints' separate losses do not add up to the common loss


def loss_by_joint(scorer: Scorer, trajectory: Trajectory) -> dict[str, np.ndarray]:
    """Energy (n,) [J] that each effect takes at each joint, by the effect's name.

    The law is evaluated once for each joint, with only that joint's speed, acceleration and torque. Effects of the
    whole arm (overhead, supply, a store on the bus) cannot be divided in this way, and are left out.

    Args:
        scorer: of the power model. trajectory: is judged on the usual dense grid.
    """
    dense = scorer.dense(trajectory)
    names = list(scorer.parts)
    spent = np.zeros((scorer.robot.n, len(names)))
    for j in range(scorer.robot.n):
        spent[j] = dense.weight @ scorer.single_joint_parts(dense, j)
    together = dense.weight @ dense.parts
    standing = {e.name for e in scorer.model.effects if e.overhead or e.stores} | {"mechanical"}
    out = {}
    for k, name in enumerate(names):
        whole = max(abs(float(together[k])), 1e-9)
        adds_up = abs(float(spent[:, k].sum() - together[k])) < APART * whole
        if name not in standing and adds_up and np.abs(spent[:, k]).max() > 1e-6:
            out[name] = spent[:, k]
    return out
