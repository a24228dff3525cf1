"""The best timing of a move's first path, for moves whose other paths cost too much under some model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from energy_opt.errors import BadInput, Infeasible
from energy_opt.motion.move import Move
from energy_opt.motion.plan.context import path_of
from energy_opt.motion.plan.planner import Planner
from energy_opt.motion.result import Result


def retimed(planner: Planner, move: Move, result: Result, solve: Callable[[Move], Result]) -> Result | None:
    """The result of a reshaped move with the best timing of its first path, by `solve`.

    None if no timing keeps the limits, or if the search may take only a limited time.
    """
    if move.mode == "retime" or move.via or result.interrupted or planner.settings.deadline is not None:
        return None
    path = path_of(planner.first_path(move)[0])
    try:
        timed = solve(replace(move, mode="retime", path=path))
    except (BadInput, Infeasible):  # a limit that no timing keeps
        return None
    found = planner.with_trajectory(result, move, timed.trajectory)
    message = "no other path that was found is cheaper under every model"
    return replace(found, chosen="retime", message=message) if found.certificate.valid else None
