"""Whole turns of revolute joints, of positions that follow each other: each turn costs travel, where limits allow it.

Of each branch of a pose one turn is known. Which turn of a joint is best depends on where the arm comes from and where
it goes: branches are compared at the turns that are nearest to each other, and the chosen chain is turned as a whole.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations, product

import numpy as np

from energy_opt.poses.inverse import TURN, ToolKinematics, other_turns

TURNS = (0, -1, 1)  # whole turns to try
TURNED = 3  # most joints that are turned together: both turns of joints that travel about half a turn are alike
ROUNDS = 6  # most rounds of `turned`
Travel = tuple[float, tuple[float, ...]]  # travel [rad, m] of a joint, and its positions
HIGHER = 1e-6  # among chains of equal travel that nearer to zero is taken


def nearest_pairs(
    tool: ToolKinematics, a: np.ndarray, b: np.ndarray, a_turns: np.ndarray, b_turns: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of positions (P, n), each joint turned within its limits to where both are nearest to each other.

    Args:
        tool: for its joints. a, b: (P, n) [rad, m]. a_turns, b_turns: (P,) which of them may be turned.
    """
    shifted = [
        [(k == 0 or may[:, None], _shifted(tool, q, k)) for k in TURNS] for q, may in ((a, a_turns), (b, b_turns))
    ]
    for (may, at), (may_too, there) in product(*shifted):
        nearer = may & may_too & (np.abs(at - there) < np.abs(a - b) - HIGHER)
        a, b = np.where(nearer, at, a), np.where(nearer, there, b)
    return a, b


def unwound(
    tool: ToolKinematics, chain: Sequence[np.ndarray], turning: Sequence[bool], closed: bool
) -> list[np.ndarray]:
    """The positions (n,) of a chain, each joint turned within its limits to where it travels least in total.

    Args:
        tool: for its joints. chain: positions. turning: which of them may be turned. closed: the last leads to the
            first.
    """
    sets = [
        np.array([_shifted(tool, q, k) for k in (TURNS if may else TURNS[:1])])
        for q, may in zip(chain, turning, strict=True)
    ]
    out = np.array(chain, dtype=float)
    for j in range(out.shape[1]):
        first, *rest = ([float(x) for x in at[:, j] if not np.isnan(x)] for at in sets)
        found: list[Travel] = []
        for x in first:
            paths: list[Travel] = [(HIGHER * abs(x), (x,))]
            for at in rest:
                paths = [min((cost + abs(y - path[-1]) + HIGHER * abs(y), (*path, y)) for cost, path in paths)
                         for y in at]  # fmt: skip
            found += [(cost + closed * abs(path[-1] - x), path) for cost, path in paths]
        out[:, j] = min(found)[1]
    return list(out)


def turned(
    tool: ToolKinematics,
    chain: Sequence[np.ndarray],
    turning: Sequence[bool],
    cheapest: Callable[[list[np.ndarray]], Sequence[int]],
) -> list[np.ndarray]:
    """The positions (n,) of a chain, turned as long as that costs less: in a round one joint of each by a whole turn.

    Args:
        tool: for its joints. chain: positions. turning: which of them may be turned.
        cheapest: the choice of one of several positions (K, n) for each of the chain.
    """
    best = list(chain)
    for _ in range(ROUNDS):
        sets = [np.vstack([q, other_turns(q, None, tool)]) if may else q[None]
                for q, may in zip(best, turning, strict=True)]  # fmt: skip
        chosen = cheapest(sets) if max(map(len, sets)) > 1 else ()
        if not any(chosen):
            break
        best = [at[k] for at, k in zip(sets, chosen, strict=True)]
    return best


def with_turns(tool: ToolKinematics, q: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Positions (K, n) within the limits: q (n,) first, then with up to `TURNED` joints turned to the other side.

    Args:
        tool: for its joints. q: the turns of its joints are those nearest to `near` (n,), whose other side it is.
    """
    one = other_turns(q, near, tool) - q
    return np.array([q + sum(some) for count in range(TURNED + 1) for some in combinations(one, count)])


def _shifted(tool: ToolKinematics, q: np.ndarray, turns: int) -> np.ndarray:
    """Positions (..., n) after whole turns of revolute joints; not a number where a joint leaves its limits."""
    at = q + TURN * turns * tool.turning
    inside = (at >= tool.robot.limits.lower) & (at <= tool.robot.limits.upper)
    return np.where(inside | (turns == 0), at, np.nan)
