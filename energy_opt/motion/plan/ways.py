"""Free ends and a free first path: the given one, the straight line, or a way around what stands between."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.errors import BadInput, Infeasible
from energy_opt.motion.judge.clearance import clearance_along
from energy_opt.motion.limits.base import Limit, box_of
from energy_opt.motion.move import Move, Settings
from energy_opt.motion.path import JointPath
from energy_opt.motion.plan.context import path_of
from energy_opt.motion.plan.posed import holds, posed
from energy_opt.motion.result import FirstPath
from energy_opt.motion.ways import find_ways, ompl
from energy_opt.motion.ways.find import Ends, Source
from energy_opt.motion.ways.room import Room, steps
from energy_opt.power import PowerModel
from energy_opt.robot import Robot


def check_free(cell: Cell, q: np.ndarray, what: str) -> None:
    """Raises Infeasible where the arm touches something at q (n,); `what` says which pose this is."""
    contact = cell.touching(q)
    if contact is not None:
        raise Infeasible(
            f"{what}: {contact}; a pose that is free would work", limit="clearance",
            position=1.0 if what == "goal" else 0.0, excess=contact.depth,
        )  # fmt: skip


def first_path(
    robot: Robot, model: PowerModel, cell: Cell | None, settings: Settings, limits: Sequence[Limit], move: Move
) -> tuple[Move, FirstPath, tuple[JointPath, ...]]:
    """The move with a first path that is free, where this comes from, and further free paths.

    Raises:
        Infeasible: a move that keeps its path would touch something, or no way around was found.
    """
    begin = time.perf_counter()
    source: Source = "straight" if move.path is None and not move.via else "given"
    tube = settings.tube is not None  # about what was asked for: it is no use to start elsewhere
    if tube:
        move = replace(move, path=path_of(move))
    elif source == "straight" and not holds(robot, model, limits, path_of(move)):
        path = posed(robot, model, limits, path_of(move))
        if path is not None and (cell is None or clearance_along(cell, path).proven):
            return replace(move, path=path), FirstPath("own", time.perf_counter() - begin), ()
    if cell is None:
        return move, FirstPath(source), ()
    found = clearance_along(cell, path_of(move))
    if found.proven or (move.mode == "reshape" and (tube or source == "given")):
        return move, FirstPath(source, time.perf_counter() - begin), ()
    if tube or source == "given":
        what = "straight line" if source == "straight" else "given path"
        raise Infeasible(
            f"the {what} is not free: at {found.time:.4g} of it {found}; "
            "--mode reshape may start from it all the same",
            limit="clearance", position=found.time, excess=found.depth,
        )  # fmt: skip
    if cell.request.planner == "ompl" and not ompl.installed():
        raise BadInput("--planner ompl: OMPL is not installed; pip install 'energy-opt[plan]'")
    lower, upper = box_of(limits, robot.n)
    ends = Ends.of(move.start, move.goal, lower, upper, robot.limits.velocity)
    count = settings.ways if move.mode == "reshape" else 1
    ways = find_ways(
        Room(cell, np.stack([move.start, move.goal])), ends, steps(robot.body.tree()),
        planner=cell.request.planner, seed=settings.seed, count=count,
    )  # fmt: skip
    seconds = time.perf_counter() - begin
    if ways:
        further = tuple(way.path for way in ways[1:])
        return replace(move, path=ways[0].path), FirstPath(ways[0].source, seconds), further
    if move.mode == "reshape":
        return move, FirstPath(source, seconds), ()
    extra = "" if ompl.installed() else "; pip install 'energy-opt[plan]' brings a planner that looks further"
    raise Infeasible(f"the straight line is not free ({found}), and no way around was found{extra}", limit="clearance")
