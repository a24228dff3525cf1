"""Distance from bodies at positions that are chosen: they keep the whole clearance wherever any positions can.

A motion whose given end is nearer keeps half of that end's distance. A choice must not make use of this: positions with
less than the clearance are chosen only if no others were found, and steps along a freedom then come no nearer.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from energy_opt.cell.cell import Cell

ERROR = 1e-6  # [m] by which distances at one pose of the tool may differ, as positions reach it with small errors


def is_free(cell: Cell | None, q: np.ndarray) -> bool:
    """True if nothing touches at q (n,)."""
    return cell is None or not cell.checks or cell.touching(q) is None


def keeps(cell: Cell | None, q: np.ndarray, before: np.ndarray) -> bool:
    """True if every pair of bodies keeps the clearance at q (n,), or is no nearer than at positions `before` (n,)."""
    if cell is None or not cell.checks:
        return True
    short = cell.short(q)
    if not short.any():
        return True
    return bool(np.isfinite(short).all() and (short <= cell.short(before) + ERROR).all())


def kept_by(q: np.ndarray, cell: Cell | None) -> np.ndarray:
    """Which of positions q (K, n) keep the clearance, (K,).

    If none does: which touch nothing and are no nearer to any body than those that lack the least.
    """
    if cell is None or not cell.checks or not len(q):
        return np.ones(len(q), dtype=bool)
    short = np.array([cell.short(row) for row in q])
    kept = ~short.any(axis=1)
    if not kept.any():
        kept = np.isfinite(short).all(axis=1) & (short <= short[np.argmin(short.sum(axis=1))] + ERROR).all(axis=1)
    return np.asarray(kept)


def nearer_words(ends: Iterable[tuple[str, np.ndarray, Cell | None]]) -> tuple[str, ...]:
    """What is said of chosen positions (n,) that do not keep the clearance: the name of the pose, positions, cell."""
    out = []
    for name, q, cell in ends:
        if cell is None or not cell.checks:
            continue
        short = cell.short(q)
        if short.any() and np.isfinite(short).all():
            a, b = cell.bodies.names(int(np.argmax(short)))
            distance = 1e3 * (cell.asked - short.max())
            out.append(
                f"{name}: no positions that reach it were found at which all bodies are {1e3 * cell.asked:g} mm apart; "
                f"at the chosen ones {a} is {distance:.3g} mm from {b}, of which half is kept"
            )
    return tuple(out)
