"""A trajectory that is given without a duration is answered at its own: its user asks what that costs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from energy_opt.errors import Infeasible
from energy_opt.motion import Move, Result
from energy_opt.motion.move import LONGEST, SHORTEST


def at_input_time(move: Move, objective: str = "energy") -> Move:
    """The move at the duration of the given trajectory, where neither a duration nor a bound of it was asked for."""
    free = move.duration is None and move.max_duration is None
    if move.input is None or not free or objective == "time" or not SHORTEST <= move.input.duration <= LONGEST:
        return move
    return replace(move, duration=move.input.duration)


def solved(solve: Callable[[Move], Result], move: Move, asked: Move) -> tuple[Result, Move]:
    """The move solved, and as it was solved: where the given trajectory is too fast for the limits, its time is free.

    Args:
        move: see `at_input_time`. asked: as it was asked for.

    Raises:
        Infeasible: no motion holds the limits.
    """
    try:
        return solve(move), move
    except Infeasible as error:
        if move == asked or error.shortest_duration is None:
            raise
        said = f"the {move.duration:.4g} s of the given trajectory are too short ({error}); the duration is free"
    result = solve(asked)
    return replace(result, warnings=(*result.warnings, said)), asked
