"""Value of a diagnosis: the set's longest move, planned under the declared and under the diagnosed model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.cell.load import load_cell
from energy_opt.cell.request import CellRequest
from energy_opt.diagnosis import Diagnosis
from energy_opt.errors import BadInput, Infeasible
from energy_opt.measured import MeasuredSet
from energy_opt.motion import Move, Planner, Settings
from energy_opt.motion.judge.energy import Scorer
from energy_opt.numerics.signals import standstills
from energy_opt.power import PowerModel

ROOM = 1.2  # least duration over the shortest one, which leaves the planner no choice
STARTS = 4  # initial paths of each plan, so that two plans take only seconds


@dataclass(frozen=True)
class OwnMove:
    """A move that a set records: its run's file, its ends (n,) [rad] and how long it took [s]."""

    file: str
    start: np.ndarray
    goal: np.ndarray
    duration: float


def longest_move(measured: MeasuredSet) -> OwnMove | None:
    """The move between the two postures that lie farthest apart; None where nothing moves.

    A move starts where a run starts or where the arm stood still. It ends at the posture before the next standstill
    that is farthest from its start, so that a recording that returns to its start has a move, too.
    """
    best, most = None, 0.0
    for run in measured.runs:
        if run.kind != "motion" or len(run.time) < 3:
            continue
        edges = [0, *(row for pair in standstills(run.time, run.position) for row in pair), len(run.time) - 1]
        for first, last in pairwise(edges):
            away = np.linalg.norm(run.position[first : last + 1] - run.position[first], axis=1)
            end = first + int(np.argmax(away))
            if away[end - first] > most:
                most = float(away[end - first])
                took = float(run.time[end] - run.time[first])
                best = OwnMove(run.file, run.position[first], run.position[end], took)
    return best


def worth_of(
    measured: MeasuredSet,
    declared: PowerModel,
    diagnosed: PowerModel,
    *,
    cell: Cell | None = None,
    seed: int = 0,
    stopped: Callable[[], bool] = lambda: False,
) -> dict[str, Any] | None:
    """Energy [J] of the set's longest move, all under the diagnosed model; None where the set has no move.

    `declared_plan` and `diagnosed_plan` are the move planned under either model, `evenly_slowed` is its fastest timing
    on the first path, slowed evenly to the same `duration` [s] (None where that breaks a limit). A plan for the
    diagnosed model that costs more than the other two is a poorer local optimum: the cheapest is taken.

    Raises:
        Infeasible, BadInput: the move cannot be planned within the arm's limits and clear of its surroundings.
    """
    own = longest_move(measured)
    if own is None:
        return None
    robot, settings = measured.robot, Settings(seed=seed, starts=STARTS)
    low, high = robot.limits.lower, robot.limits.upper
    move = Move(np.clip(own.start, low, high), np.clip(own.goal, low, high), "reshape")
    planner = Planner(robot, diagnosed, settings, cell=cell, stopped=stopped)
    move = replace(move, duration=max(own.duration, ROOM * planner.minimum_time(move)))
    try:
        plan = planner.solve(move)
    except Infeasible as error:  # a path around an obstacle takes longer than the straight line
        if error.shortest_duration is None:
            raise
        move = replace(move, duration=ROOM * error.shortest_duration)
        plan = planner.solve(move)
    same = declared == diagnosed
    other = plan if same else Planner(robot, declared, settings, cell=cell, stopped=stopped).solve(move)
    if plan.status != "solved" or other.status != "solved":
        return None
    scorer = Scorer(robot, diagnosed)
    blind = scorer.energy(other.trajectory).total
    slowed = plan.baseline("scaled")
    evenly = slowed.energy.total if slowed is not None and slowed.valid else None
    known = [joules for joules in (plan.energy.total, blind, evenly) if joules is not None]
    return {
        "declared_plan": blind,
        "diagnosed_plan": min(known),
        "evenly_slowed": evenly,
        "file": own.file,
        "duration": move.duration,
    }


def add_worth(
    result: Diagnosis, surroundings: CellRequest, *, seed: int = 0, stopped: Callable[[], bool] = lambda: False
) -> None:
    """Add `worth` to a diagnosis' document; None, with a remark on the reason, if it cannot be stated."""
    document = result.document()
    document["worth"] = None
    if document["interrupted"] or stopped():
        return
    try:
        cell = load_cell(result.measured.robot, surroundings)
        models = (result.declared, result.model)
        document["worth"] = worth_of(result.measured, *models, cell=cell, seed=seed, stopped=stopped)
    except (Infeasible, BadInput) as error:  # a missing mesh must not make a diagnosis fail
        document["remarks"].append(f"What the diagnosis is worth is not stated: {error}.")


def worth_words(worth: dict[str, Any]) -> str:
    """`worth` in one sentence."""
    plan, blind, evenly = (worth[key] for key in ("diagnosed_plan", "declared_plan", "evenly_slowed"))
    text = (
        f"worth: the longest move of the set ({worth['file']}, {worth['duration']:.3g} s) takes {plan:.5g} J planned "
        f"with the diagnosed model and {blind:.5g} J planned with the declared one"
    )
    return text + ("" if evenly is None else f", {evenly:.5g} J evenly slowed") + "; all under the diagnosed model"
