"""The cheapest move whose start, goal or via points are sets of positions.

A pose is reached by several branches of joint positions. The chain of branches from start to goal that is likely to be
cheapest is found by estimates; then the goals are compared by solved motions (`choose`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.motion import Move, Planner, Settings
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.plan.robust import RobustPlanner
from energy_opt.poses.choose import APART, Chooser
from energy_opt.poses.chosen import Chosen
from energy_opt.poses.estimate import holding, quickest
from energy_opt.poses.given import Ends
from energy_opt.poses.inverse import ToolKinematics
from energy_opt.poses.sets import Layer, Ring, Target, as_reached, layer, positions_of, thinned
from energy_opt.power import PowerModel
from energy_opt.robot import Robot


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
    scorers = [Scorer(robot, model) for model in models]
    chooser = Chooser(
        tool, scorers, cell, planner.solve, planner.sketch, planner.settle, settings.seed, worst, ends.start, ends.via
    )
    if ends.start is not None or ends.via:
        move = chooser.cheapest(_moves_between_branches(ends, move, tool, scorers, cell, settings))
    return chooser.choose(move, ends.goals)


def _moves_between_branches(
    ends: Ends, move: Move, tool: ToolKinematics, scorers: Sequence[Scorer], cell: Cell | None, settings: Settings
) -> list[Move]:
    """Moves with positions of the start pose and of the poses on the way.

    First those that are likely to be cheapest; then, for each of these poses, the likely cheapest with another branch
    of it.

    Raises:
        Infeasible: no positions reach one of them, or all touch something.
    """
    start: Target = move.start if ends.start is None else ends.start
    near = tool.robot.limits.near_zero if ends.start is not None else move.start
    sets = [positions_of(tool, each, cell, near=near, seed=settings.seed) for each in (start, *ends.via)]
    goals = [positions_of(tool, each, cell, near=near, seed=settings.seed) for each in ends.goals]
    sets.append(np.vstack(goals))
    layers = [layer(scorers, thinned(q, holding(scorers, q))) for q in sets]

    def cheapest(layers: Sequence[Layer]) -> list[np.ndarray]:
        chain = Ring(layers, [scorers] * (len(layers) - 1), [(0.0, np.inf)] * len(layers))
        chosen, _ = chain.cheapest(move.duration or move.max_duration or np.inf, 0.0)
        return [each.positions[k] for each, k in zip(layers, chosen, strict=True)]

    found = [cheapest(layers)]
    for k, each in enumerate(layers[:-1]):
        others = each.positions[np.abs(each.positions - found[0][k]).max(axis=1) >= APART]
        if len(others):
            found.append(cheapest([*layers[:k], layer(scorers, others), *layers[k + 1 :]]))
    return [replace(move, start=q[0], via=tuple(q[1:-1]), goal=q[-1]) for q in found]


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
    q = move.start
    if ends.start is not None:
        near = robot.limits.near_zero
        found = positions_of(tool, ends.start, cell, near=near, seed=settings.seed)
        q = found[np.argmin(np.abs(found - near).sum(axis=1))]
    at = [q]
    for stop in ends.via:
        at.append(quickest(robot, at[-1], positions_of(tool, stop, cell, near=at[-1], seed=settings.seed)))
    goals = [positions_of(tool, goal, cell, near=at[-1], seed=settings.seed) for goal in ends.goals]
    return replace(move, start=at[0], via=tuple(at[1:]), goal=quickest(robot, at[-1], np.vstack(goals)))
