"""Where the first path of a move comes from, when the arm has a body and stands in a cell."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.errors import BadInput, Infeasible
from energy_opt.motion.move import Move
from energy_opt.motion.path import JointPath
from energy_opt.motion.ways import find_ways, ompl
from energy_opt.motion.ways.find import Ends
from energy_opt.motion.ways.room import Room, steps


@dataclass(frozen=True)
class FirstPath:
    """What a result says of its first path: "straight", "given", "own" or "ompl", and the seconds it took."""

    source: str
    seconds: float

    def document(self) -> dict[str, object]:
        """As it stands in result.json."""
        return {"source": self.source, "seconds": self.seconds}


def check_ends(cell: Cell, move: Move) -> None:
    """Raise Infeasible where the arm touches something at an end of the move: which pair, and how deep."""
    ends = (("start", move.start, 0.0), ("goal", move.goal, 1.0), *(("via", q, None) for q in move.via))
    for what, q, position in ends:
        contact = cell.touching(np.asarray(q, dtype=float))
        if contact is not None:
            raise Infeasible(f"{what}: {contact}", limit="clearance", position=position, excess=contact.depth)


def check_path(cell: Cell, path: JointPath) -> None:
    """Raise Infeasible where a given path comes too near to something: which pair, how near, and where on the path."""
    s = path.knots
    found = cell.prove(s, path(s), path(s, 1), path(s, 2))
    if found.proven or found.time is None or found.pair is None:
        return
    near = f"touches {found.pair[1]} ({1e3 * found.depth:.3g} mm deep)" if found.depth else f"is near {found.pair[1]}"
    where = f"at {100 * found.time:.3g} % of its way"
    raise Infeasible(
        f"the given path: {found.pair[0]} {near} {where}; --mode reshape may start from it",
        limit="clearance",
        position=found.time,
        excess=found.depth,
    )


def first_path(cell: Cell, move: Move, *, seed: int = 0, count: int = 1) -> tuple[Move, FirstPath, list[JointPath]]:
    """The move with a first path that is free, where that comes from, and up to `count` - 1 other ways to start from.

    A path that was given is kept, whether it is free or not; so is the path through given points. Otherwise it is the
    straight line, or the shortest of the ways found.

    Raises:
        Infeasible: an end touches something, or no way was found; says what would help.
    """
    began = time.perf_counter()
    check_ends(cell, move)
    given = move.path is not None or bool(move.via)
    if given and count == 1:
        return move, FirstPath("given" if move.path is not None else "straight", 0.0), []
    planner = cell.request.planner
    if planner == "ompl" and not ompl.installed():
        raise BadInput("--planner ompl: OMPL is not installed; pip install 'energy-opt[plan]'")
    start, goal = np.asarray(move.start, dtype=float), np.asarray(move.goal, dtype=float)
    robot = cell.robot
    ends = Ends.of(start, goal, robot.limits.lower, robot.limits.upper, robot.limits.velocity)
    room = Room(cell, np.stack([start, goal]))
    ways = find_ways(room, ends, steps(robot.body.tree()), planner=planner, seed=seed, count=count)
    if given:
        return move, FirstPath("given" if move.path is not None else "straight", 0.0), [way.path for way in ways]
    if not ways:
        if planner == "none":
            advice = "give --path, or --planner auto"
        elif ompl.installed():
            advice = "give --path, or another --seed"
        else:
            advice = "give --path, or install the extra that plans: pip install 'energy-opt[plan]'"
        raise Infeasible(f"the straight line is not free, and no way around was found; {advice}", limit="clearance")
    seconds = time.perf_counter() - began
    return replace(move, path=ways[0].path), FirstPath(ways[0].source, seconds), [way.path for way in ways[1:]]
