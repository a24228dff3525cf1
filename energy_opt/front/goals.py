"""Moves whose start or goal is a set: a pose of the tool, or any of several positions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput
from energy_opt.front.answer import Answer
from energy_opt.front.given import positions
from energy_opt.motion import Move, Planner, Result, Settings, Trajectory
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.plan.robust import Rival
from energy_opt.poses.choose import Chooser, Chosen
from energy_opt.poses.ends import Ends
from energy_opt.poses.estimate import holding
from energy_opt.poses.inverse import ToolKinematics
from energy_opt.poses.judge import pose_document
from energy_opt.poses.pose import AnyOf, Pose
from energy_opt.poses.sets import Ring, Target, layer, positions_of, thinned
from energy_opt.power import Mixture
from energy_opt.robot import Robot

Solve = Callable[[Move, Sequence[Trajectory]], Result]
CONTROLS = 20  # of solves that only rank goals


def solve_to(
    ends: Ends,
    move: Move,
    robot: Robot,
    rivals: Sequence[Rival],
    cell: Cell | None,
    settings: Settings,
    solve: Solve,
    kind: str | None = None,
) -> Chosen:
    """The cheapest motion to any of the goals; see `Chooser.choose`.

    Args:
        ends: start pose, poses on the way and goals; the move's own goal is ignored, and its start where there is a
            start pose.
        kind: "worst" compares goals by the worst of the rivals' models, anything else by their mean.
    """
    tool = ToolKinematics(robot, settings.tool)
    models = [rival.model for rival in rivals if not rival.name.startswith("draw ")]
    scorers = [Scorer(robot, model) for model in models]
    if ends.start is not None or ends.via:
        move = _placed(ends, move, tool, scorers, cell, settings)
    quick = replace(settings, starts=1, controls=min(CONTROLS, settings.controls), solver="sqp", ways=1)
    rough = Planner(robot, Mixture.of(models) if len(models) > 1 else models[0], quick, cell=cell)
    chooser = Chooser(tool, scorers, cell, solve, rough.solve, settings.seed, kind == "worst")
    return chooser.choose(move, ends.goals)


def _placed(
    ends: Ends, move: Move, tool: ToolKinematics, scorers: Sequence[Scorer], cell: Cell | None, settings: Settings
) -> Move:
    """The move with those positions of its start pose and of the poses on its way that are likely to be cheapest.

    Raises:
        Infeasible: no positions reach one of them, or all touch something.
    """
    start: Target = move.start if ends.start is None else ends.start
    near = tool.robot.limits.near_zero if ends.start is not None else move.start
    rows = [positions_of(tool, each, cell, near=near, seed=settings.seed) for each in (start, *ends.via)]
    goals = [positions_of(tool, each, cell, near=near, seed=settings.seed) for each in ends.goals]
    rows.append(np.vstack(goals))
    layers = [layer(scorers, thinned(q, holding(scorers, q))) for q in rows]
    chain = Ring(layers, [scorers] * (len(layers) - 1), [(0.0, np.inf)] * len(layers))
    chosen, _ = chain.cheapest(move.duration or move.max_duration or np.inf, 0.0)
    q = [each.positions[k] for each, k in zip(layers, chosen, strict=True)]
    return replace(move, start=q[0], via=tuple(q[1:-1]))


def ends_from(
    robot: Robot, start: object, goal: object, asked: CellRequest, via: Sequence[object] = ()
) -> tuple[object, object, Ends | None]:
    """Start and goal as `move_for` takes them, and the ends where one of them is a pose or several goals.

    Args:
        start: positions or a `Pose`; goal: positions, a `Pose`, or `AnyOf` these; via: positions, or poses alone.
        asked: in whose scene's frames poses may stand.
    """
    poses = tuple(each for each in via if isinstance(each, Pose))
    if poses and len(poses) < len(via):
        raise BadInput("via: positions and poses of the tool are both given; give one kind")
    if not isinstance(start, Pose) and not isinstance(goal, (Pose, AnyOf)) and not poses:
        return start, goal, None
    many = [each for each in (goal if isinstance(goal, AnyOf) else (goal,)) if each is not None]
    goals = tuple(each if isinstance(each, Pose) else positions(each, robot, "goal") for each in many)  # type: ignore[arg-type]
    begin = robot.limits.near_zero if isinstance(start, Pose) else start
    ends = Ends(start if isinstance(start, Pose) else None, goals, poses)
    return begin, begin, ends.in_base(robot, asked)


def _passing(trajectory: Trajectory, q: np.ndarray) -> np.ndarray:
    """Where a motion is nearest to positions q (n,)."""
    from scipy.optimize import minimize_scalar

    time = trajectory.time
    k = int(np.argmin(np.linalg.norm(trajectory.position - q, axis=1)))
    ends = time[max(k - 1, 0)], time[min(k + 1, len(time) - 1)]

    def miss(t: float) -> float:
        return float(np.linalg.norm(trajectory.sample(np.array([t]))[0][0] - q))

    found = minimize_scalar(miss, bounds=ends, method="bounded", options={"xatol": 1e-12})
    return np.asarray(trajectory.sample(np.array([found.x]))[0][0])


def with_goals(result: Answer, chosen: Chosen, poses: dict[str, Pose], settings: Settings) -> Answer:
    """The answer with the goals that were looked at, and by what its ends miss their poses."""
    rows = result.trajectory.position
    at = {"start": rows[0], "goal": rows[-1]}
    for k, q in enumerate(chosen.move.via, start=1):
        at[f"via {k}"] = _passing(result.trajectory, q)
    said = pose_document(result.arm, settings.tool, poses, at)
    status = result.status
    if not all(end["valid"] for end in said.values()):
        status = "not_converged"
    return replace(result, status=status, goals={**chosen.document(), "poses": said})
