"""The least distance of bodies during a motion, measured at instants.

A proof measures only pairs that may be too near.
"""

from __future__ import annotations

import numpy as np

from energy_opt.cell.bodies import Bodies, Scenery
from energy_opt.cell.curve import MotionCurve
from energy_opt.cell.proof import Touch

INSTANTS = 33  # of the whole motion, and again around the nearest of these


def nearest(bodies: Bodies, curve: MotionCurve, close: float | None = None) -> Touch | None:
    """The pair that is nearest in all of `curve`, to the density of the instants; no body may be inside another one.

    Args:
        close: s from the begin of the curve, an instant at which a proof came near its bound; it is measured, too.

    Returns:
        The pair, its instant and distance; None if there are no pairs.
    """
    begin, end = float(curve.time[0]), float(curve.time[-1])
    known = [] if close is None else [float(np.clip(begin + close, begin, end))]
    found = _nearer(bodies, curve, np.union1d(np.linspace(begin, end, INSTANTS), known), np.inf)
    if found is None:
        return None
    around = found.time + np.linspace(-1, 1, INSTANTS) * (end - begin) / (INSTANTS - 1)
    return _nearer(bodies, curve, np.unique(around.clip(begin, end)), found.distance) or found


def _nearer(bodies: Bodies, curve: MotionCurve, time: np.ndarray, below: float) -> Touch | None:
    """The nearest pair at times (K,) [s]; None if none is nearer than `below` [m]."""
    scene, pairs, least, found = Scenery(bodies, curve.positions(time)), bodies.pairs, below, None
    frames, normals = (scene.poses.rotation, scene.poses.origin), np.zeros((len(time), len(pairs), 3))
    bound = np.nan_to_num(bodies.hulls.apart(*frames, pairs[:, 0], pairs[:, 1], least, normals), nan=-np.inf)
    for i in np.argsort(bound, axis=None).tolist():  # hulls are not farther apart than what they contain
        k, p = divmod(i, len(pairs))
        if bound[k, p] >= least:
            break
        ruler, at, bt = bodies.ruler(p), *(scene.placed(k, body) for body in pairs[p].tolist())
        distance = ruler.near(at, bt)
        if not ruler.convex and distance < least:  # from the cheapest measure to the exact one
            distance = ruler.mid(at, bt) if ruler.cut else distance
            distance = ruler.exact(at, bt) if distance < least else distance
        if distance < least:
            least, found = distance, Touch(float(time[k]), p, distance)
    return found
