"""How low a convex body can come over a plane within an interval: a bound of second order in the joints' turns.

Bodies that pass each other closely move along each other, not towards each other: their points travel far, their
distance hardly changes. For a unit vector n fixed in body b, the bodies are apart by at least

    s(q) = min over vertices v of a: n·p_v(q)  -  max over vertices of b: n·p

whichever n is; the normal between their nearest points is a good one. With w_vj the velocity that joint j gives vertex
v, n·p_v changes by n·w_vj per turn of j, and by Taylor's theorem, for turns of at most far_j about the middle,

    s(q) >= min_v (n·p_v - sum_j |n·w_vj| far_j) - max_b - T F

where T bounds how far points of a travel and F is the sum of far_j over joints that turn: second derivatives are
n·(z_i x w_vj), at most |w_vj| in size, and the sum of far_j |w_vj| is at most T everywhere in the interval. Joints that
follow others count in T and F as if each moved by itself, as far as its leader takes it; in the sum over j they are
part of their leader's velocity w_vj.
"""

from __future__ import annotations

import numpy as np

from energy_opt.cell.bodies import Bodies, Scenery
from energy_opt.robot.kinematics import into

ROUNDING = 1e-9  # [m] that arithmetic may have added


def turns(bodies: Bodies, pair: np.ndarray, far: np.ndarray) -> np.ndarray:
    """F (M,) [rad]: the sum over joints between the bodies of pairs (M,) of how far each may turn, far (M, L)."""
    return np.asarray(np.sum(far * (bodies.moves[0][pair] & ~bodies.kinematics.prismatic), axis=1))


def least_heights(
    scene: Scenery, k: np.ndarray, pair: np.ndarray, normal: np.ndarray, far: np.ndarray, rest: np.ndarray
) -> np.ndarray:
    """Lower bounds (M,) [m] of pairs' distances within intervals about configurations k (M,).

    Args:
        pair: (M,) of those that are `usable`.
        normal: (M, 3) unit vectors in the base frame, from the second body towards the first.
        far: (M, n) [rad, m] how far the joints that move by themselves go from the middle.
        rest: (M,) [m] T F.
    """
    bodies, poses = scene.bodies, scene.poses
    slides, (a, b) = bodies.kinematics.prismatic, bodies.pairs[pair].T
    ja, jb = bodies.joint[a], bodies.joint[b]
    flat = bodies.flat[b]  # a half-space is its own plane
    own = np.matmul(poses.rotation[k[flat], jb[flat]], bodies.rotation[b[flat]][:, :, 2, None])[..., 0]
    normal = normal.copy()
    normal[flat] = own
    turn, at, axis = poses.rotation[k, ja], poses.origin[k, ja], poses.axis[k]
    x, y, z = normal.T[:, :, None]
    lever = np.stack(  # n·(axis x r) = (n x axis)·r
        [y * axis[..., 2] - z * axis[..., 1], z * axis[..., 0] - x * axis[..., 2], x * axis[..., 1] - y * axis[..., 0]],
        axis=2,
    )
    level = np.sum(lever * (at[:, None] - poses.origin[k, :-1]), axis=2)
    level[:, slides] = np.matmul(axis[:, slides], normal[:, :, None])[..., 0]
    lever[:, slides] = 0.0
    between, coupling = bodies.moves[0][pair], bodies.kinematics.coupling
    level = coupling.joined(level * between)
    lever, share = coupling.joined(np.matmul(lever, turn) * between[:, :, None], axis=1), far[:, None]
    up_a, up_b = into(turn, normal), into(poses.rotation[k, jb], normal)
    out = np.sum(normal * (at - poses.origin[k, jb]), axis=1) - rest - ROUNDING
    order = np.argsort(pair, kind="stable")
    for some in np.split(order, np.flatnonzero(np.diff(pair[order])) + 1) if len(order) else []:
        points, radius = bodies.corners_of(int(a[some[0]]))
        support, more = bodies.corners_of(int(b[some[0]]))
        slope = np.abs(lever[some] @ points.T + level[some, :, None])  # (M, n, V)
        low = (up_a[some] @ points.T - np.matmul(share[some], slope)[:, 0]).min(axis=1)
        out[some] += low - (up_b[some] @ support.T).max(axis=1) - radius - more
    return np.asarray(out)
