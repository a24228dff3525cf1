"""A move around other moving arms, for cells in which no shift of times keeps the arms apart.

The schedule is fixed. First, bends and delays of the move give a curve that keeps clear of the other arms. From this
curve the reshaping continues. At every instant it uses the positions of the other arms' bodies at this instant, and at
the earliest and latest allowed times. The result is proven with the whole cycle, like every plan.

The move has a fixed duration and begins at a known time, so a place u in [0, 1] along it is an instant. Planes between
the other arms' bodies and this arm's are those of `cell.planes`; the frame of the other body depends on u only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from energy_opt.cell.bodies import Bodies, Body
from energy_opt.cell.cell import Cell, Clearance
from energy_opt.cell.planes import Near
from energy_opt.cell.proof import Proof, Touch, prove
from energy_opt.errors import Infeasible
from energy_opt.jobs.cycle import Answer
from energy_opt.motion.plan.candidates import task_of
from energy_opt.motion.plan.clear import repaired_clear
from energy_opt.motion.plan.clearing import Clearing
from energy_opt.motion.reshape.clear import TRUST
from energy_opt.motion.reshape.task import Line
from energy_opt.motion.trajectory import Trajectory
from energy_opt.robot import Limits
from energy_opt.robot.kinematics import Kinematics, Poses
from energy_opt.workcell.arm import Arm
from energy_opt.workcell.between import TwoArms, side_by_side
from energy_opt.workcell.motion import ArmMove, Part, PeriodicMotion, at_rest

Frames = tuple[np.ndarray, np.ndarray]  # rotations (K, M, 3, 3) and origins (K, M, 3) [m]


@dataclass(frozen=True)
class Others:
    """The bodies of other arms.

    Attributes:
        bodies: each on one of M frames, which `joint` numbers; -1 for fixed ones, their pose then in this arm's base.
        pairs: (P, 2) indices: of this arm's bodies, and of these. wanted: (P,) the clearance [m] that each keeps.
        frames: the M frames in this arm's base frame at places u (K,) along the move.
        prove: the proof of these pairs for a trajectory of this arm: time (N,) [s] from 0 on, position, velocity and
            acceleration (N, n); times are from 0 on too.
    """

    bodies: Sequence[Body]
    pairs: np.ndarray
    wanted: np.ndarray
    frames: Callable[[np.ndarray], Frames]
    count: int
    prove: Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], Proof]


class _Kinematics(Kinematics):
    """An arm's kinematics with further frames that none of its joints moves."""

    def __init__(self, own: Kinematics, frames: int) -> None:
        vars(self).update(vars(own))
        moves = np.zeros((own.count + frames + 1, own.count), dtype=bool)
        moves[: own.count] = own.moves[: own.count]
        self.moves = moves


class MovingBodies(Bodies):
    """The bodies of an arm and of other arms, at places along a move.

    Args:
        own: bodies and pairs of the arm. others: bodies of the other arms, with the pairs between them and the arm.
    """

    def __init__(self, own: Bodies, others: Others) -> None:
        first, count = len(own.all), own.kinematics.count
        placed = [Body(b.name, b.joint + count if b.joint >= 0 else -1, b.pose, b.solid) for b in others.bodies]
        pairs = np.vstack([own.pairs, others.pairs + [0, first]])
        super().__init__(_Kinematics(own.kinematics, others.count), [*own.all, *placed], pairs)
        self._others = others

    def poses(self, q: np.ndarray, u: np.ndarray) -> Poses:
        """Frames of this arm's links at q (K, n), and of the others' at places u (K,)."""
        own = self.kinematics(q)
        known, back = np.unique(u, return_inverse=True)
        rotation, origin = (x[back] for x in self._others.frames(known))
        return Poses(
            np.concatenate([own.rotation[:, :-1], rotation, own.rotation[:, -1:]], axis=1),
            np.concatenate([own.origin[:, :-1], origin, own.origin[:, -1:]], axis=1),
            own.axis,
        )


class MovingCell(Cell):
    """The cell of an arm among moving bodies of other arms, for one move from `start` to `goal` (n,) [rad]."""

    def __init__(self, own: Cell, others: Others, start: np.ndarray, goal: np.ndarray) -> None:
        vars(self).update(vars(own))
        self.asked = float(others.wanted.max(initial=own.asked))
        self._own, self._others, self._ends = own, others, (start, goal)
        self.bodies = MovingBodies(own.bodies, others)
        self._near = Near(self.bodies)

    def distances(self, q: np.ndarray, reach: float) -> list[tuple[int, float]]:
        """Pairs that are nearer than `reach` [m] at an end q (n,) of the move."""
        u = float(np.abs(q - self._ends[0]).max() > np.abs(q - self._ends[1]).max())
        _, number, distance, _, _ = self._near.measured(np.array([u]), q[None], reach)
        least: dict[int, float] = {}
        for pair, d in zip(self._near.pair[number].tolist(), distance.tolist(), strict=True):
            least[pair] = min(d, least.get(pair, np.inf))
        first = len(self._own.bodies.pairs)
        return [*self._own.distances(q, reach), *((p, d) for p, d in least.items() if p >= first)]

    def gap(self, u: np.ndarray, q: np.ndarray, reach: float) -> float:
        """The least distance [m] beyond the wanted clearance over all pairs, at places u (K,) and positions q (K, n).

        At most `reach` [m]: larger distances are not measured.
        """
        wanted = self.wanted(np.stack(self._ends))
        _, number, distance, _, _ = self._near.measured(u, q, float(wanted.max(initial=0.0)) + reach)
        return float((distance - wanted[self._near.pair[number]]).min(initial=reach))

    def wanted(self, ends: np.ndarray, clearance: float | None = None) -> np.ndarray:
        """`Cell.wanted` (P,) [m] at the ends of a move (2, n), followed by the clearance of the pairs with other arms.

        Args:
            ends: joint positions. clearance: [m] for all pairs with other arms; None: that of each pair.
        """
        count, wanted = len(self._others.pairs), self._others.wanted
        others = wanted if clearance is None else np.full(count, clearance)
        return np.concatenate([self._own.wanted(ends, clearance), others])

    def prove(
        self,
        time: np.ndarray,
        position: np.ndarray,
        velocity: np.ndarray,
        acceleration: np.ndarray,
        wanted: np.ndarray | None = None,
    ) -> Clearance:
        """`Cell.prove`; in addition the pairs with other arms must be proven apart.

        Args:
            time: (N,) [s]. position, velocity, acceleration: (N, n).
            wanted: (P,) [m] the distance to prove, by pair; None: as `Cell.prove`.
        """
        first = len(self._own.bodies.pairs)
        own = self._own.prove(time, position, velocity, acceleration, None if wanted is None else wanted[:first])
        proof = self._others.prove(time - time[0], position, velocity, acceleration)
        if proof.verdict == "proven":
            return own
        touches = tuple(Touch(t.time + time[0], t.pair + first, t.distance) for t in proof.touches)
        verdict = proof.verdict if own.proven else own.verdict
        pairs, touched = len(self.bodies.pairs), (*own.touches, *touches)
        return Clearance(verdict, pairs, own.disabled_pairs, own.source, touched)


PLACES = 48  # places of a first curve to check
# most bends and delays of a move; the first DRAWN start from the move itself, the others from the best so far
TRIED, DRAWN = 500, 200
SHARE = 0.4  # share of the joints that are bent at a time
BENDS = (0.1, 0.2, 0.4, 0.7)  # [rad, m] standard deviations of a joint's bends
DELAY = 0.25  # largest delay of a move's middle, as a share of the move
KEPT = 0.004  # [m] additional clearance of a first curve; the search may use some of it
FASTER = 1.5  # times a speed limit that a first curve may reach; the search reduces it
FINISHED = 3  # first curves from which the search continues

Other = tuple[Cell, PeriodicMotion, np.ndarray | None]  # another arm, its motion, and `TwoArms.clearance` from it


def move_around(
    arm: Arm, move: ArmMove, start: float, duration: float, others: Sequence[Other], jitter: float, seed: int = 0,
) -> Answer | None:  # fmt: skip
    """The move with the least energy found among others' motions; None if nothing clear was found.

    Args:
        start, duration: time and duration of the move [s].
        others: the other arms.
        jitter: how early or late every arm may be [s].
    """
    cell = arm.cell
    if cell is None:
        return None
    known = move.answers[min(move.answers, key=lambda d: abs(d - duration))].trajectory
    ends = known.position[0], known.position[-1]
    moving = MovingCell(cell, others_during(cell, others, start, duration, jitter), *ends)
    if moving.gap(np.array([0.0, 1.0]), np.stack(ends), KEPT) <= 0:
        return None  # another arm is at one of its ends
    planner = arm.worker.planner(move.leg.step)
    free = replace(move.leg.move(duration), mode="reshape", path=None)
    context = replace(planner.context(free), cell=moving)
    task = task_of(context, free, duration, duration)
    level = context.reshaper("energy").fine(task.vias)
    lines = _clear_lines(moving, known, duration, arm.job.robot.limits, seed)
    if not lines:
        return None
    work = Clearing.of(context, task, [task.curve(level.shape, line) for line in lines])
    for curve in work.curves:
        if not work.context.stopped():
            work.finish(curve, TRUST)
    if work.best is None:
        return None
    try:
        found = repaired_clear(context, work.search, task, work.best)
    except Infeasible:
        return None
    if found.trajectory is None:
        return None
    motion = at_rest(found.trajectory)
    return Answer(motion, arm.scoring.energy(move.leg.step, motion), "around another arm")


def _clear_lines(cell: MovingCell, known: Trajectory, duration: float, limits: Limits, seed: int) -> list[Line]:
    """Clear first curves: the move with a delay and with bends, in its middle and of opposite signs in its halves.

    They are drawn at random, the smallest first, and then around the one nearest to being clear.
    """
    rng = np.random.default_rng(seed)
    u = np.linspace(0, 1, PLACES)
    share = (known.time - known.time[0]) / known.duration
    joints = known.position.shape[1]
    middle = 64 * (u * (1 - u)) ** 3
    bumps = np.stack([middle, middle * 4 * (u - 0.5)])

    def line(x: np.ndarray) -> Line | None:
        when = u + np.clip(x[0], -DELAY, DELAY) * 16 * (u * (1 - u)) ** 2
        q = np.column_stack([np.interp(when, share, column) for column in known.position.T])
        q += bumps.T @ x[1:].reshape(2, joints)
        speed = np.abs(np.diff(q, axis=0)) * (PLACES - 1) / duration
        inside = (q >= limits.lower).all() and (q <= limits.upper).all() and (speed <= FASTER * limits.velocity).all()
        return Line(u, q, duration) if inside else None

    out: list[Line] = []
    best, nearest_ = np.zeros(1 + 2 * joints), -np.inf
    for k in range(TRIED):
        wide = BENDS[k * len(BENDS) // DRAWN] if k < DRAWN else BENDS[0]
        step = rng.normal(size=len(best)) * wide * (rng.random(len(best)) < SHARE)
        step[0] *= DELAY / BENDS[-1]
        x = step if k < DRAWN else best + step
        found = line(x if k else best)
        if found is None:
            continue
        gap = cell.gap(u[1:-1], found.q[1:-1], KEPT)
        if gap > nearest_:
            best, nearest_ = x, gap
        if gap >= KEPT / 2:
            out.append(found)
            if len(out) == FINISHED:
                break
    return out


def others_during(own: Cell, others: Sequence[Other], start: float, duration: float, jitter: float) -> Others:
    """The bodies of other arms during a move, over time, at the largest lead and lag between both arms too.

    Args:
        own: the moving arm's cell. others: cell, motion and clearance [m] of each. start, duration: [s] of the move.
        jitter: [s] by which each arm may be early or late.
    """
    # everything in the base frame of the moving arm, as its solver has it
    late = (0.0,) if jitter == 0 else (0.0, -2 * jitter, 2 * jitter)
    inward = np.linalg.inv(own.request.base_pose)
    bodies: list[Body] = []
    pairs: list[np.ndarray] = []
    wanted: list[np.ndarray] = []
    placed: list[tuple[Cell, PeriodicMotion, float, np.ndarray]] = []
    proofs: list[tuple[TwoArms, PeriodicMotion, float, np.ndarray]] = []
    frame = 0
    for cell, motion, clearance in others:
        two = TwoArms(own, cell, clearance)
        theirs, joint = two.of_second, cell.bodies.kinematics.count
        both = np.sort(two.bodies.pairs, axis=1)  # the first arm's bodies come first
        use = np.flatnonzero(two.bodies.joint[both[:, 0]] >= 0)
        for by in late:
            bodies += [
                Body(b.name, b.joint + frame if b.joint >= 0 else -1, b.pose if b.joint >= 0
                     else inward @ cell.request.base_pose @ b.pose, b.solid)
                for b in theirs
            ]  # fmt: skip
            own_side = np.array(two.own_numbers)[both[use, 0]]
            pairs.append(np.column_stack([own_side, both[use, 1] - len(two.own_numbers) + len(bodies) - len(theirs)]))
            wanted.append(two.wanted[use])
            placed.append((cell, motion, by, inward @ cell.request.base_pose))
            proofs.append((two, motion, by, use))
            frame += joint

    def frames(u: np.ndarray) -> Frames:
        rotations, origins = [], []
        for cell, motion, by, base in placed:
            poses = cell.bodies.kinematics(motion.at(start + u * duration + by))
            rotations.append(base[:3, :3] @ poses.rotation[:, :-1])
            origins.append(poses.origin[:, :-1] @ base[:3, :3].T + base[:3, 3])
        return np.concatenate(rotations, axis=1), np.concatenate(origins, axis=1)

    def proof(time: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> Proof:
        joints = own.robot.joints
        one = PeriodicMotion([Part("", start, duration, Trajectory(joints, time, q, v, a))], duration)
        out, first = Proof(), 0
        for two, motion, by, use in proofs:
            found = prove(two.bodies, side_by_side(two, one, motion, by, 0.0), two.wanted)
            number = {pair: first + k for k, pair in enumerate(use.tolist())}
            out.touches += [
                Touch(t.time - start, number[t.pair], t.distance) for t in found.touches if t.pair in number
            ]
            if found.verdict != "proven" and out.verdict != "colliding":
                out.verdict = found.verdict
            first += len(use)
        return out

    return Others(bodies, np.vstack(pairs), np.concatenate(wanted), frames, frame, proof)
