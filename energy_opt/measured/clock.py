"""The meter's clock relative to the joints' clock: offset and drift, from the dependence of the power on the motion.

Power follows the motion. The features are f(t) = (1, tau.v, positive part of tau.v, sum tau^2, sum |v|, sum v^2), with
the rigid body's torque tau. Readings P_i with time stamps s_i of the meter are regressed on the means of f over their
windows, which are moved to the joints' clock by

    t = s + offset + drift * (s - middle)

The clock with the least residual is chosen. With M readings and squares R_1, R_2 under two clocks, the log likelihood
ratio is M/2 log(R_1 / R_2). M counts at most one reading in every APART seconds, because the residual is correlated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from energy_opt.measured.differentiate import choose_smoothing, kinematics
from energy_opt.measured.run import Run
from energy_opt.robot import Robot

GRID = 0.02  # [s] step of the grid of the motion's features
MOST = 40_000  # most nodes of that grid
READINGS = 1500  # readings used at most (about)
FEWEST = 12  # least independent readings to estimate a clock or a window: two for every feature
APART = 0.3  # [s] readings closer together count as one
SHAPE = 3.0  # difference of log likelihood that decides between means and values at the stamps
DELAYS = np.round(np.arange(0.0, 0.601, 0.025), 3)  # [s] delays of a meter that are tried; the first is none


@dataclass(frozen=True)
class Activity:
    """Integrals of a motion's features over a grid, which is even but for gaps in which the motion is not known.

    Attributes:
        t: (K,) [s]. integrals: (K, F) from the first time on. gaps: (G, 2) [s] begin and end of each.
    """

    t: np.ndarray
    integrals: np.ndarray
    gaps: np.ndarray

    def knows(self, stamps: np.ndarray, window: np.ndarray) -> np.ndarray:
        """Mask (M,) of stamps [s] within the motion whose windows (M,) [s] touch no gap."""
        inside = (stamps >= self.t[0] - 1e-9) & (stamps <= self.t[-1] + 1e-9)
        before = np.searchsorted(self.gaps[:, 0], stamps - 1e-9)
        return np.asarray(inside & (stamps - window >= np.append(-np.inf, self.gaps[:, 1])[before] - 1e-9))

    def at(self, stamps: np.ndarray, window: np.ndarray) -> np.ndarray:
        """Means of the features over the windows that end at the stamps, (M, F).

        A mean is the difference of the integral at both ends over the length. A window shorter than two steps of the
        grid is widened symmetrically to this length.

        Args:
            stamps: (M,) [s]. window: (M,) [s] length of each.
        """
        short = np.maximum(window, 2 * (self.t[1] - self.t[0]))
        end, begin = np.clip(stamps, self.t[0], self.t[-1]), np.clip(stamps - short, self.t[0], self.t[-1])
        shift = np.where(window < short, (short - window) / 2, 0.0)
        end, begin = np.clip(end + shift, self.t[0], self.t[-1]), np.clip(begin + shift, self.t[0], self.t[-1])
        means = [(np.interp(end, self.t, x) - np.interp(begin, self.t, x)) for x in self.integrals.T]
        return np.column_stack(means) / np.maximum(end - begin, 1e-9)[:, None]


@dataclass(frozen=True)
class Clock:
    """A meter's clock: joints' time = stamp + offset + drift * (stamp - middle).

    Attributes:
        offset: [s]. drift: [s/s]. middle: [s] on the meter's clock. explained: share of the readings' variance that the
            motion explains.
    """

    offset: float
    drift: float
    middle: float
    explained: float

    def moved(self, stamps: np.ndarray) -> np.ndarray:
        """Stamps (M,) [s] of the meter on the joints' clock."""
        return stamps + self.offset + self.drift * (stamps - self.middle)


def activity(robot: Robot, time: np.ndarray, position: np.ndarray, spans: Sequence[tuple[int, int]]) -> Activity:
    """The features of a motion that a power may follow.

    Args:
        robot: for the rigid body's torque. time: (N,) [s]. position: (N, n) [rad]; smoothed as far as its noise needs.
        spans: first and last sample of each piece without a gap.
    """
    from scipy.integrate import cumulative_trapezoid

    none = np.zeros(0)
    signals = [(time[a : b + 1], position[a : b + 1]) for a, b in spans]
    runs = [Run("", "motion", 0.0, own, q, None, None, None, None, none, none) for own, q in signals]
    lasts = np.array([float(np.ptp(run.time)) for run in runs])
    counts = np.ceil(np.clip(lasts.sum() / GRID, 8, MOST) * lasts / lasts.sum()).astype(int) + 1
    grids = [np.linspace(run.time[0], run.time[-1], count) for run, count in zip(runs, counts, strict=True)]
    noise = choose_smoothing(runs)
    motions = [kinematics(run, grid, noise) for run, grid in zip(runs, grids, strict=True)]
    t = np.concatenate(grids)
    q, v, a = (np.concatenate([getattr(way, name) for way in motions]) for name in ("q", "v", "a"))
    tau = robot.body.torque(q, v, a)
    drive = np.sum(tau * v, axis=1)
    values = np.column_stack(
        [drive, np.maximum(drive, 0), np.sum(tau**2, axis=1), np.abs(v).sum(axis=1), np.sum(v**2, axis=1)]
    )
    gaps = np.array([[one[-1], other[0]] for one, other in pairwise(grids)]).reshape(-1, 2)
    return Activity(t, cumulative_trapezoid(values, t, axis=0, initial=0.0), gaps)


def evidence(motion: Activity, stamps: np.ndarray, window: np.ndarray, power: np.ndarray) -> tuple[float, float]:
    """How well the motion explains readings.

    Args:
        motion: the features. stamps: (M,) [s] on the joints' clock. window: (M,) [s]. power: (M,) [W].

    Returns:
        The log likelihood relative to that of a constant power, less the number of features; and the explained share of
            variance. -inf and 0 if fewer than FEWEST independent readings lie within the motion.
    """
    inside = motion.knows(stamps, window)
    count = independent(stamps[inside])
    if count < FEWEST:
        return -np.inf, 0.0
    y = power[inside] - power[inside].mean()
    total = float(y @ y)
    if total <= 0:
        return -np.inf, 0.0
    x = motion.at(stamps[inside], window[inside])
    x = x - x.mean(axis=0)
    left = y - x @ np.linalg.lstsq(x, y, rcond=1e-9)[0]
    ratio = max(float(left @ left) / total, 1e-6)
    return -count / 2 * float(np.log(ratio)) - x.shape[1], 1 - ratio


def delays_of(motion: Activity, stamps: np.ndarray, windows: Sequence[np.ndarray], power: np.ndarray) -> np.ndarray:
    """Log likelihoods (windows, DELAYS) of readings that average `windows` and come late; see `shows_means`."""
    fewer = [thinned(stamps, window, power) for window in windows]
    return np.array([[evidence(motion, s - d, w, p)[0] for d in DELAYS] for s, w, p in fewer])


def shows_means(scores: np.ndarray, interval: float) -> tuple[bool, bool]:
    """Whether a slow meter shows means since its last reading (else the power at its stamps), and whether this is sure.

    The meter may also be late, so each hypothesis uses its best delay. If the fits are equally good, a delay of half an
    interval speaks for the mean, which needs no delay.

    Args:
        scores: (2, DELAYS) log likelihoods of the power at the stamps and of the mean, summed over the runs.
        interval: [s] between readings.
    """
    if not np.isfinite(scores).any():
        return True, False
    at_stamp, mean = scores.max(axis=1)
    if abs(mean - at_stamp) > SHAPE:
        return bool(mean > at_stamp), True
    late = DELAYS[int(np.argmax(scores[0]))]
    return bool(abs(late - interval / 2) < 0.2 * interval), False


def thinned(*columns: np.ndarray) -> tuple[np.ndarray, ...]:
    """Every k-th reading, so that `READINGS` take part."""
    stride = max(1, len(columns[0]) // READINGS)
    return tuple(column[::stride] for column in columns)


def independent(stamps: np.ndarray) -> float:
    """How many of the readings at ascending stamps (M,) [s] count as independent."""
    return float(np.minimum(np.diff(stamps, prepend=-np.inf), APART).sum()) / APART
