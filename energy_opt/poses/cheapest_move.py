"""The cheapest move whose start, goal or via points are sets of positions.

A pose is reached by several branches of joint positions. The chain of branches from start to goal that is likely to be
cheapest is found by estimates; then the goals are compared by solved motions (`choose`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.errors import Infeasible
from energy_opt.motion import Move, Planner, Result, Settings, Trajectory
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.plan.anytime import Progress
from energy_opt.motion.plan.robust import RobustPlanner
from energy_opt.motion.plan.sketch import Settled
from energy_opt.motion.reshape.open import FIXED, Open
from energy_opt.poses.choose import Chooser
from energy_opt.poses.chosen import Chosen
from energy_opt.poses.distance import nearer_words
from energy_opt.poses.estimate import holding, quickest
from energy_opt.poses.given import Ends
from energy_opt.poses.inverse import ToolKinematics
from energy_opt.poses.pose import Pose
from energy_opt.poses.screen import APART
from energy_opt.poses.sets import Ring, Target, as_reached, layer, left_out, positions_of, thinned
from energy_opt.poses.turns import turned, unwound
from energy_opt.power import PowerModel
from energy_opt.robot import Robot

OTHERS = 3  # most other branches of a start pose or via pose, to compare by sketches
SKETCHED = 0.4  # share of a deadline in which goals are compared by sketches
PASSED = "the deadline has passed"
TRIED = 3  # most choices of start and via points to solve in full until one is solved


class _Search:
    """The solvers of a planner with one `deadline` [s] for all that they do.

    After it, the first solve gives its first proven answer. Further ones are refused, also those that it ends: they
    cannot be compared. Sketches end earlier, so that time is left for a solve.
    """

    def __init__(self, planner: Planner | RobustPlanner, deadline: float | None) -> None:
        self._planner, self._progress, self._answered = planner, Progress(deadline), False
        self._sketching = Progress(None if deadline is None else SKETCHED * deadline)

    @property
    def late(self) -> bool:
        """Has the deadline passed?"""
        return self._progress.late()

    def solve(self, move: Move, warm: Sequence[Trajectory] = (), *, confirm: bool = True) -> Result:
        """As `Planner.solve`, in the time that is left."""
        found = None if self._answered and self.late else self._planner.solve(move, warm, self._progress.left, confirm)
        if found is None or (self._answered and self.late):
            raise Infeasible(PASSED, limit="duration")
        self._answered = True
        return found

    def sketch(self, move: Move, *, rough: bool = False) -> Trajectory:
        """As `Planner.sketch`."""
        if self._sketching.late():
            raise Infeasible(PASSED, limit="duration")
        return self._planner.sketch(move, rough=rough)

    def settle(self, move: Move, motion: Trajectory, open_: Open = FIXED, clear: bool = True) -> Settled:
        """As `Planner.settle`; when it is late, the motion stays as it is."""
        late = self.late if clear else self._sketching.late()
        return (motion, move.via) if late else self._planner.settle(move, motion, open_, clear)


def solve_to(
    ends: Ends,
    move: Move,
    robot: Robot,
    models: Sequence[PowerModel],
    cell: Cell | None,
    settings: Settings,
    planner: Planner | RobustPlanner,
    worst: bool = False,
) -> Chosen:
    """The cheapest motion to any of the goals; see `Chooser.choose`.

    Args:
        ends: start pose, poses on the way and goals; the move's own goal is ignored, and its start if there is a
            start pose.
        models: the models of the plan; goals are compared by their mean, or by the `worst` of them.
        planner: of these models, which gives the answer.
    """
    tool = ToolKinematics(robot, settings.tool)
    ends = ends.changed(lambda pose: as_reached(tool, pose))
    said: tuple[str, ...] = ()
    if len(ends.goals) > 1:
        around = cell if ends.start is not None or ends.via else None
        goals, said = left_out(tool, ends.goals, around, _near(ends, move, robot), settings.seed)
        ends = replace(ends, goals=goals)
    scorers = [Scorer(robot, model) for model in models]
    search = _Search(planner, settings.deadline)
    chooser = Chooser(
        tool, scorers, cell, search.solve, search.sketch, search.settle, settings.seed, worst, ends.start, ends.via
    )
    moves = [move]
    if ends.start is not None or ends.via:
        moves = chooser.in_order(_moves_between_branches(ends, move, tool, scorers, cell, settings))[:TRIED]
    answers: list[Chosen] = []
    errors: list[Infeasible] = []
    for each in moves:  # a sketch ignores bodies: the next one where there is no answer
        try:
            answers.append(replace(chooser.choose(each, ends.goals), warnings=said))
        except Infeasible as error:
            errors.append(error)
        if planner.stopped() or (answers and (search.late or answers[-1].result.status == "solved")):
            break
    if not answers:
        raise errors[0]
    best = min(answers, key=lambda answer: answer.result.status != "solved")
    if best.nearest_result is None:
        status = "not_looked_at" if search.late or planner.stopped() else "infeasible"
        best = replace(best, nearest=replace(best.nearest, status=status))
    at, goal = best.move, best.candidates[0].pose
    earlier = zip((ends.start, *ends.via), (at.start, *at.via), strict=False)
    reached = [(pose.name, q, cell) for pose, q in earlier if pose is not None]
    if goal is not None or len(ends.goals) > 1:
        reached.append(("--goal" if goal is None else goal.name, at.goal, cell))
    return replace(best, warnings=(*best.warnings, *nearer_words(reached)))


def _moves_between_branches(
    ends: Ends, move: Move, tool: ToolKinematics, scorers: Sequence[Scorer], cell: Cell | None, settings: Settings
) -> list[Move]:
    """Moves with positions of the start pose and of the poses on the way.

    First those that are likely to be cheapest; then, for each of these poses, the likely cheapest with another branch
    of it; of each also those with joints turned to where it is likely to be cheaper.

    Raises:
        Infeasible: no positions reach one of them, or all touch something.
    """
    start: Target = move.start if ends.start is None else ends.start
    near = _near(ends, move, tool.robot)
    sets = [positions_of(tool, each, cell, near=near, seed=settings.seed) for each in (start, *ends.via)]
    goals = [positions_of(tool, each, cell, near=near, seed=settings.seed) for each in ends.goals]
    sets.append(np.vstack(goals))
    sets = [thinned(q, holding(scorers, q)) for q in sets]
    given = np.array([each for each in (start, *ends.goals) if not isinstance(each, Pose)]).reshape(-1, tool.robot.n)

    def turning(q: np.ndarray) -> np.ndarray:
        """Which positions (K, n) are not given as such."""
        return ~(q[:, None] == given).all(axis=2).any(axis=1)

    def cheapest(sets: Sequence[np.ndarray], exact: bool = False) -> list[int]:
        layers = [layer(scorers, q, False if exact else turning(q)) for q in sets]
        alone = move.duration if len(layers) == 2 else None  # a single part lasts as long as the move
        chain = Ring(tool, layers, [scorers] * (len(layers) - 1), [(alone or 0.0, alone or np.inf)] * len(layers))
        waiting = 0.0 if move.duration is None else min(float(each.standing.min()) for each in layers)
        return chain.cheapest(move.duration or move.max_duration or np.inf, waiting)[0]

    found: list[tuple[list[np.ndarray], list[np.ndarray]]] = []  # chains of branches, and their turns

    def add(sets: Sequence[np.ndarray]) -> None:
        chain = [q[k] for q, k in zip(sets, cheapest(sets), strict=True)]
        may = turning(np.array(chain)).tolist()
        short = unwound(tool, chain, may, False)
        further = turned(tool, short, may, partial(cheapest, exact=True))
        found.append((chain, short))
        if not all(map(np.array_equal, further, short)):
            found.append((chain, further))

    add(sets)
    for k, each in enumerate(sets[:-1]):
        for _ in range(OTHERS):
            known = np.array([chain[k] for chain, _ in found])
            each = each[np.abs(each[:, None] - known).max(axis=2).min(axis=1) >= APART]
            if len(each):
                add([*sets[:k], each, *sets[k + 1 :]])
    return [replace(move, start=q[0], via=tuple(q[1:-1]), goal=q[-1]) for _, q in found]


def _near(ends: Ends, move: Move, robot: Robot) -> np.ndarray:
    """Positions (n,) near which those of poses are searched: the start, a goal given by joints, or near zero."""
    if ends.start is None:
        return move.start
    return next((goal for goal in ends.goals if not isinstance(goal, Pose)), robot.limits.near_zero)


def nearest_move(ends: Ends, move: Move, robot: Robot, cell: Cell | None, settings: Settings) -> Move:
    """The move to the positions that are quickest to reach, each from the one before.

    Args:
        ends: poses and positions. move: for its start, if that is no pose. robot: the arm.
        cell: bodies to keep clear of. settings: with tool and seed.

    Raises:
        Infeasible: a pose is out of reach, or every position that reaches it touches something.
    """
    tool = ToolKinematics(robot, settings.tool)
    ends = ends.changed(lambda pose: as_reached(tool, pose))
    q = near = _near(ends, move, robot)
    ends = replace(ends, goals=left_out(tool, ends.goals, cell, near, settings.seed)[0])
    if ends.start is not None:
        found = positions_of(tool, ends.start, cell, near=near, seed=settings.seed)
        q = found[np.argmin(np.abs(found - near).sum(axis=1))]
    at = [q]
    for stop in ends.via:
        at.append(quickest(robot, at[-1], positions_of(tool, stop, cell, near=at[-1], seed=settings.seed)))
    goals = [positions_of(tool, goal, cell, near=at[-1], seed=settings.seed) for goal in ends.goals]
    return replace(move, start=at[0], via=tuple(at[1:]), goal=quickest(robot, at[-1], np.vstack(goals)))
