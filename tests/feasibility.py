"""Can a move be done at all? Asked a second time, of `independent.py`'s arm and linear programs, without the package.

Along a given path, joint torques are linear in the squared speed b of the path parameter and in its acceleration
u = b' / 2 (Verscheure et al., IEEE TAC 54(10), 2009): whether there is any timing is a linear program. Where the path
is free, the poses in which the arm can hold itself are searched by two trees that grow towards each other (RRT-Connect:
Kuffner, LaValle, ICRA 2000): between such poses a move slow enough is always possible.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from independent import Arm
from scipy.optimize import linprog

STEPS = 80  # intervals of a path
STRIDE = 0.15  # [rad, m] of a tree's branch
TRIES = 800  # branches
HELD = 1e-6  # of an effort: what the certificate lets pass


def line_has_timing(arm: Arm, bounds: Mapping[str, np.ndarray], start: np.ndarray, goal: np.ndarray) -> bool:
    """Is there any timing of the straight line from rest to rest within speeds, accelerations and efforts?"""
    way = goal - start
    if not np.abs(way).max() > 0:
        return holds(arm, bounds, start[None])[0]
    s = np.linspace(0, 1, STEPS + 1)
    q = start + s[:, None] * way
    flat, along = np.zeros_like(q), np.broadcast_to(way, q.shape)
    g = arm.torque(q, flat, flat)
    m, c = arm.torque(q, flat, along) - g, arm.torque(q, along, flat) - g
    # b in units of about the largest that speeds, accelerations and efforts allow: tiny and long moves scale alike.
    length = np.maximum(np.abs(way), 1e-300)
    pushed = np.min((bounds["effort"] - np.abs(g)) / np.maximum(np.abs(m), 1e-300), axis=1)
    most = float(min(np.min((bounds["velocity"] / length) ** 2), np.min(bounds["acceleration"] / length),
                     np.median(np.maximum(pushed, 1e-300))))  # fmt: skip
    rows, right = [], []

    def bounded(value: np.ndarray, slope: np.ndarray, rest: np.ndarray, bound: np.ndarray, at: int, k: int) -> None:
        """-bound <= value b_at + slope u_k + rest <= bound for every joint."""
        for sign in (1.0, -1.0):
            for j in range(len(bound)):
                row = np.zeros(STEPS + 2)
                row[at] += value[j] * most / bound[j]
                row[k + 1] += slope[j] * most * STEPS / 2 / bound[j]
                row[k] -= slope[j] * most * STEPS / 2 / bound[j]
                rows.append(sign * row)
                right.append(1 + HELD - sign * rest[j] / bound[j])

    for k in range(STEPS):
        for at in (k, k + 1):
            bounded(c[at], m[at], g[at], bounds["effort"], at, k)
            bounded(np.zeros(len(way)), way, np.zeros(len(way)), bounds["acceleration"], at, k)
    for k in range(1, STEPS):  # the least speed on the way is to be as large as it can be: the last variable
        row = np.zeros(STEPS + 2)
        row[k], row[-1] = -1.0, 1.0
        rows.append(row)
        right.append(0.0)
    cost = np.zeros(STEPS + 2)
    cost[-1] = -1.0
    ends = [(0.0, 0.0)]
    found = linprog(cost, np.array(rows), np.array(right), bounds=[*ends, *[(0.0, 1.0)] * (STEPS - 1), *ends, (0, 1)])
    return bool(found.status == 0 and -found.fun > 1e-6)


def holds(arm: Arm, bounds: Mapping[str, np.ndarray], q: np.ndarray, spare: float = 0.0) -> np.ndarray:
    """Which poses (M, n) are within the joints' ranges and can be held with such a share of the effort to spare."""
    flat = np.zeros_like(q)
    inside = np.all((q >= bounds["lower"] - 1e-9) & (q <= bounds["upper"] + 1e-9), axis=1)
    load = np.abs(arm.torque(q, flat, flat)) / bounds["effort"]
    return np.asarray(inside & (load.max(axis=1) <= 1 + HELD - spare))


def some_path(arm: Arm, bounds: Mapping[str, np.ndarray], start: np.ndarray, goal: np.ndarray, seed: int) -> bool:
    """Is there any path of poses that the arm can hold, found within some hundred branches of two trees?"""
    rng = np.random.default_rng(seed)
    low, high = np.maximum(bounds["lower"], -np.pi), np.minimum(bounds["upper"], np.pi)

    def clear(a: np.ndarray, b: np.ndarray) -> bool:
        return bool(holds(arm, bounds, a + np.linspace(0, 1, 8)[1:, None] * (b - a), 1e-3).all())

    def grow(tree: list[np.ndarray], to: np.ndarray) -> np.ndarray | None:
        """The tree's new leaf towards `to`."""
        near = tree[int(np.argmin([np.abs(x - to).max() for x in tree]))]
        step = to - near
        new = near + step * min(1.0, STRIDE / max(np.abs(step).max(), 1e-12))
        if not clear(near, new):
            return None
        tree.append(new)
        return new

    a, b = [start], [goal]
    for _ in range(TRIES):
        leaf = grow(a, rng.uniform(low, high))
        while leaf is not None:
            other = grow(b, leaf)
            if other is None:
                break
            if np.abs(other - leaf).max() < 1e-9:
                return True
        a, b = b, a
    return False
