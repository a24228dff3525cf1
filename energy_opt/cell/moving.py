"""A cell in which other arms move while this arm does one move.

The move has a fixed duration and begins at a known time, so a place u in [0, 1] along it is an instant. The bodies of
the other arms are where they are at this instant, and also where they are if they are as early or as late as allowed.
Planes between them and this arm's bodies are those of `planes`; the frame of the other body depends on u only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.cell.bodies import Bodies, Body
from energy_opt.cell.cell import Cell, Clearance
from energy_opt.cell.planes import Near
from energy_opt.cell.proof import Proof, Touch
from energy_opt.robot.kinematics import Kinematics, Poses

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
