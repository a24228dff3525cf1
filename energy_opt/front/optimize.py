"""The verb `optimize`: one move to minimum energy."""

from __future__ import annotations

from typing import Any

from energy_opt.cell.load import load_cell
from energy_opt.errors import Infeasible
from energy_opt.front.answer import ANSWER, Answer, answer_of
from energy_opt.front.controllers import (
    check_controllers,
    kept_words,
    moves_of,
    with_duration_of_moves,
    with_room_of,
    write_controllers,
)
from energy_opt.front.desk import Desk, verb
from energy_opt.front.ends import ends_of
from energy_opt.front.given import cell_of, robot_of
from energy_opt.front.goals import with_goals
from energy_opt.front.input_time import at_input_time, solved
from energy_opt.front.moves import move_of, resolved, settings_of
from energy_opt.front.rivals import compared, members, rivals_of
from energy_opt.motion import Planner
from energy_opt.motion.plan.robust import RobustPlanner
from energy_opt.poses.solve import solve_to
from energy_opt.power.assumptions import said
from energy_opt.requests.moves import OptimizeRequest


def run(request: OptimizeRequest, desk: Desk) -> Answer:
    """One move to minimum energy, judged, beside its baselines.

    Raises:
        BadInput: something given is not usable; says what and what would be.
        Infeasible: no motion holds the limits; says which, where and what would work.
    """
    robot, _ = robot_of(request), request.worth
    check_controllers(request, robot.n)
    rivals, kind = rivals_of(request, robot, desk)
    settings, around = settings_of(request), cell_of(request)
    ends = ends_of(request, robot, around)
    given = move_of(request, robot, ends, desk.say, duration=request.duration, max_duration=request.max_duration)
    move = at_input_time(given, settings.objective)
    asked = resolved(request, robot, rivals, kind, given, ends)
    document = desk.stamped(asked.document())
    desk.take(ANSWER, document)
    with desk.working() as (stopped, _):
        cell = load_cell(robot, around)
        known: dict[str, Any] = {"cell": cell, "stopped": stopped}
        planner = Planner(robot, rivals[0].model, settings, **known)
        robust = None if kind is None else RobustPlanner(robot, rivals, kind, settings, **known)
        try:
            solver, chosen = planner if robust is None else robust, None
            if ends is None:
                found, move = solved(solver.solve, move, given)
            else:
                chosen = solve_to(ends, move, robot, members(rivals), cell, settings, solver, kind == "worst")
                found, move = chosen.result, chosen.move
            found, moves = with_room_of(
                request, planner, robust, move, *moves_of(request, planner, robust, move, found)
            )
            answer = answer_of(
                compared(found, rivals, robot), arm=robot, move=move, request=asked, stamp=desk.stamped({}), cell=cell,
                controllers=lambda result, out: write_controllers(request, planner, move, result, moves, out),
            )  # fmt: skip
            if ends is not None and chosen is not None:
                answer = with_goals(answer, chosen, ends.poses, settings)
        except Infeasible as fault:
            error = fault if ends is not None else with_duration_of_moves(asked, planner, robust, move, fault)
            desk.failed(
                ANSWER, error, robot=robot.name, joints=list(robot.joints), mode=move.mode, duration=move.duration,
                request=document,
            )  # fmt: skip
            raise error from None
        answer = desk.keep(answer)
    for row in answer.files:
        desk.say(f"{row.file if desk.out is None else desk.out / row.file}: {row}")
    if moves is not None:
        desk.say(kept_words(moves))
    if line := said(answer.assumptions):
        desk.say(line)
    for warning in answer.warnings:
        desk.say(f"warning: {warning}")
    if answer.message:
        desk.say(f"{answer.status}: {answer.message}")
    return answer


optimize = verb(OptimizeRequest, run)
