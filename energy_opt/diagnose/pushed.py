"""Runs in which something outside pushed the arm: torque in the joints' readings that neither motion nor friction has.

At rest dry friction may carry any part of a load, so only what lies beyond it counts there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from energy_opt.diagnose.joints import STILL, JointSide
from energy_opt.measured import MeasuredSet, coarse
from energy_opt.robot import Limits

LASTS = 0.3  # [s] over which a push is averaged
PUSH = 0.1  # of a joint's effort limit, from which torque of unknown origin is a push; links off by 10 % leave 0.06
BEYOND = 4.0  # times what the readings leave usually
LED, SURELY = 0.01, 5.0  # of the effort limit, half of usual dry friction; standard deviations
ENOUGH = 0.3  # of the runs in motion, that must be left to say anything


@dataclass(frozen=True)
class Push:
    """The strongest push of a run: its file, joint, torque [N m] and time [s in the run's file]."""

    run: int
    file: str
    joint: str
    torque: float


def pushes(side: JointSide, measured: MeasuredSet) -> list[Push]:
    """One for every run that was pushed; none where rows are too far apart to tell inertia from a push."""
    if any(coarse(run) for run in measured.runs):
        return []
    limits, joints = measured.robot.limits, measured.robot.joints
    led = _led(side, limits)
    if led is not None:
        j, torque = led
        moving = [k for k in np.unique(side.rows.run) if measured.runs[k].kind == "motion"]
        return [Push(int(k), measured.runs[k].file, joints[j], torque) for k in moving]
    excess = side.left.copy()
    carried = np.abs(np.nan_to_num(side.values[0]))
    still = np.abs(side.rows.v) < STILL
    excess = np.where(still, np.sign(excess) * np.maximum(np.abs(excess) - 1.5 * carried, 0.0), excess)
    excess = np.nan_to_num(excess)
    step = _step(side, measured)
    width = max(1, round(LASTS / step))
    slow = {int(r): _means(excess[side.rows.run == r], width) for r in np.unique(side.rows.run)}
    usual = 1.4826 * np.median(np.abs(np.concatenate(list(slow.values()))), axis=0)
    least = np.minimum(np.maximum(PUSH * limits.effort, BEYOND * usual), 2 * PUSH * limits.effort)
    out = []
    for r, own in slow.items():
        share = np.abs(own).max(axis=0) / least
        j = int(np.argmax(share))
        if share[j] > 1:
            out.append(Push(r, measured.runs[r].file, joints[j], float(np.abs(own[:, j]).max())))
    return out


def _led(side: JointSide, limits: Limits) -> tuple[int, float] | None:
    """A joint whose friction comes out negative, and by how much [N m]: a hand that leads the arm does its work."""
    for j in np.flatnonzero(side.known):
        friction, deviation = side.friction(int(j), float(side.usual[j]))
        if friction + SURELY * deviation < -LED * limits.effort[j]:
            return int(j), -friction
    return None


def _step(side: JointSide, measured: MeasuredSet) -> float:
    runs, counts = np.unique(side.rows.run, return_counts=True)
    return float(np.median([np.ptp(measured.runs[r].time) / k for r, k in zip(runs, counts, strict=True)]))


def _means(x: np.ndarray, width: int) -> np.ndarray:
    """Means (K', n) over `width` rows, or over all where there are fewer."""
    if len(x) <= width:
        return np.asarray(x.mean(axis=0, keepdims=True))
    total = np.vstack([np.zeros(x.shape[1]), np.cumsum(x, axis=0)])
    return np.asarray((total[width:] - total[:-width]) / width)


def free_runs(measured: MeasuredSet, found: list[Push]) -> tuple[MeasuredSet, bool]:
    """The set less the runs that were pushed, and whether enough is left; the whole set where not."""
    gone = {p.run for p in found}
    moving = [k for k, r in enumerate(measured.runs) if r.kind == "motion"]
    left = [k for k in moving if k not in gone]
    if not gone:
        return measured, True
    if len(left) < max(2, ENOUGH * len(moving)):
        return measured, False
    return replace(measured, runs=tuple(r for k, r in enumerate(measured.runs) if k not in gone)), True


def push_words(found: list[Push], enough: bool) -> list[str]:
    """What to say of them."""
    if not found:
        return []
    worst = max(found, key=lambda p: p.torque)
    what = f"{worst.torque:.3g} N m on {worst.joint} in {worst.file}"
    begin = (
        f"Something outside pushed the arm in {len(found)} run(s), which shows as torque without power (up to {what})"
    )
    if enough:
        return [f"{begin}: left out are {', '.join(p.file for p in found)}."]
    return [f"{begin}: no cause can be claimed of such a set. Record it with nobody and nothing touching the arm."]
