"""The few most promising of many goals: of each, its whole turns count as goals of their own.

rank        all goals and turns, by the energy of the straight move
outline     the first of them, by a coarse optimum each, while the next may be better than the best
sketch      the best outlines, by quick solves; turns of joints that cost almost nothing are sketched once
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.errors import Infeasible
from energy_opt.motion import Move, Trajectory
from energy_opt.motion.judge.energy import Scorer
from energy_opt.poses.chosen import Candidate, Sketched, cost_of
from energy_opt.poses.distance import is_free
from energy_opt.poses.estimate import curves
from energy_opt.poses.freedom import directions, has_freedom
from energy_opt.poses.inverse import SAME, TURN, ToolKinematics
from energy_opt.poses.sets import DETOUR
from energy_opt.poses.turns import with_turns

# Most goals that are outlined, and most that are sketched: on 29 moves of a ur5e, more save less than they take.
# MOST: most that are outlined if each outline touches something; a clear one saves solves around bodies.
SCREENED, MOST, SKETCHED = 12, 24, 3
HOPE = 3.0  # a goal is outlined if its estimate, less so many times the largest gain so far, is below the best energy
EQUAL = 1e-5  # relative: goals whose estimates differ by less differ only in joints that cost nothing
ALIKE = 0.03  # share of the loss: of the turns of a goal whose energies differ by less, one is outlined and sketched
APART = 0.35  # [rad, m] least distance of goals that are both outlined
LOOKS = 24  # places of a sketch to check


class Sketch(Protocol):
    """A quick answer to a move, without bodies, see `Planner.sketch`."""

    def __call__(self, move: Move, *, rough: bool = False) -> Trajectory:
        """The motion."""


@dataclass(eq=False)
class Screen:
    """Compares goals for one robot, without bodies.

    Attributes:
        scorers: of the models of the plan; worst: goals are compared by the worst of them, else the mean.
        cell: bodies that motions must keep clear of; None for none.
        count: number of sketches and outlines so far.
    """

    tool: ToolKinematics
    scorers: Sequence[Scorer]
    sketch: Sketch
    worst: bool
    cell: Cell | None = None
    count: int = 0

    def __call__(self, move: Move, goals: Sequence[Candidate]) -> list[Sketched]:
        """Sketches of the most promising goals and their turns; none if there is only one goal and nothing to choose.

        Args:
            goals: the turns of their joints are those nearest to the start of the move's last part.
        """
        ranked = self.with_turns(move, goals)
        free = any(goal.pose is not None and has_freedom(self.tool, goal.pose) for goal in goals)
        if len(ranked) == 1 and not free:
            return []
        seen: list[Candidate] = []
        outlined: list[Sketched] = []
        least = 0.0  # [J] difference of energy that counts
        for goal in ranked:
            most = SCREENED if any(not c.detour for c, _ in outlined) else MOST
            if len(seen) >= most or not self._may_be_better(goal, outlined):
                break
            # another turn of a goal whose outline touches something may be clear
            if any(
                self._is_alike(goal, other, goal.estimate - other.estimate, 0.0 if other.detour else least)
                for other in seen
            ):
                continue
            found = self.sketched(move, goal, rough=True)
            seen += [found[0][0] if found else goal]
            outlined += found
            for _, motion in found:
                loss = ALIKE * self.loss(motion)
                least = min(least or loss, loss)
        if move.mode == "retime" or (len(outlined) == 1 and not free):  # solved already, or nothing to compare
            return outlined
        chosen: list[Candidate] = []
        for item in sorted(outlined, key=cost_of):
            if not any(self._is_alike(item[0], other, cost_of(item) - cost_of((other,)), least) for other in chosen):
                chosen.append(item[0])
        return [found for goal in chosen[:SKETCHED] for found in self.sketched(move, goal)]

    def estimates(self, move: Move, goals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Whether straight moves to goals (K, n) are possible (K,), and their energy (K,) [J]."""
        found = curves(self.scorers, np.broadcast_to(last_leg(move), goals.shape), goals)
        if move.duration is not None:
            return found.shortest <= move.duration, found.at(np.full((len(goals), 1), move.duration))[:, 0]
        longest = np.inf if move.max_duration is None else move.max_duration
        return found.shortest <= longest, found.cheapest(longest=longest)[0]

    def sketched(self, move: Move, goal: Candidate, rough: bool = False) -> list[Sketched]:
        """The sketch of a goal, or its outline if it is to be `rough`; empty if it is not possible."""
        self.count += 1
        try:
            found = self.sketch(replace(move, goal=goal.goal), rough=rough)
        except Infeasible:
            return []
        return [self.rated(goal, found)]

    def rated(self, goal: Candidate, motion: Trajectory) -> Sketched:
        """A goal with its sketch, whose energy and contacts are judged."""
        detour = 0.0
        places = np.linspace(motion.time[0], motion.time[-1], LOOKS + 2)[1:-1]
        if not all(is_free(self.cell, q) for q in motion.sample(places)[0]):
            detour = DETOUR * max(self.loss(motion), 0.0)
        return replace(goal, energy=self.energy(motion), status="screened", detour=detour), motion

    def energy(self, trajectory: Trajectory) -> float:
        """The energy [J] by which goals are compared: the mean or the worst of the models."""
        totals = [scorer.energy(trajectory).total for scorer in self.scorers]
        return float(max(totals) if self.worst else np.mean(totals))

    def loss(self, trajectory: Trajectory) -> float:
        """The loss [J], the mean of the models."""
        return float(np.mean([scorer.energy(trajectory).loss for scorer in self.scorers]))

    def is_equivalent(self, one: Candidate, two: Candidate) -> bool:
        """True if goals are near each other apart from a shift along their freedom, or cost the same."""
        if abs(one.estimate - two.estimate) < EQUAL * abs(two.estimate):
            return True
        apart = one.goal - two.goal
        if one.pose is not None and one.pose is two.pose and has_freedom(self.tool, one.pose):
            along = directions(self.tool, one.pose, two.goal)
            apart = apart - apart @ along.T @ along
        return bool(np.abs(apart).max() < APART)

    def with_turns(self, move: Move, goals: Sequence[Candidate]) -> list[Candidate]:
        """The goals, those of poses also with joints turned to the other side of the start, by their estimates."""
        out: list[Candidate] = list(goals)
        for goal in goals:
            if goal.pose is not None:
                q = with_turns(self.tool, goal.goal, last_leg(move))[1:]
                can, energy = self.estimates(move, q)
                out += [replace(goal, goal=q[k], estimate=float(energy[k])) for k in np.flatnonzero(can)]
        return sorted(out, key=lambda c: c.estimate)

    @staticmethod
    def _may_be_better(goal: Candidate, outlined: Sequence[Sketched]) -> bool:
        """True if the outline of a goal may take less energy than the best so far."""
        gain = max((c.estimate + c.detour - cost_of((c,)) for c, _ in outlined), default=np.inf)
        return goal.estimate - HOPE * max(gain, 0.0) <= min(map(cost_of, outlined), default=np.inf)

    def _is_alike(self, one: Candidate, two: Candidate, saved: float, least: float) -> bool:
        """True if goals are equivalent, or differ by whole turns that save less than `least` J."""
        turns = np.where(self.tool.robot.slides, 0.0, np.round((one.goal - two.goal) / TURN))
        turned = bool(np.abs(one.goal - two.goal - TURN * turns).max() < SAME)
        return (turned and abs(saved) < least) or self.is_equivalent(one, two)


def last_leg(move: Move) -> np.ndarray:
    """The start of the last part of a move."""
    return move.via[-1] if move.via else move.start
