"""The errors of moves that cannot be as fast as requested, or that no duration makes possible."""

from __future__ import annotations

from typing import cast

from energy_opt.errors import Infeasible, at_least
from energy_opt.motion.judge.certificate import Certificate
from energy_opt.motion.move import Move


def too_short(move: Move, shortest: float, certificate: Certificate) -> Infeasible:
    """The error of a move whose duration is below the `shortest` [s] that was found; `certificate`: of that one."""
    wanted = move.longest
    worst = certificate.binding
    return Infeasible(
        f"a duration of {wanted:.6g} s is too short: the shortest found is {at_least(shortest)} s, where the "
        f"{worst['limit']} limit of {worst['joint']} binds at {worst['time']:.4g} s",
        joint=str(worst["joint"]),
        limit=str(worst["limit"]),
        time=cast(float, worst["time"]),
        excess=shortest / float(wanted or shortest) - 1,
        shortest_duration=shortest,
    )


def below_bound(move: Move, limit: str, where: str, least: float, shortest: float | None) -> Infeasible:
    """The error of a move whose duration is below what a limit requires for any path.

    Args:
        limit, where: its name, and what it limits. least: that bound [s].
        shortest: [s] of a valid motion; None if none is known.
    """
    wanted = float(move.longest or least)
    valid = "" if shortest is None else f"; the first path takes {at_least(shortest)} s"
    if shortest is not None and move.mode == "reshape":
        valid += ", others may take less: see --objective time"
    return Infeasible(
        f"a duration of {wanted:.6g} s is too short: the {limit} limit of {where} requires at least "
        f"{at_least(least)} s on any path{valid}",
        joint=where,
        limit=limit,
        excess=least / wanted - 1,
        shortest_duration=shortest,
    )


def never_held(certificate: Certificate) -> Infeasible:
    """The error of a move that breaks a limit however slow it is; `certificate`: of a slow motion."""
    worst = certificate.worst
    return Infeasible(
        f"{worst['joint']}: the {worst['limit']} limit {worst['bound']:.4g} cannot be held even by a slow move "
        f"(value {worst['value']:.4g} at {worst['time']:.4g} s)",
        joint=str(worst["joint"]),
        limit=str(worst["limit"]),
        time=cast(float, worst["time"]),
    )
