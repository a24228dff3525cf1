"""Artefacts of recorders: angles that wrap, samples that repeat a reading until the next one comes, and spikes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from energy_opt.formats.waypoints import FEWEST, KINDS, Samples
from energy_opt.numerics.signals import SHORTEST
from energy_opt.numerics.turns import without, wraps

EVENLY = 0.9  # least share of the readings that repeat equally often, if a slower source was recorded
LEAP, UNUSUAL = 15.0, 10.0  # [rad/s, m/s] least speed into a spike and out of it, and times the median step
SPIKE, FEW = 0.1, 0.03  # [s] longest spike; largest share of the samples in spikes


def as_moved(samples: Samples) -> tuple[Samples, tuple[str, ...]]:
    """Samples without wraps of angles, repeated readings and spikes, and notes. Plans are taken as they are."""
    if samples.planned:
        return samples, ()
    notes: list[str] = []
    for repair in (_unwrapped, _once, _without_spikes):
        samples, note = repair(samples)
        notes += note
    return samples, tuple(notes)


def _unwrapped(samples: Samples) -> tuple[Samples, tuple[str, ...]]:
    """Samples whose positions pass from pi to -pi, and back, without a jump."""
    q = samples.position
    if samples.time is None or len(q) < FEWEST:
        return samples, ()
    turns = wraps(samples.time, q)
    if not turns.any():
        return samples, ()
    names = ", ".join(samples.joints[k] for k in np.flatnonzero(np.abs(turns).sum(axis=0)))
    note = f"{samples.where}: the angle of {names} jumps by a turn within a sample: it is taken to pass on"
    return replace(samples, position=without(turns, q)), (note,)


def _once(samples: Samples) -> tuple[Samples, tuple[str, ...]]:
    """Samples without those that repeat the reading of a slower source; those of an arm at rest stay."""
    if samples.time is None:
        return samples, ()
    new = np.concatenate([[True], (np.diff(samples.position, axis=0) != 0).any(axis=1)])
    first = np.flatnonzero(new)
    count = np.diff(first)  # of samples with the same reading
    moving = count[np.diff(samples.time[first]) < SHORTEST]
    usual = float(np.median(moving)) if len(moving) >= FEWEST else 1.0
    if usual < 2 or np.mean(np.abs(moving - usual) <= 1) < EVENLY:
        return samples, ()
    last = np.flatnonzero(np.append(new[1:], True))
    lasts = last[samples.time[last] - samples.time[first] >= SHORTEST]  # the ends of rests
    note = f"{samples.where}: readings change at every {usual:g}th sample only; those between are left out"
    return _some(samples, np.union1d(first, lasts)), (note,)


def _without_spikes(samples: Samples) -> tuple[Samples, tuple[str, ...]]:
    """Samples without the few that are far away for a moment: lost readings, often zeros."""
    if samples.time is None or len(samples.time) < FEWEST:
        return samples, ()
    q, step = samples.position, np.abs(np.diff(samples.position, axis=0)).max(axis=1)
    far = step > np.maximum(LEAP * np.diff(samples.time), UNUSUAL * np.median(step))
    keep, leaps = np.ones(len(q), dtype=bool), np.flatnonzero(far)
    for out, back in zip(leaps, leaps[1:], strict=False):
        brief = samples.time[back] - samples.time[out] <= SPIKE
        if keep[out] and brief and np.abs(q[back + 1] - q[out]).max() < 0.5 * min(step[out], step[back]):
            keep[out + 1 : back + 1] = False
    lost = int((~keep).sum())
    if lost == 0 or lost > max(1.0, FEW * len(q)):
        return samples, ()
    note = f"{samples.where}: samples are far from those around them ({lost}, the first at "
    note += f"{samples.time[np.argmin(keep)]:.6g} s) and are left out"
    return _some(samples, np.flatnonzero(keep)), (note,)


def _some(samples: Samples, which: np.ndarray) -> Samples:
    """Some of the samples."""
    assert samples.time is not None
    blocks: dict[str, Any] = {kind: block[which] for kind in KINDS if (block := getattr(samples, kind)) is not None}
    return replace(samples, time=samples.time[which], **blocks)
