"""The verb `tradeoff`: energy against duration of one move, or of a job over its cycle time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from typing import Any

import numpy as np

from energy_opt.cell.load import load_cell
from energy_opt.errors import BadInput
from energy_opt.front.desk import Desk, verb
from energy_opt.front.given import cell_of, robot_of
from energy_opt.front.jobs import run_job
from energy_opt.front.models import break_even_friction, members, records_under, rivals_of, said, with_careful
from energy_opt.front.moves import ends_of, move_of, resolved, settings_of
from energy_opt.motion import Move, Planner
from energy_opt.motion.plan.robust import RobustPlanner
from energy_opt.motion.plan.robust_models import Rival
from energy_opt.motion.travel import detours
from energy_opt.poses.cheapest_move import solve_to
from energy_opt.power import PowerModel
from energy_opt.power.assumptions import Assumption, assumptions
from energy_opt.power.assumptions import assumptions_line as assumed
from energy_opt.power.per_year import PerYear
from energy_opt.reports.tradeoff import page
from energy_opt.reports.words import least_of
from energy_opt.requests.moves import TradeoffRequest
from energy_opt.results import Document, interrupted_words
from energy_opt.robot import Robot
from energy_opt.tradeoffs.fixed_cycle import Cycle
from energy_opt.tradeoffs.front import Front, trace
from energy_opt.tradeoffs.front_files import Tradeoff, document, motions_of, stated, text

MOST = 1000  # most durations of a front; each needs a solve or more: some minutes
DURATIONS = "expected FIRST:LAST:COUNT, two durations above 0 s, the smaller first, and a count of at least 2"


def run(request: TradeoffRequest, desk: Desk) -> Tradeoff:
    """Energy against duration of one move, planned under the same models as `optimize`, or of a job.

    Raises:
        BadInput: an argument is not usable; the message names it and what is expected.
        Infeasible: no duration works, or none that is within the cycle.
    """
    first: Any = request.robot
    if request.job is None and (isinstance(first, Mapping) or str(first).endswith(".toml")):
        request = replace(request, job=first, robot=None)  # from Python, a job as the first argument
    if request.objective != "energy":
        raise BadInput(f"--objective {request.objective}: tradeoff minimises energy only; leave --objective out")
    durations, worth = durations_of(request), request.worth
    if request.job is not None:
        return run_job(request, durations, desk)
    if request.resume:
        raise BadInput("--resume belongs to a job: tradeoff JOB.toml --resume")
    if request.robot is None:
        raise BadInput("--robot is missing: a name (`energy-opt robots`) or a URDF; or give a JOB.toml")
    robot = robot_of(request)
    rivals, kind = rivals_of(request, robot, desk)
    around = cell_of(request)
    ends = ends_of(request, robot, around, desk.say)
    move = move_of(request, robot, ends, desk.say)
    desk.report(warnings=robot.warnings)
    settings = settings_of(request)
    asked = replace(resolved(request, robot, rivals, kind, move, ends), durations=durations, duration=None)
    document = desk.take(Tradeoff.answer, asked)
    with desk.working() as (stopped, show):

        def progress(front: Front, expected: int) -> None:
            show(f"{front.solves}/{expected} solves", front.solves / expected)

        cell = load_cell(robot, around)
        known: dict[str, Any] = {"cell": cell, "stopped": stopped}
        planner: Planner | RobustPlanner
        if kind is None:
            planner = Planner(robot, rivals[0].model, settings, **known)
        else:
            planner = RobustPlanner(robot, rivals, kind, settings, **known)
        goals: dict[str, Any] = {}
        notes: tuple[str, ...] = ()
        if ends is not None:
            # the goal that is cheapest at a free duration; the whole front is computed for it
            chosen = solve_to(ends, move, robot, members(rivals), mean_of(planner).cell, settings, planner)
            move, goals, notes = chosen.move, chosen.document(), chosen.warnings
        cycle = over = cycle_for(robot, rivals[0].model, move, request.cycle, request.idle_power)
        mean = mean_of(planner)
        if cycle is not None and mean is not planner:
            over = cycle_for(robot, mean.model, move, cycle.length, cycle.idle_power)
        front = trace(
            mean, move, cycle=over, durations=durations, longest=request.max_duration, progress=progress,
            stopped=stopped,
        )  # fmt: skip
        if isinstance(planner, RobustPlanner):
            front = stated(planner, move, front, cycle)
        found = {**document_of(planner, rivals, move, front, cycle, document, worth), **goals}
        warnings = dict.fromkeys((*found["warnings"], *notes, *(() if cell is None else cell.warnings)))
        found["warnings"] = [*interrupted_words(front.interrupted), *warnings]
        report = partial(page, motions=motions_of(front), robot=robot, cell=mean.cell)
        answer = desk.keep(Tradeoff(Document(found), asked, report, text, robot, front, move))
    desk.report((), assumed([Assumption(**row) for row in found["assumptions"]]), found["warnings"])
    if "message" in found:
        desk.complain(found["message"])
    return answer


tradeoff = verb(TradeoffRequest, run)


def durations_of(request: TradeoffRequest) -> list[float] | None:
    """Durations [s] that a request asks for; None where the program chooses.

    Raises:
        BadInput: none that a move can take, too many, or given twice.
    """
    given = request.durations
    if given is None:
        if request.duration is None:
            return None
        if not 0 < request.duration < np.inf:
            raise BadInput(f"--duration {request.duration:g}: expected seconds above 0")
        return [request.duration]
    for name in ("duration", "max_duration"):
        if getattr(request, name) is not None:
            raise BadInput(f"--durations gives the durations; leave --{name.replace('_', '-')} out")
    if not isinstance(given, str):
        try:
            listed: list[float] = np.ravel(np.asarray(given, dtype=float)).tolist()
        except (TypeError, ValueError):
            listed = []
        if not listed or not all(0 < d < np.inf for d in listed):
            raise BadInput(f"--durations {given}: expected FIRST:LAST:COUNT, or a list of durations above 0 s")
        return listed
    parts = given.split(":")
    try:
        first, last, count = float(parts[0]), float(parts[1]), int(parts[2])
        if len(parts) != 3 or not 0 < first <= last < np.inf or count < 1 or (count == 1 and first != last):
            raise ValueError
    except (ValueError, IndexError):
        raise BadInput(f"--durations {given}: {DURATIONS}") from None
    if count > MOST and not request.allow_large:
        raise BadInput(f"--durations {given}: expected at most {MOST} durations, or --allow-large")
    return [float(d) for d in np.linspace(first, last, count)]


def mean_of(planner: Planner | RobustPlanner) -> Planner:
    """The planner itself; for several models, the planner of their mean."""
    return planner.planner if isinstance(planner, RobustPlanner) else planner


def document_of(
    planner: Planner | RobustPlanner,
    rivals: Sequence[Rival],
    move: Move,
    front: Front,
    cycle: Cycle | None,
    request: Mapping[str, Any],
    worth: PerYear | None = None,
) -> dict[str, Any]:
    """The content of tradeoff.json.

    Args:
        planner: that made the front. rivals: the models. move: as solved. front: its points. cycle: the cycle with the
            wait, or None. request: the request's document. worth: what savings are worth in a year: over the cycle, the
            saving against the fastest move with a wait; without a cycle, that of the minimum against the same move
            slowed evenly.
    """
    robot = planner.robot
    found = document(front, robot=robot.name, joints=robot.joints, mode=move.mode, cycle=cycle)
    found["assumptions"] = [asdict(row) for row in assumptions(robot, [rival.model for rival in rivals])]
    if isinstance(planner, RobustPlanner) and any(point.minimised for point in front.points):
        found["robust"] = {"kind": planner.kind, "total": found["minimum"] and found["minimum"]["energy_robust"]}
    best = None if front.minimum is None else front.minimum.trajectory
    models: list[dict[str, Any]] = []
    if best is not None:
        slowed = mean_of(planner).slowed(move, best.duration)
        found["break_even_friction"] = break_even_friction(best, slowed, rivals[0].model, robot)
        found["travel"] = detours(best)
        if isinstance(planner, RobustPlanner):
            models = planner.compared(best, slowed)
        else:
            models = records_under(with_careful(rivals, robot), best, slowed, robot)
    warnings = _overloads(planner, front) if isinstance(planner, RobustPlanner) else said(models, "the front's minimum")
    if worth is not None:
        over = found.get("cycle") or {}
        least, fastest = over.get("minimum"), over.get("fastest_then_wait")
        saved = None if cycle is not None or not models else models[0]["saving_joules"]
        if least and fastest:
            saved = least_of(found, fastest) - least_of(found, least)
        found["per_year"] = worth.of(saved)
    return {**found, "models": models, "warnings": warnings, "request": request}


def cycle_for(
    robot: Robot, model: PowerModel, move: Move, length: float | None, idle_power: float | None
) -> Cycle | None:
    """The cycle of `length` [s] that begins with the move; None if no cycle is asked for.

    Args:
        robot, model: for the power while the arm waits. move: ends at rest. length: [s]. idle_power: [W] overhead while
            waiting (None: the model's standby).

    Raises:
        BadInput: an idle power without a cycle, a move that does not end at rest, or impossible values.
    """
    if length is None:
        if idle_power is not None:
            raise BadInput("--idle-power is the power while waiting; give --cycle, too")
        return None
    if np.any(move.end_velocities[1]):
        raise BadInput("--cycle: the move does not end at rest, so the arm cannot wait at its goal")
    return Cycle(robot, model, move.goal, length, idle_power)


def _overloads(robust: RobustPlanner, front: Front) -> list[str]:
    """A warning that names the durations of points that exceed a torque limit under another model than the first."""
    points = [p for p in (front.fastest, front.minimum, front.cycle_minimum, *front.points) if p is not None]
    over = {f"{p.duration:.4g}" for p in points if p.trajectory is not None and robust.overloads(p.trajectory)}
    if not over:
        return []
    listed = ", ".join(sorted(over, key=float))
    return [
        f"in {listed} s a motor's torque exceeds its limit under another model than {robust.rivals[0].name!r}; "
        "no move that holds it under all models was found in that time"
    ]
