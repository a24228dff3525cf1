"""Moves whose start or goal is a set: a pose of the tool, or any of several positions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.errors import Infeasible
from energy_opt.front.answer import Answer
from energy_opt.front.given import positions
from energy_opt.motion import Move, Result, Settings, Trajectory
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.plan.robust import Rival
from energy_opt.poses.choose import Chooser, Chosen
from energy_opt.poses.ends import Ends
from energy_opt.poses.estimate import estimate
from energy_opt.poses.inverse import ToolKinematics, reach
from energy_opt.poses.pose import AnyOf, Pose, missed
from energy_opt.robot import Robot
from energy_opt.robot.tool import tool_of

STARTS = 12  # positions of a start pose that are looked at
Goals = Sequence[Pose | np.ndarray]


def start_at(
    robot: Robot, rivals: Sequence[Rival], cell: Cell | None, pose: Pose, goals: Goals, settings: Settings
) -> np.ndarray:
    """Joint positions (n,) that reach a start pose, free, from which the goals are likely to cost least.

    Raises:
        Infeasible: none does.
    """
    tool = ToolKinematics(robot, settings.tool)
    found = reach(tool, pose, seed=settings.seed)
    if not len(found.positions):
        raise Infeasible(
            f"{pose.name}: no joint positions reach it; the nearest that can be reached is "
            f"{1e3 * found.distance:.3g} mm and {np.degrees(found.angle):.3g} deg away",
            joint=found.blocked or None,
            limit="pose",
        )
    scorers = [Scorer(robot, rival.model) for rival in rivals]
    ends = [goal for goal in goals if not isinstance(goal, Pose)]
    for goal in goals:
        if isinstance(goal, Pose):
            ends += list(reach(tool, goal, seed=settings.seed).positions[:STARTS])
    spread = found.positions[:: max(1, len(found.positions) // STARTS)]
    costs = [min((estimate(scorers, q, end, None, None).energy for end in ends), default=0.0) for q in spread]
    for k in np.argsort(costs):
        if cell is None or not cell.checks or cell.touching(spread[k]) is None:
            return np.asarray(spread[k])
    assert cell is not None
    raise Infeasible(
        f"{pose.name}: every joint position that reaches it touches something; {cell.touching(spread[0])}",
        limit="clearance",
    )


def solve_to(
    ends: Ends,
    move: Move,
    robot: Robot,
    rivals: Sequence[Rival],
    cell: Cell | None,
    settings: Settings,
    solve: Callable[[Move, Sequence[Trajectory]], Result],
) -> Chosen:
    """The cheapest motion to any of the goals; see `Chooser.choose`.

    Args:
        ends: start pose and goals; the move's own goal is ignored, and its start where there is a start pose.
    """
    if ends.start is not None:
        move = replace(move, start=start_at(robot, rivals, cell, ends.start, ends.goals, settings))
    scorers = [Scorer(robot, rival.model) for rival in rivals if not rival.name.startswith("draw ")]
    chooser = Chooser(ToolKinematics(robot, settings.tool), scorers, cell, solve, settings.seed)
    return chooser.choose(move, ends.goals)


def pose_document(robot: Robot, settings: Settings, poses: dict[str, Pose], trajectory: Trajectory) -> dict[str, Any]:
    """By what the ends of a trajectory miss their poses, recomputed with Pinocchio: distance [m] and angle [rad]."""
    tool = tool_of(robot.body, settings.tool)
    out: dict[str, Any] = {}
    for end, pose in poses.items():
        q = trajectory.position[:1] if end == "start" else trajectory.position[-1:]
        still = np.zeros_like(q)
        at, _, _ = robot.body.frame_motion(tool.joint, np.array(tool.pose), q, still, still)
        off = missed(pose, at[:, :3, :3], at[:, :3, 3])
        distance, angle = float(np.linalg.norm(off.shift)), float(np.linalg.norm(off.turn))
        inside = distance <= pose.tolerance[0] and angle <= pose.tolerance[1]
        out[end] = {"distance": distance, "angle": angle, "valid": inside}
    return out


def ends_from(robot: Robot, start: object, goal: object) -> tuple[object, object, Ends | None]:
    """Start and goal as `move_for` takes them, and the ends where one of them is a pose or several goals.

    Args:
        start: positions or a `Pose`; goal: positions, a `Pose`, or `AnyOf` these.
    """
    many = isinstance(goal, AnyOf)
    if not isinstance(start, Pose) and not isinstance(goal, Pose) and not many:
        return start, goal, None
    goals = tuple(
        each if isinstance(each, Pose) else positions(each, robot, "goal")  # type: ignore[arg-type]
        for each in (goal if isinstance(goal, AnyOf) else (goal,))
        if each is not None
    )
    begin = robot.limits.near_zero if isinstance(start, Pose) else start
    return begin, begin, Ends(start if isinstance(start, Pose) else None, goals)


def with_goals(result: Answer, chosen: Chosen, poses: dict[str, Pose], settings: Settings) -> Answer:
    """The answer with the goals that were looked at, and by what its ends miss their poses."""
    said = pose_document(result.arm, settings, poses, result.trajectory)
    status = result.status
    if not all(end["valid"] for end in said.values()):
        status = "not_converged"
    return replace(result, status=status, goals={**chosen.document(), "poses": said})
