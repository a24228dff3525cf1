"""Motions and paths from samples, without the noise of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from energy_opt.effects.parameter import RESTING_SPEED
from energy_opt.formats.close_waypoints import past
from energy_opt.formats.noise import Noise, cutoffs_of, noise_of, spread
from energy_opt.formats.readings import as_moved
from energy_opt.formats.rests import rests_of
from energy_opt.formats.waypoints import Samples
from energy_opt.motion.path import JointPath, of_trajectory
from energy_opt.motion.standstills import check_moves_on
from energy_opt.motion.trajectory import Trajectory
from energy_opt.numerics.signals import evenly, smooth, smooth_each

# Accelerations between samples that exceed those at samples by this factor contradict them.
WHITE = 1.5
# [s] between samples above which rates contradict noisy positions only, and number of samples below which none
COARSE, FEWEST = 0.02, 20
SIGMAS = 6.0  # times the noise's standard deviation: a velocity within is none
LEAST, SLIGHT = 1e-3, 0.1  # [rad/s^2] and share of the largest joint's: smaller accelerations contradict nothing
END_SLOPE = 3.0  # steps of an encoder within a sample by which a spline's velocity at its end may be wrong
FADE = 0.1  # [s] within which a correction of a recording's rest fades into the motion
EVEN = 1e-6  # share of a step by which even times may differ: their last digits
LOOKS = 4  # at a recording between two samples


def motion_of(samples: Samples) -> tuple[Trajectory, tuple[str, ...]]:
    """Samples as a trajectory, and notes. A recording is smoothed where it is noisy, and an arm at rest does not move.

    Samples whose accelerations agree with their positions, those that state no velocity but zero, plans whose positions
    are not noisy (as those of few digits are), and a controller's steps are taken as they are. Rates that contradict
    the positions are left out.

    Raises:
        BadInput: there are no times, or fewer than two samples.
    """
    from scipy.interpolate import CubicSpline

    if samples.steps is not None:
        return samples.trajectory(), ()
    samples, repaired = as_moved(samples)
    read = samples.trajectory()
    grid, even = evenly(read.time, read.position, EVEN)
    step = float(grid[1] - grid[0])
    noise = noise_of(read.position, even)
    cutoffs = cutoffs_of(even, step, noise)
    noisy = bool(np.isfinite(cutoffs).any())
    if not read.velocity.any() or (samples.planned and not noisy):
        return read, repaired
    given = samples
    samples, read, dropped = _agreeing(samples, read, noisy)
    repaired = (*repaired, *dropped)
    if samples.acceleration is not None:
        return read, repaired
    t = read
    if noisy:
        curve = CubicSpline(grid, smooth_each(even, step, cutoffs))
        t = Trajectory(read.joints, grid, *(curve(grid, order) for order in range(3)))
    rests = rests_of(read.time, read.position, noise)
    standing, resting = _standing(t, rests, cutoffs)
    out = _stopped(standing, _ends_resting(given, read, t, noise, cutoffs))
    return out, (*repaired, *_noted(samples.where, cutoffs, resting))


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


def _agreeing(samples: Samples, read: Trajectory, noisy: bool) -> tuple[Samples, Trajectory, tuple[str, ...]]:
    """The samples without accelerations, and without velocities, that contradict the rest; and notes."""
    dropped = []
    if samples.acceleration is not None and _contradicts(read, noisy):
        samples = replace(samples, acceleration=None)
        read = samples.trajectory()
        dropped.append("accelerations")
    if samples.velocity is not None and samples.acceleration is None and _contradicts(read, noisy):
        samples = replace(samples, velocity=None)
        read = samples.trajectory()
        dropped.append("velocities")
    if not dropped:
        return samples, read, ()
    note = (
        f"{samples.where}: {' and '.join(dropped)} contradict the positions (noise, delay, rounding?) and are not used"
    )
    return samples, read, (note,)


def _contradicts(t: Trajectory, noisy: bool) -> bool:
    """Whether accelerations between close samples are far above those at samples, as rates do not fit the positions."""
    if len(t.time) < FEWEST or not (noisy or float(np.median(np.diff(t.time))) <= COARSE):
        return False
    # positions that disagree with given velocities show between the samples
    at_samples, between = (np.sqrt(np.mean(a**2, axis=0)) for a in (t.acceleration, t.sample_denser(LOOKS)[2]))
    least = max(LEAST, SLIGHT * float(at_samples.max()))
    return bool((between > np.maximum(WHITE * at_samples, least)).any())


def _standing(
    t: Trajectory, rests: Sequence[Sequence[tuple[float, float]]], cutoffs: np.ndarray
) -> tuple[Trajectory, float]:
    """The motion with each joint at its mean place in its `rests`, which it leaves and reaches without a jump.

    Rests in which the joint is at rest anyway stay as they are. The correction fades the more slowly, the lower the
    cut-off (n,) [Hz] of the joint.

    Returns:
        The motion, and the seconds for which the whole arm rests; 0 if it does so anyway.
    """
    q, v, a = t.position.copy(), t.velocity.copy(), t.acceleration.copy()
    still, changed = np.zeros((2, *q.shape), dtype=bool)
    for j, own in enumerate(rests):
        one = Trajectory(t.joints[j : j + 1], t.time, *(x[:, j : j + 1].copy() for x in (q, v, a)))
        curve = tuple(x[:, j : j + 1] for x in (q, v, a))
        spans = [np.flatnonzero((t.time >= begin) & (t.time <= end)) for begin, end in own]
        still[:, j] = np.isin(np.arange(len(q)), np.concatenate([*spans, []]))
        spans = [span for span in spans if np.abs(one.velocity[span]).max(initial=0.0) > RESTING_SPEED]
        bounds = [0, *(k for span in spans for k in span[[0, -1]].tolist()), len(t.time) - 1]
        for span, before, after in zip(spans, bounds[:-2:2], bounds[3::2], strict=True):
            place = one.position[span].mean(axis=0)
            for edge, other in ((span[0], before), (span[-1], after)):
                change = (place - one.position[edge], -one.velocity[edge], -one.acceleration[edge])
                _ease(curve, one, edge, other, change, max(FADE, 1 / float(cutoffs[j])))
            q[span, j], v[span, j], a[span, j], changed[span, j] = place, 0.0, 0.0, True
    together = still.all(axis=1) & changed.any(axis=1)
    seconds = float(np.diff(t.time)[together[1:] & together[:-1]].sum())
    return replace(t, position=q, velocity=v, acceleration=a), seconds


def _noted(where: str, cutoffs: np.ndarray, resting: float) -> tuple[str, ...]:
    """Notes on smoothing with `cutoffs` (n,) [Hz], and on the seconds for which the arm was set at rest."""
    notes, used = [], np.unique(cutoffs[np.isfinite(cutoffs)])
    if len(used):
        at = f"{used[0]:g}" + (f" to {used[-1]:g}" if len(used) > 1 else "")
        notes.append(f"{where}: noisy recording: positions are smoothed at {at} Hz")
    if resting > 0:
        notes.append(f"{where}: the arm is at rest for {resting:.3g} s, whatever its readings say")
    return tuple(notes)


def _stopped(t: Trajectory, resting: np.ndarray) -> Trajectory:
    """The motion, at rest at its start and end where `resting` (2,) says so."""
    q, v, a = t.position.copy(), t.velocity.copy(), t.acceleration.copy()
    zero, last = np.zeros(q.shape[1]), len(q) - 1
    for end in np.array([0, last])[resting]:
        _ease((q, v, a), t, end, last - end, (zero, -t.velocity[end], zero), FADE)
    return replace(t, position=q, velocity=v, acceleration=a)


def _ease(
    curve: tuple[np.ndarray, ...], t: Trajectory, edge: int, other: int, change: tuple[np.ndarray, ...], fade: float
) -> None:
    """Add to the positions, velocities and accelerations of `curve` a `change` (three times n) of sample `edge`.

    It fades towards the sample `other`, within `fade` seconds.
    """
    span = min(fade, abs(float(t.time[other] - t.time[edge])))
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


def _ends_resting(given: Samples, read: Trajectory, t: Trajectory, noise: Noise, cutoffs: np.ndarray) -> np.ndarray:
    """Whether a recording begins and ends at rest (2,): if noisy, its velocities there are not larger than their error.

    Args:
        given: the samples, with the velocities of the file. read: they as a trajectory, without rates that contradict
            the positions. t: the same, smoothed if its positions are noisy. noise: of the positions.
        cutoffs: (n,) [Hz] at which they were smoothed.
    """
    resting = np.zeros(2, dtype=bool)
    if given.velocity is not None and len(given.velocity) >= FEWEST:
        ends, rates = np.abs(given.velocity[[0, -1]]), noise_of(given.velocity, given.velocity)
        white = rates.white if t is read else spread(given.velocity, 3)
        resting = (ends <= SIGMAS * white).all(axis=1)
    if t is read or given.planned:
        slip = END_SLOPE * float(np.linalg.norm(noise.step)) / float(np.median(np.diff(read.time)))
        ends = np.linalg.norm(read.velocity[[0, -1]], axis=1)
        return np.asarray(resting | (ends == 0) | ((ends <= slip) & (given.velocity is None)))
    step = float(t.time[1] - t.time[0])
    slope = np.zeros((len(t.time), 1))
    slope[:2, 0] = -1 / step, 1 / step
    # the smoother is a symmetric matrix: its answer to the slope is the weight of each reading in the end's velocity
    weights = {cutoff: float(np.linalg.norm(smooth(slope, step, cutoff))) for cutoff in set(cutoffs.tolist())}
    weight = np.array([weights[cutoff] for cutoff in cutoffs.tolist()])
    blurred = np.abs(t.acceleration[[0, -1]]) / (2 * np.pi * cutoffs)  # a start from rest within its time constant
    slip = np.minimum(cutoffs, END_SLOPE / step) * noise.step
    most = np.linalg.norm(SIGMAS * weight * noise.white + slip + blurred, axis=1)
    return np.asarray(resting | (np.linalg.norm(t.velocity[[0, -1]], axis=1) <= most))
