"""The proof that two robots never touch: both move periodically, and each may be early or late.

Both arms are combined into one tree that has the joints of both. If each arm is early or late by up to J, the time
shift d between them is in [-2 J, 2 J]: relative to the first arm, the second is at the position that it reaches d
seconds later. The bisection of `cell.proof` proves an interval of time; here an interval of d is proven with it, by
allowing the second arm any position that it can reach within half of that interval. If that fails, the interval of d is
halved.

`conflicting_parts` gives the parts of two steps that may not happen at the same time. This is a guess from samples; the
proof confirms or widens it.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from energy_opt.cell.bodies import Bodies, Body, Scenery
from energy_opt.cell.cell import TOUCHING, Cell
from energy_opt.cell.curve import MotionCurve, Spans
from energy_opt.cell.proof import prove
from energy_opt.robot.kinematics import Kinematics, Link
from energy_opt.workcell.motion import Part, PeriodicMotion

SHORTEST = 2e-4  # [s] shorter intervals of lateness are not halved again


@dataclass(frozen=True)
class Between:
    """The distance of two robots over the whole cycle.

    Attributes:
        robots: indices of the two; pair: names of the nearest bodies.
        verdict: "proven", "colliding" or "undecided".
        lower_bound: proven least distance [m]; min_distance: the least measured one, of `pair`; wanted: required
            distance of that pair [m].
        time: of that or of the collision [s]; late: lead of the second robot over the first then [s].
    """

    robots: tuple[int, int]
    verdict: str
    pairs: int
    pair: tuple[str, str] | None = None
    lower_bound: float | None = None
    min_distance: float | None = None
    time: float | None = None
    late: float = 0.0
    wanted: float | None = None


class TwoArms:
    """The bodies of two arms in one frame, and the pairs of one with the other.

    Args:
        clearance: (A, B) [m] that each body of the first keeps from each of the second; None for the cells' clearance.
    """

    def __init__(self, one: Cell, two: Cell, clearance: np.ndarray | None = None) -> None:
        self.count = one.bodies.kinematics.coupling.matrix.shape[1]
        links = [*placed_links(one, 0), *placed_links(two, one.bodies.kinematics.count)]
        bodies, arm_of = [], []
        for side, (cell, shift) in enumerate(((one, 0), (two, one.bodies.kinematics.count))):
            for body in _without_scene(cell):
                fixed = body.joint < 0
                pose = cell.request.base_pose @ body.pose if fixed else body.pose
                bodies.append(Body(body.name, -1 if fixed else body.joint + shift, pose, body.solid))
                arm_of.append(side)
        of = np.array(arm_of, dtype=int)  # an arm may have no bodies
        a, b = np.meshgrid(np.flatnonzero(of == 0), np.flatnonzero(of == 1), indexing="ij")
        still = np.array([body.joint < 0 for body in bodies], dtype=bool)
        pairs = np.column_stack([a.ravel(), b.ravel()])
        pairs = pairs[~(still[pairs[:, 0]] & still[pairs[:, 1]])]
        self.bodies = Bodies(Kinematics(links), bodies, pairs)
        self.own_numbers = [k for k, body in enumerate(one.bodies.all) if k < one.links or body.joint >= 0]
        self.of_second = _without_scene(two)
        count = arm_of.count(0)
        asked = np.full((count, len(bodies) - count), max(one.asked, two.asked))
        self.clearance = asked if clearance is None else clearance
        self._sides = tuple(np.sort(self.bodies.pairs, axis=1).T - [[0], [count]])  # the first arm's bodies come first

    @property
    def wanted(self) -> np.ndarray:
        """The clearance (P,) [m] of each pair."""
        return np.asarray(self.clearance[self._sides])

    def at_rest_in(self, poses: np.ndarray) -> TwoArms:
        """These arms for poses (N, n) of both in which they may rest at the same time.

        A pair of bodies that is nearer than its clearance in some of them keeps half of its least distance there.
        Poses in which the arms touch are ignored: they cannot occur at the same time.
        """
        wanted = self.wanted
        distance = np.full((len(poses), len(wanted)), np.inf)
        for k, p, *_, near in Scenery(self.bodies, poses).hulls(wanted):
            distance[k, p] = near
        possible = distance[distance.min(axis=1) > TOUCHING]
        out = copy(self)
        out.clearance = self.clearance.copy()
        least = possible.min(axis=0, initial=np.inf)
        out.clearance[self._sides] = np.where(least < wanted, least / 2, wanted)
        return out

    def names(self, pair: int) -> tuple[str, str]:
        """The names of a pair's bodies, the first robot's first."""
        a, b = sorted(self.bodies.pairs[pair].tolist())  # the first robot's bodies come first
        return self.bodies.all[a].name, self.bodies.all[b].name


def _without_scene(cell: Cell) -> list[Body]:
    """The bodies of the arm and its payload, without the scene."""
    return [body for k, body in enumerate(cell.bodies.all) if k < cell.links or body.joint >= 0]


def placed_links(cell: Cell, shift: int) -> list[Link]:
    """The links of an arm fixed at its base's pose, numbered from `shift` on."""
    out = []
    for link in cell.robot.body.tree():
        follows = None if link.follows is None else replace(link.follows, leader=link.follows.leader + shift)
        if link.parent < 0:
            link = replace(link, placement=cell.request.base_pose @ link.placement)
        else:
            link = replace(link, parent=link.parent + shift)
        out.append(replace(link, follows=follows))
    return out


class _LateCurve(MotionCurve):
    """A curve in which the joints from `count` on may be early or late by `slack` [s]."""

    def loosened(self, count: int, slack: float) -> _LateCurve:
        """This curve with a slack."""
        self._count, self._slack = count, slack
        speed = 5 * np.abs(np.diff(self.bernstein, axis=0)).max(axis=0) / np.diff(self.time)[:, None]
        self._speed = speed[:, count:]
        return self

    def middles(self, spans: Spans) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As of any curve; how far each point moves grows by the time that an arm may be early or late."""
        time, q, far = super().middles(spans)
        if self._slack > 0:
            h = self.time[spans.first + 1] - self.time[spans.first]
            one = spans.last - spans.first <= 1
            begin = np.where(one, self.time[spans.first] + spans.low * h, self.time[spans.first]) - self._slack
            end = np.where(one, self.time[spans.first] + spans.high * h, self.time[spans.last]) + self._slack
            low = np.clip(np.searchsorted(self.time, begin, side="right") - 1, 0, self.samples - 2)
            high = np.clip(np.searchsorted(self.time, end, side="left"), 1, self.samples - 1)
            for k, (a, b) in enumerate(zip(low.tolist(), np.maximum(high, low + 1).tolist(), strict=True)):
                far[k, self._count :] += self._slack * self._speed[a:b].max(axis=0)
        return time, q, far


def prove_apart(
    arms: TwoArms, robots: tuple[int, int], one: PeriodicMotion, two: PeriodicMotion, jitter: float
) -> Between:
    """Prove that two robots keep apart over their whole cycle, each up to `jitter` [s] early or late.

    Args:
        arms: the bodies of both. robots: their indices in the cell, which the result states.
        one, two: their motions, of the same cycle time.
    """
    count, wanted = len(arms.bodies.pairs), arms.wanted
    least: Between | None = None
    bound = nearest = np.inf
    # first without slack, in the middle and at both ends: this finds collisions quickly; then all leads together
    open_ = [(late, 0.0) for late in dict.fromkeys((2 * jitter, -2 * jitter, 0.0))]
    open_ = [*([(0.0, 2 * jitter)] if jitter > 0 else []), *open_]
    while open_:
        late, slack = open_.pop()
        proof = prove(arms.bodies, side_by_side(arms, one, two, late, slack), wanted)
        worst = proof.touches[0] if proof.touches else proof.least
        found = Between(robots, proof.verdict, count, late=late)
        if worst is not None:
            found = replace(
                found, pair=arms.names(worst.pair), min_distance=worst.distance, time=worst.time,
                wanted=float(wanted[worst.pair]),
            )  # fmt: skip
            if slack == 0 and worst.distance < nearest:
                least, nearest = found, worst.distance
        if proof.verdict == "proven":
            bound = min(bound, proof.lower_bound)
        elif slack < SHORTEST or worst is None or (proof.touches and worst.distance <= wanted[worst.pair]):
            return found
        else:
            open_ += [(late - slack / 2, slack / 2), (late + slack / 2, slack / 2)]
    if least is None:
        return Between(robots, "proven", count, lower_bound=float(wanted.min()) if not np.isfinite(bound) else bound)
    return replace(least, verdict="proven", lower_bound=bound)


def side_by_side(arms: TwoArms, one: PeriodicMotion, two: PeriodicMotion, late: float, slack: float) -> _LateCurve:
    """Both motions as one curve of all joints, those of `one` first, over slightly more than its cycle.

    Args:
        late: [s] by which the second is ahead: it is where it would be so much later.
        slack: [s] by which the second may be early or late in addition; bounds of its motion include this.
    """
    begin, end = one.begin - slack, one.begin + one.cycle + slack
    times = np.unique(
        np.concatenate([[begin, end], one.sample_times(begin, end), two.sample_times(begin + late, end + late) - late])
    )
    times = times[np.append(np.diff(times) > 1e-10, True)]
    pieces = np.concatenate([one.pieces(times), two.pieces(times + late)], axis=2)
    return _LateCurve.of_pieces(times, pieces).loosened(arms.count, slack)


SAMPLES = 40  # samples of each of the two motions
MARGIN = 0.01  # [m] nearer poses count as touching
STEP = 1 / (SAMPLES - 1)
Shares = tuple[float, float]


def conflicting_parts(arms: TwoArms, one: Part, two: Part) -> tuple[Shares | None, Shares | None]:
    """The parts of two steps that may not happen at the same time, as shares of the steps' durations.

    None represents a whole step: for a wait, or if samples find nothing near.

    Args:
        arms: the bodies of both. one, two: the steps' motions.
    """
    waits = [np.ptp(part.trajectory.position, axis=0).max() == 0 for part in (one, two)]
    shares = [np.array([0.5]) if wait else np.linspace(0, 1, SAMPLES) for wait in waits]
    poses = [
        part.trajectory(part.trajectory.time[0] + share * part.trajectory.duration)
        for part, share in zip((one, two), shares, strict=True)
    ]
    k, m = (x.ravel() for x in np.meshgrid(*(np.arange(len(x)) for x in shares), indexing="ij"))
    near = np.zeros(len(k), dtype=bool)
    near[[at for at, *_ in Scenery(arms.bodies, np.hstack([poses[0][k], poses[1][m]])).hulls(MARGIN)]] = True
    if not near.any():
        return None, None
    out = [
        None if wait else (max(0.0, share[i[near]].min() - STEP), min(1.0, share[i[near]].max() + STEP))
        for wait, share, i in zip(waits, shares, (k, m), strict=True)
    ]
    return out[0], out[1]
