"""Motions and paths from samples, without the noise of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from energy_opt.effects.parameter import MOVING_SPEED
from energy_opt.formats.close_waypoints import past
from energy_opt.formats.readings import as_moved
from energy_opt.formats.waypoints import Samples
from energy_opt.motion.path import JointPath, of_trajectory
from energy_opt.motion.standstills import check_moves_on
from energy_opt.motion.trajectory import Trajectory
from energy_opt.numerics.signals import SHORTEST, WINDOW, smooth, standstills

CUTOFF = 10.0  # [Hz] cut-off frequency for recorded positions
# A joint is noisy if its accelerations exceed those of the smoothed positions by this factor, and if fourth differences
# exceed third ones by that: 1.9 for white noise, far less for smooth motion, also with a few jumps of acceleration.
NOISY, WHITE = 1.1, 1.5
COARSE, FEWEST = 0.02, 20  # [s] between samples above which, and number below which, positions are not smoothed
FEWEST_AT_REST = 5  # least samples of a standstill: fewer say nothing about noise
SIGMAS = 6.0  # times the noise's standard deviation: readings within belong to a standstill
RESOLUTION = 2.5e-5  # [rad, m] and within this: the resolution of an 18-bit encoder, 2.4e-5 rad
LEAST, SLIGHT = 1e-3, 0.1  # [rad/s^2] and share of the largest joint's: smaller accelerations contradict nothing
MOST_DIGITS = 5  # of a plan whose positions may contradict its velocities
END_SLOPE = 3.0  # steps of an encoder within a sample by which a spline's velocity at its end may be wrong
WHOLE = 0.01  # largest difference of a multiple from a whole number
FADE = 0.1  # [s] within which a correction of a recording's rest fades into the motion
LOOKS = 4  # at a recording between two samples


def motion_of(samples: Samples) -> tuple[Trajectory, tuple[str, ...]]:
    """Samples as a trajectory, and notes. A recording is smoothed where it is noisy, and an arm at rest does not move.

    Plans, samples whose accelerations agree with their positions, and those that state no velocity but zero, are taken
    as they are. Rates that contradict the positions are left out.

    Raises:
        BadInput: there are no times, or fewer than two samples.
    """
    samples, repaired = as_moved(samples)
    read = samples.trajectory()
    # with few digits, the differences of close positions are coarse
    rounded = np.abs(samples.position - np.round(samples.position, MOST_DIGITS)).max() < 1e-9
    if not read.velocity.any() or (samples.planned and not (rounded and _contradicts(read))):
        return read, repaired
    given = samples
    samples, read, dropped = _agreeing(samples, read)
    repaired = (*repaired, *dropped)
    if samples.acceleration is not None:
        return read, repaired
    t, notes = _smoothed(read, samples.where)
    rests = [
        (begin, end)
        for begin, end in _rests(read)
        if np.abs(read.velocity[(read.time >= begin) & (read.time <= end)]).max() > MOVING_SPEED
    ]
    out = _stopped(_standing(t, rests), _ends_resting(given, read, t))
    seconds = sum(end - begin for begin, end in rests)
    if rests:
        notes = (*notes, f"{samples.where}: the arm is at rest for {seconds:.3g} s, whatever its readings say")
    return out, (*repaired, *notes)


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
    for first, last in standstills(t.time, t.position, SHORTEST - WINDOW):
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


def _agreeing(samples: Samples, read: Trajectory) -> tuple[Samples, Trajectory, tuple[str, ...]]:
    """The samples without accelerations, and without velocities, that contradict the rest; and notes."""
    dropped = []
    if samples.acceleration is not None and _contradicts(read):
        samples = replace(samples, acceleration=None)
        read = samples.trajectory()
        dropped.append("accelerations")
    if samples.velocity is not None and samples.acceleration is None and _contradicts(read):
        samples = replace(samples, velocity=None)
        read = samples.trajectory()
        dropped.append("velocities")
    if not dropped:
        return samples, read, ()
    note = (
        f"{samples.where}: {' and '.join(dropped)} contradict the positions (noise, delay, rounding?) and are not used"
    )
    return samples, read, (note,)


def _contradicts(t: Trajectory) -> bool:
    """Whether accelerations between close samples are far above those at samples, as rates do not fit the positions."""
    if len(t.time) < FEWEST or float(np.median(np.diff(t.time))) > COARSE:
        return False
    at_samples, between = (np.sqrt(np.mean(a**2, axis=0)) for a in (t.acceleration, _accelerations(t)))
    least = max(LEAST, SLIGHT * float(at_samples.max()))
    return bool((between > np.maximum(WHITE * at_samples, least)).any())


def _accelerations(t: Trajectory) -> np.ndarray:
    """Accelerations at and between samples: positions that disagree with given velocities show between them."""
    return t.sample_denser(LOOKS)[2]


def _standing(t: Trajectory, rests: Sequence[tuple[float, float]]) -> Trajectory:
    """The motion with the arm at its mean place in `rests`, which it leaves and reaches without a jump."""
    q, v, a = t.position.copy(), t.velocity.copy(), t.acceleration.copy()
    spans = [np.flatnonzero((t.time >= begin) & (t.time <= end)) for begin, end in rests]
    bounds = [0, *(k for span in spans for k in span[[0, -1]].tolist()), len(t.time) - 1]
    for span, before, after in zip(spans, bounds[:-2:2], bounds[3::2], strict=True):
        place = t.position[span].mean(axis=0)
        for edge, other in ((span[0], before), (span[-1], after)):
            _ease((q, v, a), t, edge, other, (place - t.position[edge], -t.velocity[edge], -t.acceleration[edge]))
        q[span], v[span], a[span] = place, 0.0, 0.0
    return replace(t, position=q, velocity=v, acceleration=a)


def _stopped(t: Trajectory, resting: np.ndarray) -> Trajectory:
    """The motion, at rest at its start and end where `resting` (2,) says so."""
    q, v, a = t.position.copy(), t.velocity.copy(), t.acceleration.copy()
    zero, last = np.zeros(q.shape[1]), len(q) - 1
    for end in np.array([0, last])[resting]:
        _ease((q, v, a), t, end, last - end, (zero, -t.velocity[end], zero))
    return replace(t, position=q, velocity=v, acceleration=a)


def _ease(curve: tuple[np.ndarray, ...], t: Trajectory, edge: int, other: int, change: tuple[np.ndarray, ...]) -> None:
    """Add to the positions, velocities and accelerations of `curve` a `change` (three times n) of sample `edge`.

    It fades towards the sample `other`, within `FADE` seconds.
    """
    span = min(FADE, abs(float(t.time[other] - t.time[edge])))
    if span == 0:
        return
    ahead = 1.0 if other > edge else -1.0  # towards earlier samples, the change is that of the reversed motion
    zero = np.zeros((2, len(t.joints)))
    state = [np.vstack([part * ahead**order, part * 0]) for order, part in enumerate(change)]
    fading = Trajectory(t.joints, np.array([0.0, span]), *(x + zero for x in state))
    away = ahead * (t.time - t.time[edge])
    inside = (away >= 0) & (away <= span)
    for order, (block, added) in enumerate(zip(curve, fading.sample(away[inside]), strict=False)):
        block[inside] += added * ahead**order


def _ends_resting(given: Samples, read: Trajectory, t: Trajectory) -> np.ndarray:
    """Whether a recording begins and ends at rest (2,): if noisy, its velocities there are not larger than their error.

    Args:
        given: the samples, with the velocities of the file. read: they as a trajectory, without rates that contradict
            the positions. t: the same, smoothed if its positions are noisy.
    """
    resting = np.zeros(2, dtype=bool)
    if given.velocity is not None and len(given.velocity) >= FEWEST:
        ends, noise = np.abs(given.velocity[[0, -1]]), _difference(given.velocity, 3)
        noisy = t is not read or (_difference(given.velocity, 4) > WHITE * noise).any()
        resting = (ends <= SIGMAS * noisy * noise / np.sqrt(20)).all(axis=1)
    if t is read or given.planned:
        slip = END_SLOPE * float(np.linalg.norm(_quantum(read.position))) / float(np.median(np.diff(read.time)))
        ends = np.linalg.norm(read.velocity[[0, -1]], axis=1)
        return np.asarray(resting | (ends == 0) | ((ends <= slip) & (given.velocity is None)))
    step = float(t.time[1] - t.time[0])
    slope = np.zeros((len(t.time), 1))
    slope[:2, 0] = -1 / step, 1 / step
    # the smoother is a symmetric matrix: its answer to the slope is the weight of each reading in the end's velocity
    weight = float(np.linalg.norm(smooth(slope, step, CUTOFF)))
    blurred = np.abs(t.acceleration[[0, -1]]) / (2 * np.pi * CUTOFF)  # a start from rest within its time constant
    noise = SIGMAS * weight * _difference(read.position, 3) / np.sqrt(20) + CUTOFF * _quantum(read.position)
    most = np.linalg.norm(noise + blurred, axis=1)
    return np.asarray(resting | (np.linalg.norm(t.velocity[[0, -1]], axis=1) <= most))


def _difference(q: np.ndarray, order: int) -> np.ndarray:
    """Standard deviation (n,) of differences of positions (N, n), without the influence of single large ones."""
    return np.asarray(1.48 * np.median(np.abs(np.diff(q, order, axis=0)), axis=0))


def _quantum(q: np.ndarray) -> np.ndarray:
    """Resolution (n,) of positions (N, n): the smallest change, if all others are multiples of it; else 0."""
    step = np.abs(np.diff(q, axis=0))
    least = np.min(np.where(step > 1e-9, step, np.inf), axis=0)
    off = np.abs(step / least - np.round(step / least)).max(axis=0)
    return np.where(np.isfinite(least) & (off < WHOLE), least, 0.0)


def _smoothed(t: Trajectory, where: str) -> tuple[Trajectory, tuple[str, ...]]:
    """A recording, smoothed if its positions are too noisy to be differentiated twice; `where` it was read."""
    from scipy.interpolate import CubicSpline

    if float(np.median(np.diff(t.time))) > COARSE or len(t.time) < FEWEST:
        return t, ()
    time = np.linspace(t.time[0], t.time[-1], len(t.time))
    even = CubicSpline(t.time, t.position)(time)
    curve = CubicSpline(time, smooth(even, float(time[1] - time[0]), CUTOFF))
    q, v, a = (curve(time, order) for order in range(3))
    rough = np.sqrt(np.mean(_accelerations(t) ** 2, axis=0)) > NOISY * np.sqrt(np.mean(a**2, axis=0))
    if not (rough & (_difference(even, 4) > WHITE * _difference(even, 3))).any():
        return t, ()
    note = f"{where}: noisy recording: positions are smoothed at {CUTOFF:g} Hz"
    return Trajectory(t.joints, time, q, v, a), (note,)
