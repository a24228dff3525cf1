"""The verb `optimize`: one move to minimum energy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

from energy_opt.cell.load import load_cell
from energy_opt.errors import BadInput, Infeasible
from energy_opt.front.answer import ANSWER, UNCHECKED, Answer
from energy_opt.front.controllers import Controllers, check_written, kept_words
from energy_opt.front.desk import Desk, verb
from energy_opt.front.given import cell_of, robot_of
from energy_opt.front.moves import ends_of, move_of, resolved, settings_of, with_goals
from energy_opt.front.rivals import compared, members, rivals_of
from energy_opt.motion import Move, Planner, Result
from energy_opt.motion.move import LONGEST, SHORTEST
from energy_opt.motion.plan.robust import RobustPlanner
from energy_opt.poses.solve import solve_to
from energy_opt.power.assumptions import assumptions_line
from energy_opt.requests.moves import OptimizeRequest


def solved(solve: Callable[[Move], Result], move: Move, asked: Move) -> tuple[Result, Move]:
    """Solve a move. If the given trajectory is too fast for the limits, the duration becomes free.

    Args:
        solve: the planner. move: at the duration of the given trajectory. asked: the move as asked for.

    Returns:
        The result, and the move that was solved.

    Raises:
        Infeasible: no motion keeps the limits.
    """
    try:
        return solve(move), move
    except Infeasible as error:
        if move == asked or error.shortest_duration is None:
            raise
        said = f"the {move.duration:.4g} s of the given trajectory are too short ({error}); the duration is free"
    result = solve(asked)
    return replace(result, warnings=(*result.warnings, said)), asked


def run(request: OptimizeRequest, desk: Desk) -> Answer:
    """One move to minimum energy, judged, beside its baselines.

    Raises:
        BadInput: an argument is not usable; the message names it and what is expected.
        Infeasible: no motion keeps the limits; the message names the limit, the place, and what would work.
    """
    robot, _ = robot_of(request), request.worth
    check_written(request, robot.n)
    if request.vias is not None and request.standard is None:
        raise BadInput("--vias belongs to --as moves; give --as moves, too")
    rivals, kind = rivals_of(request, robot, desk)
    settings, around = settings_of(request), cell_of(request)
    ends = ends_of(request, robot, around)
    given = move_of(request, robot, ends, desk.say, duration=request.duration, max_duration=request.max_duration)
    move, free = given, given.duration is None and given.max_duration is None and settings.objective != "time"
    if free and given.input is not None and SHORTEST <= given.input.duration <= LONGEST:
        move = replace(given, duration=given.input.duration)
    asked = resolved(request, robot, rivals, kind, given, ends)
    document = desk.take(ANSWER, asked)
    with desk.working() as (stopped, _):
        cell = load_cell(robot, around)
        known: dict[str, Any] = {"cell": cell, "stopped": stopped}
        planner = Planner(robot, rivals[0].model, settings, **known)
        robust = None if kind is None else RobustPlanner(robot, rivals, kind, settings, **known)
        controllers, chosen = Controllers(request, planner, robust), None
        try:
            if ends is None:
                found, move = solved(controllers.solver.solve, move, given)
            else:
                chosen = solve_to(
                    ends, move, robot, members(rivals), cell, settings, controllers.solver, kind == "worst"
                )
                found, move = chosen.result, chosen.move
            found, moves = controllers.with_room(move, *controllers.moves(move, found))
            found = compared(found, rivals, robot)
            if request.self_collision is False:
                found = replace(found, warnings=(*found.warnings, UNCHECKED))
            answer = Answer(
                **{f.name: getattr(found, f.name) for f in fields(Result)},
                arm=robot, move=move, request=asked, stamp=desk.stamp, cell=cell,
                controllers=lambda result, out: controllers.write(move, result, moves, out),
            )  # fmt: skip
            if ends is not None and chosen is not None:
                answer = with_goals(answer, chosen, ends.poses, settings)
        except Infeasible as fault:
            error = fault if ends is not None else replace(controllers, request=asked).with_duration(move, fault)
            desk.failed(
                ANSWER, error, robot=robot.name, joints=list(robot.joints), mode=move.mode, duration=move.duration,
                request=document,
            )  # fmt: skip
            raise error from None
        answer = desk.keep(answer)
    desk.report(answer.files)
    if moves is not None:
        desk.say(kept_words(moves))
    desk.report((), assumptions_line(answer.assumptions), answer.warnings)
    if answer.message:
        desk.say(f"{answer.status}: {answer.message}")
    return answer


optimize = verb(OptimizeRequest, run)
