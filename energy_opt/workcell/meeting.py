"""Times at which two steps of two arms may not meet: a guess from samples, which the proof confirms or widens."""

from __future__ import annotations

import numpy as np

from energy_opt.cell.bodies import Scenery
from energy_opt.workcell.between import TwoArms
from energy_opt.workcell.motion import Part

SAMPLES = 40  # samples of each of the two motions
MARGIN = 0.01  # [m] nearer poses count as touching
STEP = 1 / (SAMPLES - 1)
Shares = tuple[float, float]


def meeting(arms: TwoArms, one: Part, two: Part) -> tuple[Shares | None, Shares | None]:
    """The parts of two steps that may not happen at the same time, as shares of the steps' durations.

    None represents a whole step: for a wait, or if samples find nothing near.
    """
    waits = [np.ptp(part.trajectory.position, axis=0).max() == 0 for part in (one, two)]
    shares = [np.array([0.5]) if wait else np.linspace(0, 1, SAMPLES) for wait in waits]
    poses = [
        part.trajectory(part.trajectory.time[0] + share * part.trajectory.duration)
        for part, share in zip((one, two), shares, strict=True)
    ]
    k, m = (x.ravel() for x in np.meshgrid(*(np.arange(len(x)) for x in shares), indexing="ij"))
    near = _near(arms, np.hstack([poses[0][k], poses[1][m]]))
    if not near.any():
        return None, None
    out = [
        None if wait else (max(0.0, share[i[near]].min() - STEP), min(1.0, share[i[near]].max() + STEP))
        for wait, share, i in zip(waits, shares, (k, m), strict=True)
    ]
    return out[0], out[1]


def _near(arms: TwoArms, q: np.ndarray) -> np.ndarray:
    """(N,) True for configurations (N, n) of the two arms with a pair of bodies nearer than `MARGIN`."""
    scene = Scenery(arms.bodies, q)
    pairs = len(arms.bodies.pairs)
    k, p = np.repeat(np.arange(len(q)), pairs), np.tile(np.arange(pairs), len(q))
    floor, _, _ = scene.apart(k, p)
    near = np.zeros(len(q), dtype=bool)
    for i in np.flatnonzero(floor < MARGIN).tolist():
        at, pair = int(k[i]), int(p[i])
        if near[at]:
            continue
        a, b = arms.bodies.pairs[pair].tolist()
        near[at] = arms.bodies.ruler(pair).near(scene.placed(at, a), scene.placed(at, b)) < MARGIN
    return near
