"""Cutting one long recording into runs where the arm is at rest."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from energy_opt.measured.run import Run

STILL_SPEED = 0.01  # [rad/s] below this, over `SHORTEST`, the arm is at rest
SHORTEST = 0.25  # [s] a shorter halt does not part two runs
LONG = 1.5  # [s] a standstill this long is a static run of its own
MARGIN = 0.15  # [s] of it left to the motions on either side
FEW_READINGS = 4  # of the meter that a piece has at least
MOVES = 0.005  # [rad] a piece in which no joint moves further is static
FEWEST_SAMPLES = 8  # joint samples a piece has beyond its first


def is_at_rest(time: np.ndarray, position: np.ndarray) -> bool:
    """Whether no joint moves further than `MOVES` over samples (N,), (N, n); noise of single samples is no motion."""
    wide = max(1, min(len(time), round(0.1 / max(float(np.median(np.diff(time))), 1e-9)))) if len(time) > 1 else 1
    sums = np.cumsum(np.vstack([np.zeros(position.shape[1]), position - position[0]]), axis=0)
    return bool(np.ptp((sums[wide:] - sums[:-wide]) / wide, axis=0).max() <= MOVES)


def standstills(time: np.ndarray, position: np.ndarray) -> list[tuple[int, int]]:
    """Index ranges [first, last] in which no joint moves for at least `SHORTEST`.

    Speed is the slope over a window of about 0.1 s, so that encoder steps do not count as motion.
    """
    step = float(np.median(np.diff(time)))
    half = max(1, round(0.05 / step))
    lo = np.clip(np.arange(len(time)) - half, 0, None)
    hi = np.clip(np.arange(len(time)) + half, None, len(time) - 1)
    speed = np.abs(position[hi] - position[lo]).max(axis=1) / (time[hi] - time[lo])
    still = np.concatenate([[False], speed < STILL_SPEED, [False]])
    edges = np.flatnonzero(np.diff(still.astype(int)))
    pairs = zip(edges[::2], edges[1::2] - 1, strict=True)
    return [(int(a), int(b)) for a, b in pairs if time[b] - time[a] >= SHORTEST]


def cut_at_standstill(run: Run) -> list[Run]:
    """The pieces of a recording; long standstills become static runs, everything else motion runs.

    No piece is left with fewer readings of the meter than `FEW_READINGS`: a slow meter's recording is cut less often.
    """
    begin, end = run.power_time - run.window, run.power_time

    def enough(first: int, last: int, whole: bool = False) -> bool:
        below = int(np.searchsorted(begin if whole else end, run.time[first]))
        return not len(end) or int(np.searchsorted(end, run.time[last], side="right")) - below >= FEW_READINGS

    cuts: list[int] = [0]
    final = len(run.time) - 1
    margin = max(1, round(MARGIN / float(np.median(np.diff(run.time)))))
    for first, last in standstills(run.time, run.position):
        low, high, middle = first + margin, last - margin, (first + last) // 2
        if run.time[last] - run.time[first] >= LONG and enough(low, high, whole=True):
            if first > 0 and enough(cuts[-1], low):
                cuts.append(low)
            if last < final and enough(high, final):
                cuts.append(high)
        elif enough(cuts[-1], middle) and enough(middle, final):
            cuts.append(middle)
    cuts = sorted({*cuts, final})
    return pieces(run, [(a, b) for a, b in pairwise(cuts) if b - a >= FEWEST_SAMPLES])


def pieces(run: Run, spans: Sequence[tuple[int, int]], strict: bool = False) -> list[Run]:
    """Parts of a run between joint samples, first and last included.

    Every reading goes to one piece: a still one takes those whose window lies in it; of the rest each goes where most
    of its window lies, and that piece's joint samples reach back as far as the window does. Where `strict`, readings
    whose window lies in no piece are left out.
    """
    still = [is_at_rest(run.time[a : b + 1], run.position[a : b + 1]) for a, b in spans]
    end = run.power_time
    begin = np.maximum.accumulate(end - run.window) if len(end) else end
    most, owner = np.full(len(end), -np.inf), np.full(len(end), -1)
    for k, (a, b) in enumerate(spans):
        low, high = run.time[a], run.time[b]
        near = slice(int(np.searchsorted(end, low - 1e-9)), int(np.searchsorted(begin, high, side="right")))
        shared = np.minimum(end[near], high) - np.maximum(begin[near], low)
        whole = (begin[near] >= low - 1e-9) & (end[near] <= high + 1e-9)
        shared = np.where(whole | ((shared > 0) & (not strict and not still[k])), shared, -np.inf)
        better = shared > most[near]
        most[near], owner[near] = np.where(better, shared, most[near]), np.where(better, k, owner[near])
    by_owner = np.argsort(owner, kind="stable")
    edges = np.searchsorted(owner[by_owner], np.arange(len(spans) + 1))
    out: list[Run] = []
    for k, (a, b) in enumerate(spans):
        readings = by_owner[edges[k] : edges[k + 1]]
        if len(end) and not readings.size:
            continue
        if readings.size and not strict:
            a = min(a, max(0, int(np.searchsorted(run.time, begin[readings].min(), side="right")) - 1))
            b = max(b, min(len(run.time) - 1, int(np.searchsorted(run.time, end[readings[-1]], side="left"))))
        out.append(
            _piece(run, a, b, readings, (run.kind if strict else "static" if still[k] else "motion"), len(out) + 1)
        )
    return out


def _piece(run: Run, first: int, last: int, readings: np.ndarray, kind: str, number: int) -> Run:
    samples = slice(first, last + 1)
    joints: dict[str, Any] = {name: values[samples] for name, values in run.joint_signals()}
    zero = float(run.time[first])
    return dataclasses.replace(
        run,
        file=f"{run.file}#{number}",
        kind=kind,
        start=run.start + zero,
        time=run.time[samples] - zero,
        lines=run.lines[samples],
        logged=run.logged_at(samples),
        power_time=run.power_time[readings] - zero,
        power=run.power[readings],
        window=run.window[readings],
        **joints,
    )
