"""What a hypothesis leaves: the signals and joints that it goes with, and how many watts of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from energy_opt.diagnose.candidates import functions
from energy_opt.diagnose.fit import Fit, Free, fit
from energy_opt.diagnose.leftover import wandering
from energy_opt.diagnose.trace import Trace

WEAKEST = 0.05  # share of what is left that a signal must hold to be named
MOST = 8


def goes_with(found: Trace, joints: Sequence[str]) -> list[dict[str, Any]]:
    """Signals that what is left follows, strongest first, by the share of it that a free function of each holds.

    A share is what the function foresees of parts of runs that it was not fitted to, unless the search has taken it in.
    """
    if not found.follows or not (found.structured or found.best.free):
        return []
    f = _plain(found)
    samples = f.world.samples
    rest = f.residual * samples.weight
    open_part = max(float(rest @ rest) - len(rest) * found.noise.white**2, 1e-9)
    chosen = {g.signal for g in found.best.free}
    rows: list[dict[str, Any]] = []
    for g in functions(f):
        for joint, columns in _by_joint(g, samples.n):
            own = g.signal in chosen and (joint is None or columns.shape[1] == g.columns.shape[1])
            watts = _held(f, rest, columns, g.size) if own else _foreseen(f, rest, columns, g.size)
            strength = float(np.clip(watts**2 * len(rest) / open_part, 0.0, 1.0))
            if strength > WEAKEST:
                name = joints[joint] if joint is not None else None
                rows.append({"signal": g.signal, "joint": name, "strength": strength, "watts": watts, "setting": None})
    if wandering(f):
        apart = float(np.std(f.levels))
        rows.append({"signal": "time (run to run)", "joint": None, "strength": 1.0, "watts": apart, "setting": None})
    best: dict[tuple[str, str], dict[str, Any]] = {}
    for row in rows:
        key = str(row["signal"]), str(row["joint"])
        if key not in best or row["strength"] > best[key]["strength"]:
            best[key] = row
    return sorted(best.values(), key=lambda row: (row["signal"] not in chosen, -row["strength"]))[:MOST]


def _plain(found: Trace) -> Fit:
    """What is accepted, less its free functions: what they hold is part of what is left."""
    f = found.accepted
    if not f.free:
        return f
    return fit(f.world, f.nuisance, f.charts, list(f.numbers), (), f.amounts)


def _held(f: Fit, rest: np.ndarray, columns: np.ndarray, size: float) -> float:
    """Rms [W] of what a free function takes away where it is fitted: the search has judged it already."""
    columns = columns * f.world.samples.weight[:, None]
    before = (f.world.whiten.noise.white / size) ** 2 * np.eye(columns.shape[1])
    weights = np.linalg.solve(columns.T @ columns + before, columns.T @ rest)
    return float(np.sqrt(max(np.sum(rest**2) - np.sum((rest - columns @ weights) ** 2), 0.0) / len(rest)))


def _by_joint(g: Free, n: int) -> list[tuple[int | None, np.ndarray]]:
    """The function of all joints; of single ones where the signal is a joint's."""
    if g.signal.startswith("time") or g.columns.shape[1] % n or g.signal == "temperature":
        return [(None, g.columns)]
    count = g.columns.shape[1] // n
    return [(j, g.columns[:, j * count : (j + 1) * count]) for j in range(n)]


def _foreseen(f: Fit, rest: np.ndarray, columns: np.ndarray, size: float) -> float:
    """Rms [W] of what a free function takes away in quarters of every run that it was not fitted to."""
    samples = f.world.samples
    columns = columns * samples.weight[:, None]
    half = np.concatenate([(np.arange(p.stop - p.start) * 4 // max(p.stop - p.start, 1)) % 2 for p in samples.parts])
    noise, gained = f.world.whiten.noise.white, 0.0
    for part in (0, 1):
        fitted, judged = half == part, half != part
        own = columns[fitted]
        weights = np.linalg.solve(own.T @ own + (noise / size) ** 2 * np.eye(own.shape[1]), own.T @ rest[fitted])
        gained += float(np.sum(rest[judged] ** 2) - np.sum((rest[judged] - columns[judged] @ weights) ** 2))
    return float(np.sqrt(max(gained, 0.0) / len(rest)))
