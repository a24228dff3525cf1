"""Motions and paths from samples, without the noise of a recording and the rounding of close waypoints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from energy_opt.effects.parameter import MOVING_SPEED
from energy_opt.formats.waypoints import Samples
from energy_opt.motion.path import JointPath, of_trajectory, through
from energy_opt.motion.standing import check_moves_on
from energy_opt.motion.trajectory import Trajectory
from energy_opt.numerics.bspline import DEGREE, Basis
from energy_opt.numerics.signals import SHORTEST, smooth, standstills

CUTOFF = 10.0  # [Hz] cut-off frequency for recorded positions
# A joint is noisy if its accelerations exceed those of the smoothed positions by this factor, and if fourth differences
# exceed third ones by that: 1.9 for white noise, far less for smooth motion, also with a few jumps of acceleration.
NOISY, WHITE = 1.1, 1.5
COARSE, FEWEST = 0.02, 20  # [s] between samples above which, and number below which, positions are not smoothed
FEWEST_AT_REST = 5  # least samples of a standstill: fewer say nothing about noise
SIGMAS = 6.0  # times the noise's standard deviation: readings within belong to a standstill
RESOLUTION = 2e-5  # [rad, m] and within this: the resolution of an 18-bit encoder
DIGITS = 3, 4  # decimal places to which waypoints may be rounded
CLOSE = 10.0  # times their rounding: waypoints nearer to each other are not passed exactly
NEAR = 0.75  # times their rounding: largest distance of the path from them
MOST = 200  # control points of the curve near rounded waypoints: timings have as many intervals
PROJECTIONS = 4  # fits of the curve near rounded waypoints
PIECES = 4  # pieces of the path for each control point of the curve near rounded waypoints


def motion_of(samples: Samples) -> tuple[Trajectory, tuple[str, ...]]:
    """Samples as a trajectory, and notes. A recording is smoothed where it is noisy, and an arm at rest does not move.

    Samples with accelerations, and plans, are taken as they are.

    Raises:
        BadInput: there are no times, or fewer than two samples.
    """
    read = samples.trajectory()
    if samples.planned or samples.acceleration is not None:
        return read, ()
    t, notes = _smoothed(read, samples.where)
    q, v, a, seconds = t.position.copy(), t.velocity.copy(), t.acceleration.copy(), 0.0
    for begin, end in _rests(read):
        part = (t.time >= begin) & (t.time <= end)
        if np.abs(read.velocity[part]).max() > MOVING_SPEED:
            seconds += end - begin
            q[part], v[part], a[part] = q[part].mean(axis=0), 0.0, 0.0
    if seconds == 0:
        return t, notes
    note = f"{samples.where}: the arm is at rest for {seconds:.3g} s, where its readings are noise"
    return replace(t, position=q, velocity=v, acceleration=a), (*notes, note)


def path_of(samples: Samples) -> tuple[JointPath, tuple[str, ...]]:
    """Samples as a path, and notes: that of a trajectory, which it keeps, or the spline through waypoints.

    Waypoints that are rounded coarsely compared with their distances would give a path full of small corners. The path
    passes them within their rounding.

    Raises:
        BadInput: a trajectory rests on its way, which a path cannot represent.
    """
    if samples.time is None:
        return past(samples.position, samples.where)
    trajectory, notes = motion_of(samples)
    check_moves_on(trajectory, samples.where)
    return of_trajectory(trajectory), notes


def _rests(t: Trajectory) -> list[tuple[float, float]]:
    """Times [s] between which the readings of a recording are those of an arm at rest, near their median there."""
    out = []
    for first, last in standstills(t.time, t.position):
        q = t.position[first : last + 1]
        if len(q) < FEWEST_AT_REST:
            continue
        off = np.abs(t.position - np.median(q, axis=0))
        moves = (off > np.maximum(SIGMAS * _difference(q, 3) / np.sqrt(20), RESOLUTION)).any(axis=1)
        edges = np.concatenate([[-1], np.flatnonzero(moves), [len(moves)]])
        k = int(np.searchsorted(edges, (first + last) // 2))
        begin, end = t.time[edges[k - 1] + 1], t.time[edges[k] - 1]
        if end - begin >= SHORTEST:
            out.append((float(begin), float(end)))
    return out


def _difference(q: np.ndarray, order: int) -> np.ndarray:
    """Standard deviation (n,) of differences of positions (N, n), without the influence of single large ones."""
    return np.asarray(1.48 * np.median(np.abs(np.diff(q, order, axis=0)), axis=0))


def _smoothed(t: Trajectory, where: str) -> tuple[Trajectory, tuple[str, ...]]:
    """A recording, smoothed if its positions are too noisy to be differentiated twice; `where` it was read."""
    from scipy.interpolate import CubicSpline

    if float(np.median(np.diff(t.time))) > COARSE or len(t.time) < FEWEST:
        return t, ()
    time = np.linspace(t.time[0], t.time[-1], len(t.time))
    even = CubicSpline(t.time, t.position)(time)
    curve = CubicSpline(time, smooth(even, float(time[1] - time[0]), CUTOFF))
    q, v, a = (curve(time, order) for order in range(3))
    v[[0, -1]] *= t.velocity[[0, -1]].any(axis=1, keepdims=True)  # ends at rest stay so
    rough = np.sqrt(np.mean(t.acceleration**2, axis=0)) > NOISY * np.sqrt(np.mean(a**2, axis=0))
    if not (rough & (_difference(even, 4) > WHITE * _difference(even, 3))).any():
        return t, ()
    note = f"{where}: noisy recording: positions are smoothed at {CUTOFF:g} Hz"
    return Trajectory(t.joints, time, q, v, a), (note,)


def past(q: np.ndarray, where: str) -> tuple[JointPath, tuple[str, ...]]:
    """The spline through waypoints (K, n), or one past close ones within their rounding; and notes.

    Args:
        where: they were read, for a note.
    """
    rounding = next((10.0**-d for d in DIGITS if np.abs(q - np.round(q, d)).max() < 1e-9), 0.0)
    apart = np.abs(np.diff(q, axis=0)).max(axis=1, initial=0.0)
    exact = through(q), ()
    if len(q) < FEWEST or float(np.median(apart)) >= CLOSE * rounding:
        return exact
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(q, axis=0), axis=1))])
    controls = DEGREE + 1
    while controls < min(len(q) / 3, MOST) and length[-1] > 0:
        basis, u = Basis(controls, packing=0.0), length / length[-1]
        for _ in range(PROJECTIONS):
            points = basis.fit(u, q, q[:1], q[-1:])
            off, along = q - basis.matrix(u) @ points, basis.matrix(u, 1) @ points
            # each waypoint to the nearest place of the curve: rounding makes the way between waypoints uneven
            step = np.sum(off * along, axis=1) / np.maximum(np.sum(along**2, axis=1), 1e-12)
            u[1:-1] = np.clip(u + step, 0.0, 1.0)[1:-1]
        if np.abs(off).max() <= NEAR * rounding:
            u = np.linspace(0.0, 1.0, PIECES * controls + 1)
            note = f"{where}: waypoints rounded to {rounding:g} are passed within {NEAR * rounding:g} rad or m"
            return through(basis.matrix(u) @ points), (note,)
        controls = int(1.3 * controls) + 1
    return exact
