"""The verb `tradeoff` from Python: energy against duration of one move."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.cell.load import load_cell
from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput
from energy_opt.front.given import (
    AnyModel,
    AnyPath,
    AnyPayload,
    AnyRobot,
    Positions,
    robot_from,
    several,
)
from energy_opt.front.goals import ends_from
from energy_opt.front.planning import move_for, sorted_out
from energy_opt.front.request import request_of_move
from energy_opt.front.rivals import members, rivals_from, robust_of, said, with_careful
from energy_opt.motion import Move, Planner, Settings
from energy_opt.motion.plan.robust import Kind, Rival, RobustPlanner
from energy_opt.poses.ends import Ends
from energy_opt.poses.pose import AnyOf, Pose
from energy_opt.poses.solve import solve_to
from energy_opt.power import PowerModel
from energy_opt.power.assumptions import assumptions
from energy_opt.power.per_year import PerYear
from energy_opt.robot import Robot

if TYPE_CHECKING:
    from energy_opt.tradeoff import Cycle, Front


@dataclass(frozen=True, repr=False)
class Tradeoff:
    """Energy against duration of one move.

    Attributes:
        front: its points, from fast to slow.
        document: tradeoff.json. robot: the arm.
        cell: the arm's body and what stood around it; None where nothing was kept clear of.
    """

    front: Front
    document: dict[str, Any]
    robot: Robot
    cell: Cell | None = None

    @property
    def durations(self) -> np.ndarray:
        """(P,) [s]."""
        return np.array([row["duration"] for row in self.document["points"]])

    @property
    def energies(self) -> np.ndarray:
        """Total energy at each duration, (P,) [J]; nan where none was found."""
        return np.array([row["energy_total"] for row in self.document["points"]], dtype=float)

    def save(self, out: str | PathLike[str]) -> Path:
        """Write tradeoff.csv, tradeoff.json, plot.png and report.html into the folder `out`."""
        from energy_opt.tradeoff.output import write

        write(Path(out), self.front, self.document, self.robot, self.cell)
        return Path(out)

    def __repr__(self) -> str:
        least = self.document["minimum"]
        best = "" if least is None else f", least {least['energy_total']:.4g} J at {least['duration']:.4g} s"
        return f"Tradeoff({self.document['robot']!r}, {len(self.document['points'])} points{best})"

    def _repr_html_(self) -> str:
        rows = zip(self.durations, self.energies, strict=True)
        cells = "".join(f"<tr><td>{d:.4g}</td><td>{e:.6g}</td></tr>" for d, e in rows)
        return f"<table><tr><th>duration [s]</th><th>energy [J]</th></tr>{cells}</table>"


def tradeoff(
    robot: AnyRobot,
    model: AnyModel | Sequence[AnyModel] = None,
    *,
    start: Positions | Pose | None = None,
    goal: Positions | Pose | AnyOf | None = None,
    durations: Sequence[float] | np.ndarray | None = None,
    longest: float | None = None,
    cycle: float | None = None,
    idle_power: float | None = None,
    mode: str = "reshape",
    path: AnyPath | None = None,
    via: Sequence[Positions | Pose] = (),
    payload: AnyPayload | None = None,
    limits: str | PathLike[str] | None = None,
    scene: str | PathLike[str] | None = None,
    cell: CellRequest | None = None,
    per_year: PerYear | None = None,
    stopped: Callable[[], bool] = lambda: False,
    **more: Any,
) -> Tradeoff:
    """Energy against duration of one move, planned under the same models; arguments as those of `optimize`, and

    Args:
        durations: where [s]; by default chosen from the fastest and the optimum, up to `longest`.
        longest: where the front ends [s], where the program chooses.
        cycle: length [s] of a cycle in which the arm waits at the goal after the move, counted too.
        idle_power: overhead while waiting [W], in place of the model's standby.
        per_year: how often the move is made in a year; states what the saving is worth.

    Raises:
        BadInput: something given is not usable; says what and what would be.
        Infeasible: no duration works at all, or none that is within the cycle.
    """
    arm = robot_from(robot, limits)
    rivals, kind = rivals_from(several(model), None, arm, payload)
    of_move, settings = sorted_out(more)
    asked = cell or CellRequest()
    if scene is not None:
        asked = replace(asked, scene=Path(scene))
    if settings.tool is not None:
        asked = replace(asked, tool=settings.tool)
    begin, end, ends = ends_from(arm, start, goal, asked, via)
    move = move_for(arm, begin, end, path, () if ends is not None and ends.via else via, mode=mode, **of_move)
    if any(asked.base[3:5]):  # gravity is the scene's -z
        rivals = [replace(rival, model=rival.model.standing(*asked.base[3:5])) for rival in rivals]
    wanted = None if durations is None else [float(d) for d in durations]
    chosen: dict[str, Any] = {"durations": wanted, "longest": longest, "cycle": cycle, "idle_power": idle_power}
    named: dict[str, Any] = {"path": path, "limits": limits, "scene": asked.scene, "cell": asked.document()}
    chosen |= {"robust": robust_of(rivals, kind)}
    request = request_of_move(arm, rivals[0].model, move, settings, **named, **chosen)
    request |= {} if per_year is None else {"per_year": per_year.document()}
    planner = planner_for(arm, rivals, kind, settings, cell=load_cell(arm, asked), stopped=stopped)
    goals: dict[str, Any] = {}
    if ends is not None:
        request = ends.asked(request)
        move, goals = chosen_for(planner, ends, move, rivals, settings)
    over = cycle_for(arm, rivals[0].model, move, cycle, idle_power)
    front = traced(planner, move, over, durations=wanted, longest=longest, stopped=stopped)
    found = {**document_of(planner, rivals, move, front, over, request, per_year), **goals}
    return Tradeoff(front, found, arm, mean_of(planner).cell)


def chosen_for(
    planner: Planner | RobustPlanner, ends: Ends, move: Move, rivals: Sequence[Rival], settings: Settings
) -> tuple[Move, dict[str, Any]]:
    """The move to the goal that is cheapest at a free duration, at all of whose durations the front is made.

    Returns: the move, and `candidates` and `nearest` as in result.json.
    """
    mean = mean_of(planner)
    chosen = solve_to(ends, move, planner.robot, members(rivals), mean.cell, settings, planner.solve)
    return chosen.move, chosen.document()


def planner_for(
    robot: Robot, rivals: Sequence[Rival], kind: Kind | None, settings: Settings, **more: Any
) -> Planner | RobustPlanner:
    """What plans under one model (`kind` None) or several."""
    if kind is None:
        return Planner(robot, rivals[0].model, settings, **more)
    return RobustPlanner(robot, rivals, kind, settings, **more)


def mean_of(planner: Planner | RobustPlanner) -> Planner:
    """The planner itself, or of several models that of their mean."""
    return planner.planner if isinstance(planner, RobustPlanner) else planner


def traced(planner: Planner | RobustPlanner, move: Move, cycle: Cycle | None, **more: Any) -> Front:
    """The front of a move, as `energy_opt.tradeoff.trace` makes it; of several models stated under the first.

    Args:
        cycle: under the first model; more: further arguments of `trace`.
    """
    from energy_opt.tradeoff import trace
    from energy_opt.tradeoff.models import stated

    if isinstance(planner, Planner):
        return trace(planner, move, cycle=cycle, **more)
    mean = planner.planner
    over = None if cycle is None else cycle_for(mean.robot, mean.model, move, cycle.length, cycle.idle_power)
    return stated(planner, move, trace(mean, move, cycle=over, **more), cycle)


def document_of(
    planner: Planner | RobustPlanner,
    rivals: Sequence[Rival],
    move: Move,
    front: Front,
    cycle: Cycle | None,
    request: Mapping[str, Any],
    worth: PerYear | None = None,
) -> dict[str, Any]:
    """tradeoff.json: the front, what several models make of its minimum, what it rests on, and the request.

    `worth` is for what is saved over the cycle against the fastest move and waiting; without a cycle, by the minimum
    against the same move slowed evenly.
    """
    from energy_opt.tradeoff.models import models_of, models_of_front
    from energy_opt.tradeoff.output import document

    robot = planner.robot
    found = document(front, robot=robot.name, joints=robot.joints, mode=move.mode, cycle=cycle)
    found["assumptions"] = [asdict(row) for row in assumptions(robot, [rival.model for rival in rivals])]
    if isinstance(planner, RobustPlanner):
        models, warnings = models_of_front(planner, move, front), []
    else:
        models = models_of(planner, move, front, with_careful(rivals, robot))
        warnings = said(models, "the front's minimum")
    if worth is not None:
        over = found.get("cycle") or {}
        best, fastest = over.get("minimum"), over.get("fastest_then_wait")
        saved = None if cycle is not None or not models else models[0]["saving_joules"]
        if best and fastest:
            saved = fastest["energy_total"] - best["energy_total"]
        found["per_year"] = worth.of(saved)
    return {**found, "models": models, "warnings": warnings, "request": request}


def cycle_for(
    robot: Robot, model: PowerModel, move: Move, length: float | None, idle_power: float | None
) -> Cycle | None:
    """The cycle of `length` s that begins with the move; None where none is asked for.

    Raises:
        BadInput: an idle power without a cycle, a move that does not end at rest, or values that no cycle has.
    """
    from energy_opt.tradeoff import Cycle

    if length is None:
        if idle_power is not None:
            raise BadInput("--idle-power is what waiting takes; give --cycle too")
        return None
    if np.any(move.end_velocities[1]):
        raise BadInput("--cycle: the move does not end at rest, so the arm cannot wait at its goal")
    return Cycle(robot, model, move.goal, length, idle_power)
