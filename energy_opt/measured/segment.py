"""Cutting one long recording into runs where the arm stands still."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from energy_opt.measured.sets import Run

STILL_SPEED = 0.01  # [rad/s] below this, over `SHORTEST`, the arm stands still
SHORTEST = 0.25  # [s] a shorter halt does not part two runs
LONG = 1.5  # [s] a standstill this long is a static run of its own


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
    """The pieces of a recording; long standstills become static runs, everything else motion runs."""
    cuts: list[int] = [0]
    for first, last in standstills(run.time, run.position):
        if run.time[last] - run.time[first] >= LONG:
            margin = max(1, round(0.15 / float(np.median(np.diff(run.time)))))
            cuts += [first + margin, last - margin]
        else:
            cuts.append((first + last) // 2)
    cuts = sorted({*cuts, len(run.time) - 1})
    pieces: list[Run] = []
    for first, last in zip(cuts[:-1], cuts[1:], strict=True):
        if last - first >= 8:
            pieces.append(_piece(run, first, last, len(pieces) + 1))
    return pieces


def _piece(run: Run, first: int, last: int, number: int) -> Run:
    rows = slice(first, last + 1)
    zero = float(run.time[first])
    of_power = (run.power_time >= zero) & (run.power_time <= run.time[last])
    moving = np.ptp(run.position[rows], axis=0).max() > 0.005

    def cut(x: np.ndarray | None) -> np.ndarray | None:
        return None if x is None else x[rows]

    return dataclasses.replace(
        run,
        file=f"{run.file}#{number}",
        kind="motion" if moving else "static",
        start=run.start + zero,
        time=run.time[rows] - zero,
        position=run.position[rows],
        velocity=cut(run.velocity),
        acceleration=cut(run.acceleration),
        effort=cut(run.effort),
        temperature=cut(run.temperature),
        power_time=run.power_time[of_power] - zero,
        power=run.power[of_power],
    )
