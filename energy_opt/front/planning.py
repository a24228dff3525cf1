"""The verbs that plan moves, from Python: one move, and a batch of moves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from energy_opt.cell.load import load_cell
from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput, near
from energy_opt.front.answer import Answer, answer_of
from energy_opt.front.given import (
    AnyModel,
    AnyPath,
    AnyPayload,
    AnyRobot,
    Positions,
    path_from,
    positions,
    robot_from,
    several,
)
from energy_opt.front.goals import ends_from, with_goals
from energy_opt.front.input_time import at_input_time, solved
from energy_opt.front.request import request_of_move
from energy_opt.front.rivals import compared, members, rivals_from, robust_of
from energy_opt.motion import Move, Planner, Settings
from energy_opt.motion.plan.robust import RobustPlanner
from energy_opt.poses.pose import AnyOf, Pose
from energy_opt.poses.solve import solve_to
from energy_opt.power.per_year import PerYear
from energy_opt.robot import Robot

if TYPE_CHECKING:
    from energy_opt.bench import Batch


def move_for(
    robot: Robot,
    start: Any = None,
    goal: Any = None,
    path: AnyPath | None = None,
    via: Sequence[Any] = (),
    **of_move: Any,
) -> Move:
    """A move of `robot` from arguments as people have them; `of_move` are the other fields of `Move`.

    Raises:
        BadInput: ends are missing or given twice, of another shape or not finite.
    """
    along = None
    if path is not None:
        if start is not None or goal is not None:
            raise BadInput("--path says where the move begins and ends; give it, or --start and --goal")
        along = path_from(path, robot)
        source = along.source
        ends = (along.start, along.goal) if source is None else (source.position[0], source.position[-1])
        of_move.setdefault("input", source)
    elif start is None or goal is None:
        raise BadInput(f"--{'start' if start is None else 'goal'} is missing; give --start and --goal, or --path")
    else:
        ends = (positions(start, robot, "start"), positions(goal, robot, "goal"))
    points = tuple(positions(point, robot, "via") for point in via)
    return Move(ends[0], ends[1], path=along, via=points, **of_move)


def optimize(
    robot: AnyRobot,
    model: AnyModel | Sequence[AnyModel] = None,
    *,
    robust: str | None = None,
    start: Positions | Pose | None = None,
    goal: Positions | Pose | AnyOf | None = None,
    mode: str = "reshape",
    duration: float | None = None,
    max_duration: float | None = None,
    path: AnyPath | None = None,
    via: Sequence[Positions | Pose] = (),
    payload: AnyPayload | None = None,
    limits: str | PathLike[str] | None = None,
    scene: str | PathLike[str] | None = None,
    cell: CellRequest | None = None,
    per_year: PerYear | None = None,
    stopped: Callable[[], bool] = lambda: False,
    **more: Any,
) -> Answer:
    """One move to minimum energy, judged, beside its baselines.

    Args:
        robot: a robot, a name (`known_robots()`) or a URDF file.
        model: a power model, a model file, or "source-method-1", "source-method-2" or "careful"; or several, of which
            the first is the one that results are stated under. By default the last two named.
        robust: "mean" (the default of several models) or "worst" of the energies under all models.
        start: joint positions (n,) [rad] in any sequence, or by joint names; or a `Pose` of the tool.
        goal: the same, for the end; or `AnyOf` several: the cheapest is chosen (see `Answer.goals`).
        mode: "reshape" is free to change the path, "retime" keeps it.
        duration: exactly this long [s]; free where neither this nor `max_duration` is given.
        max_duration: at most this long [s].
        path: waypoints (K, n) [rad], a trajectory, a file of either, or a function q(s), in place of start and goal. A
            trajectory without a duration beside it is answered at its own.
        via: points (n,) [rad], or poses of the tool, to pass on the way (reshape).
        payload: mass [kg], or (mass, x, y, z) [kg, m] in the last joint's frame.
        limits: a joint_limits.yaml in MoveIt's format.
        scene: a file of what stands around the arm.
        cell: more of what the arm keeps clear of, and how; by default it keeps clear of itself and of the scene.
        per_year: how often the move is made in a year; states what the saving is worth.
        stopped: asked between solves; True ends the work with the best known so far.
        more: fields of `Settings` (starts, seed, compile, objective, ...) and further fields of `Move`.

    Raises:
        BadInput: something given is not usable; says what and what would be.
        Infeasible: no motion holds the limits; says which, where and what would work.
    """
    arm = robot_from(robot, limits)
    rivals, kind = rivals_from(several(model), robust, arm, payload)
    power = rivals[0].model
    of_move, settings = sorted_out(more)
    named = {"mode": mode, "duration": duration, "max_duration": max_duration}
    asked = cell or CellRequest()
    if scene is not None:
        asked = replace(asked, scene=Path(scene))
    if settings.tool is not None:
        asked = replace(asked, tool=settings.tool)
    begin, end, ends = ends_from(arm, start, goal, asked, via)
    given = move_for(arm, begin, end, path, () if ends is not None and ends.via else via, **named, **of_move)
    move = at_input_time(given, settings.objective)
    request = request_of_move(
        arm, power, move, settings, path=path, limits=limits, scene=asked.scene, cell=asked.document(),
        robust=robust_of(rivals, kind),
    )  # fmt: skip
    request |= {} if per_year is None else {"per_year": per_year.document()}
    if any(asked.base[3:5]):  # gravity is the scene's -z
        rivals = [replace(rival, model=rival.model.standing(*asked.base[3:5])) for rival in rivals]
        power = rivals[0].model
    known: dict[str, Any] = {"cell": load_cell(arm, asked), "stopped": stopped}
    planner: Planner | RobustPlanner = Planner(arm, power, settings, **known)
    if kind is not None:
        planner = RobustPlanner(arm, rivals, kind, settings, **known)
    if ends is None:
        found, _ = solved(planner.solve, move, given)
        return answer_of(compared(found, rivals, arm), arm, request, known["cell"], per_year)
    chosen = solve_to(ends, move, arm, members(rivals), known["cell"], settings, planner.solve, kind == "worst")
    answer = answer_of(compared(chosen.result, rivals, arm), arm, ends.asked(request), known["cell"], per_year)
    return with_goals(answer, chosen, ends.poses, settings)


def sorted_out(more: dict[str, Any]) -> tuple[dict[str, Any], Settings]:
    """Further keywords as fields of a move, and as settings."""
    of_move = {f.name for f in fields(Move)} - {"start", "goal", "path", "via"}
    of_settings = {f.name for f in fields(Settings)}
    for name in more:
        if name not in of_move | of_settings:
            raise BadInput(f"no argument {name!r}{near(name, of_move | of_settings)}")
    settings = Settings(**{name: value for name, value in more.items() if name in of_settings})
    return {name: value for name, value in more.items() if name not in of_settings}, settings


def bench(suite: str | PathLike[str], out: str | PathLike[str] | None = None, *, jobs: int = 1, **more: Any) -> Batch:
    """Run a suite of moves, in parallel and resumable, with a report in the folder `out` (bench_<name>).

    Args:
        jobs: processes on this machine.
        more: `overrides`, `seed` and `compile` of the suite; `resume`, `scheduler` and `quiet` of the run.
    """
    from energy_opt.bench import load_suite, run_batch

    of_suite = {name: more.pop(name) for name in ("overrides", "seed", "compile") if name in more}
    loaded = load_suite(Path(suite), **of_suite)
    return run_batch(loaded, Path(out or f"bench_{loaded.name}"), jobs=jobs, **more)
