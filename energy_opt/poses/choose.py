"""The cheapest of many goals: all branches are estimated, the most promising are solved, freedom is used.

reach       every joint goal that the poses and goals allow
estimate    the energy of the straight move to each goal; goals in contact, or too near a body, are left out
improve     the most promising are moved along their freedom to where the estimate is least
screen      goals and their turns are ranked by estimates, then by outlines; the best are sketched
settle      of each sketch, curve and goal are optimized together, within what the pose leaves free
solve       the best in full, settled once more; and the goal nearest to the start at that duration: that is the saving
            (settled too where it costs less than the best)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.errors import BadInput, Infeasible
from energy_opt.motion import Move, Result, Trajectory
from energy_opt.motion.judge.energy import Scorer
from energy_opt.poses.chosen import Candidate, Chosen, Settle, Settling, Sketched, cost_of
from energy_opt.poses.distance import is_free, kept_by
from energy_opt.poses.estimate import fastest, fastest_straight
from energy_opt.poses.freedom import has_freedom, improved
from energy_opt.poses.inverse import ToolKinematics
from energy_opt.poses.pose import Pose
from energy_opt.poses.screen import Screen, Sketch, last_leg
from energy_opt.poses.sets import Target, positions_of, touching_error

IMPROVED = 5  # goals that the estimate moves along their freedom, each to another place
TRIED = 7  # most goals that it moves, those that end at the place of another one included
TURNED = 3  # most turns of goals that are solved if no goal is
NEAREST = 3  # most of the nearest goals that are solved after these
ROOM = 1.001  # a retimed goal moves along its freedom to where its path takes this much less than the time there is
WORTH = 1e-3  # share of the loss that another goal must promise to save, to be solved in full
# share of the loss by which the errors of sketches differ, nine times in ten; and how many goals whose sketches differ
# by less are solved in full, as it may be any of them that is the best
NEAR, TIED = 0.05, 2
LISTED, FREE = 40, 60  # most goals that an answer lists, and most without contact among which to choose


class Solve(Protocol):
    """Solver of a move in full, see `Planner.solve`; without `confirm`, errors are raised sooner."""

    def __call__(self, move: Move, warm: Sequence[Trajectory] = (), *, confirm: bool = True) -> Result:
        """The answer."""


Solved = tuple[Candidate, Result]


class Chooser:
    """Chooses among goals for one robot.

    Args:
        scorers: of the models of the plan; `worst`: goals are compared by the worst of them, else the mean.
        cell: bodies that goals must keep clear of; None for none.
        solver: solves a move, given motions to start from; sketch: estimates the answer without bodies: a goal
            whose sketch takes more than the best answer is not solved in full.
        settle: moves a motion to the nearest optimum of curve and open coordinates, clear of bodies if asked; it also
            gives the positions at via points.
        start, via: poses that the move begins at and passes, whose freedom is used too.
    """

    def __init__(
        self,
        tool: ToolKinematics,
        scorers: Sequence[Scorer],
        cell: Cell | None,
        solver: Solve,
        sketch: Sketch,
        settle: Settle,
        seed: int = 0,
        worst: bool = False,
        start: Pose | None = None,
        via: Sequence[Pose] = (),
    ) -> None:
        self.cell = cell if cell is not None and cell.checks else None
        self.tool, self.seed, self._screen = tool, seed, Screen(tool, list(scorers), sketch, worst, self.cell)
        self._solver = solver
        self._settle = Settling(tool, scorers, self.cell, settle, start, via)
        self.solves = self.settled = 0

    def in_order(self, moves: Sequence[Move]) -> list[Move]:
        """Moves with different ends and via points, those with the cheapest sketches first."""
        if len(moves) == 1:
            return list(moves)
        found = [self._screen.sketched(move, Candidate(move.goal, np.nan)) for move in moves]
        return [moves[k] for k in np.argsort([cost_of(each[0]) if each else np.inf for each in found], kind="stable")]

    def choose(self, move: Move, goals: Sequence[Target]) -> Chosen:
        """The cheapest motion from the move's start to any of the goals.

        Args:
            move: its goal is ignored.
            goals: poses of the tool, or joint positions (n,).

        Raises:
            Infeasible: no goal can be reached, or none without contact, or none in the given time.
        """
        if not goals:
            raise BadInput("--goal is missing; give --goal or --goal-pose")
        found = self._candidates(move, goals)
        open_ = sorted((c for c in found if c.status == "looked_at"), key=lambda c: c.estimate)
        if not open_:
            raise self._no_goal_error(move, goals, found)
        promising = self._improved(move, open_)
        tried = self._screen(move, promising)
        # within limits, which a sketch need not be: each replaces its sketch
        settled = [self._settling(move, *item, False) for item in tried]
        tried = [found for item, near in zip(tried, settled, strict=True) for found in near or [item]]
        answer, solved = self._solved_in_full(move, promising, tried, open_)
        known = next((near[0] for near in settled if near and near[0][0].goal is answer[0].goal), None)
        if known is None or abs(cost_of(known) - cost_of(answer)) >= self._least_saving(answer):
            answer = self._refined(move, answer, solved)
        nearest = min(open_, key=lambda c: self._distance(move, c.goal))
        near = self._compared(move, nearest, answer, solved)
        if near is not None and _rank(near) < _rank(answer):  # the search found a worse answer
            solved.append(near)
            answer = self._refined(move, near, solved)
        listed = [answer[0], *(c for c, _ in sorted(solved, key=_rank) if c is not answer[0])]
        others = {c.goal.tobytes(): c for c in (*found, *(c for c, _ in tried))}  # each with its latest result
        rest = [c for goal, c in others.items() if all(goal != x.goal.tobytes() for x in listed)]
        rest.sort(key=lambda c: (c.energy is None, c.status != "looked_at", c.estimate))
        return Chosen(
            answer[0].moved(move), answer[1], tuple([*listed, *rest][:LISTED]),
            nearest if near is None else near[0], None if near is None else near[1],
            self.solves, self._screen.count + self.settled,
        )  # fmt: skip

    def _candidates(self, move: Move, goals: Sequence[Target]) -> list[Candidate]:
        """All positions that reach the goals, with estimates of their energies; those in contact or near are marked."""
        out: list[Candidate] = []
        for goal in goals:
            pose = goal if isinstance(goal, Pose) else None
            found = positions_of(self.tool, goal, None, near=last_leg(move), seed=self.seed)
            possible, energy = self._screen.estimates(move, found)
            out += [
                Candidate(q, float(e), status="looked_at" if can else "too_fast", pose=pose)
                for q, e, can in zip(found, energy, possible, strict=True)
            ]
        if self.cell is None:
            return out
        kept, near = 0, list[int]()
        for k in np.argsort([c.estimate for c in out]).tolist():
            if out[k].status != "looked_at":
                continue
            if kept >= FREE:
                out[k] = replace(out[k], status="not_looked_at")
                continue
            short = self.cell.short(out[k].goal)
            if not short.any():
                kept += 1
            elif np.isfinite(short).all():
                near.append(k)
                out[k] = replace(out[k], status="near")
            else:
                out[k] = replace(out[k], status="colliding")
        if not kept:
            for k in np.array(near, dtype=int)[kept_by(np.array([out[k].goal for k in near]), self.cell)].tolist():
                out[k] = replace(out[k], status="looked_at")
        return out

    def _improved(self, move: Move, goals: Sequence[Candidate]) -> list[Candidate]:
        """The goals in order of their estimates, the first of them moved along their freedom."""

        retime, longest = move.mode == "retime", move.duration or move.max_duration or np.inf

        def seconds(q: np.ndarray) -> np.ndarray:
            return fastest_straight(self.tool.robot, np.broadcast_to(last_leg(move), q.shape), q)

        def cost(q: np.ndarray) -> np.ndarray:
            possible, energy = self._screen.estimates(move, q)
            if retime:
                possible = possible & (ROOM * seconds(q) <= longest)
            return np.where(possible, energy, np.inf)

        out: list[Candidate] = []
        tried = moved = 0
        for goal in goals:
            free = goal.pose is not None and has_freedom(self.tool, goal.pose)
            if free and (moved == IMPROVED or tried == TRIED):
                continue
            if any(self._screen.is_equivalent(goal, other) for other in out):
                continue
            if goal.pose is not None and free:
                tried += 1
                q = goal.goal
                if retime and not np.isfinite(cost(q[None])[0]):
                    q = improved(self.tool, goal.pose, q, seconds, self.cell)
                q = improved(self.tool, goal.pose, q, cost, self.cell)
                goal = replace(goal, goal=q, estimate=float(cost(q[None])[0]))
                same = [k for k, other in enumerate(out) if self._screen.is_equivalent(goal, other)]
                if same:  # it found the optimum of another one: keep the cheaper
                    out[same[0]] = min(goal, out[same[0]], key=lambda c: c.estimate)
                    continue
                moved += 1
            out.append(goal)
        return sorted(out, key=lambda c: c.estimate)

    def _solved_or_reason(self, move: Move, goal: Candidate, warm: Sequence[Trajectory] = ()) -> Solved | Infeasible:
        """A goal solved in full, or why it cannot be."""
        self.solves += 1
        try:
            result = self._solver(goal.moved(move), warm, confirm=False)
        except Infeasible as error:
            return error
        return self._rated(goal, result)

    def _rated(self, goal: Candidate, result: Result) -> Solved:
        return replace(goal, energy=self._screen.energy(result.trajectory), status=result.status, detour=0.0), result

    def _settling(self, move: Move, goal: Candidate, motion: Trajectory, clear: bool) -> list[Sketched]:
        """The optimum near a motion within its goal's freedom, see `Settling`; none if there is none."""
        found = self._settle(move, goal, motion, clear)
        self.settled += found is not None
        return sorted((self._screen.rated(*each) for each in found or ()), key=cost_of)[:1]

    def _least_saving(self, item: Solved) -> float:
        """The least energy [J] that another goal must promise to save, to be solved in full."""
        return WORTH * self._screen.loss(item[1].trajectory)

    def _refined(self, move: Move, answer: Solved, solved: list[Solved]) -> Solved:
        """The answer; if its freedom promises less energy, it is solved once more, which is added to `solved`."""
        better = self._settling(move, answer[0], answer[1].trajectory, True)
        if not better or cost_of(better[0]) >= cost_of(answer) - self._least_saving(answer):
            return answer
        again = self._solved_or_reason(move, better[0][0], [better[0][1]])
        if isinstance(again, Infeasible):
            return answer
        solved.append(again)
        return min(answer, again, key=_rank)

    def _solved_in_full(
        self, move: Move, goals: Sequence[Candidate], tried: Sequence[Sketched], open_: Sequence[Candidate]
    ) -> tuple[Solved, list[Solved]]:
        """The best of the sketched goals solved in full, and all solved ones.

        Other goals, those with joints turned, and last the nearest of all `open_` ones, only if none of these works.
        """
        sketched = sorted(tried, key=cost_of)
        tied = cost_of(sketched[0]) + NEAR * self._screen.loss(sketched[0][1]) if sketched else -np.inf
        known = {c.goal.tobytes() for c in (*goals, *(c for c, _ in tried))}
        rest = [goal for goal in goals if not any(np.array_equal(goal.goal, c.goal) for c, _ in tried)]
        rest += [goal for goal in self._screen.with_turns(move, goals) if goal.goal.tobytes() not in known][:TURNED]
        others = (goal for goal in open_ if goal.goal.tobytes() not in known)
        rest += sorted(others, key=lambda goal: self._distance(move, goal.goal))[:NEAREST]
        failed: list[Candidate] = []
        out: list[Solved] = []
        for goal, warm in [*((c, [motion]) for c, motion in sketched), *((c, []) for c in rest)]:
            least = min((c.energy or np.inf for c, _ in out if c.status == "solved"), default=None)
            energy = cost_of((goal,))
            if least is not None and energy >= least and (energy > tied or len(out) >= TIED):
                break
            found = self._solved_or_reason(move, goal, warm)
            if isinstance(found, Infeasible):
                failed.append(goal)
            else:
                out.append(found)
        if not out:  # solve again for the shortest duration that is tried
            nearest = min(failed, key=lambda goal: self._distance(move, goal.goal))
            out.append(self._rated(nearest, self._solver(nearest.moved(move), confirm=True)))
        out.sort(key=_rank)
        return out[0], out

    def _compared(self, move: Move, nearest: Candidate, answer: Solved, solved: Sequence[Solved]) -> Solved | None:
        """The nearest goal and its motion, at the duration of the answer; one that is `solved` is not solved again."""
        for item in (answer, *(solved if move.duration is not None else ())):
            if np.array_equal(nearest.goal, item[0].goal):
                return item
        at = replace(move, duration=answer[1].trajectory.duration, max_duration=None)
        found = self._solved_or_reason(at, nearest)
        if isinstance(found, Infeasible) and move.duration is None:  # it takes longer than the answer
            found = self._solved_or_reason(move, nearest)
        return None if isinstance(found, Infeasible) else found

    def _distance(self, move: Move, goal: np.ndarray) -> float:
        """Seconds to a goal; among equally quick goals, one with shorter travel of other joints counts as nearer."""
        start, robot = last_leg(move), self.tool.robot
        retime = move.mode == "retime"
        seconds = fastest_straight(robot, start[None], goal[None])[0] if retime else fastest(robot, start, goal)
        return float(seconds) + 1e-3 * float(np.abs(goal - start).sum())

    def _no_goal_error(self, move: Move, goals: Sequence[Target], found: Sequence[Candidate]) -> Infeasible:
        """The error if no goal remains: all are in contact, or those that are not take too long."""
        name = next((goal.name for goal in goals if isinstance(goal, Pose)), "--goal")
        free = [c for c in found if c.status != "colliding" and is_free(self.cell, c.goal)]
        if not free and self.cell is not None:
            return touching_error(name, np.array([c.goal for c in found]), self.cell)
        nearest = min(free, key=lambda c: self._distance(move, c.goal))
        longest = move.duration or move.max_duration
        text = f"{name}: no goal is reached" + (f" in {longest:.6g} s" if longest else "")
        try:  # also limits that the least time of a straight move leaves out
            self._solver(nearest.moved(move), confirm=True)
        except Infeasible as error:
            error.args = (f"{text}; the nearest one: {error.args[0]}",)
            return error
        return Infeasible(text, limit="duration")


def _rank(item: Solved) -> tuple[bool, float]:
    """Solved goals first, then by energy."""
    goal, result = item
    return result.status != "solved", np.inf if goal.energy is None else goal.energy
