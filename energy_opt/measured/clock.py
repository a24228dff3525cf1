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

import numpy as np

from energy_opt.measured.differentiate import choose_smoothing, kinematics
from energy_opt.measured.run import Run
from energy_opt.robot import Robot

GRID = 0.02  # [s] step of the grid of the motion's features
MOST = 40_000  # most nodes of that grid
READINGS = 1500  # readings used at most (about)
FEWEST = 12  # least independent readings to estimate a clock or a window: two for every feature
LEAST = 0.25  # [s] a smaller offset is attributed to the meter's own delay, which the fit determines
SURE = 15.0  # gain of log likelihood from which a moved clock replaces the given one
GOOD = 0.3  # least share of the readings' variance that the motion must explain
APART = 0.3  # [s] readings closer together count as one
SHAPE = 3.0  # difference of log likelihood that decides between means and values at the stamps
DELAYS = np.round(np.arange(0.0, 0.601, 0.025), 3)  # [s] delays of a meter that are tried; the first is none
DRIFT = 2e-3  # [s/s] largest drift of a clock


@dataclass(frozen=True)
class Activity:
    """Integrals of a motion's features over an even grid.

    Attributes:
        t: (K,) [s]. integrals: (K, F) from the first time on; each feature has a standard deviation of 1.
    """

    t: np.ndarray
    integrals: np.ndarray

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


def activity(robot: Robot, time: np.ndarray, position: np.ndarray) -> Activity:
    """The features of a motion that a power may follow.

    Args:
        robot: for the rigid body's torque. time: (N,) [s]. position: (N, n) [rad]; smoothed as far as its noise needs.
    """
    from scipy.integrate import cumulative_trapezoid

    span = float(time[-1] - time[0])
    count = int(np.clip(np.ceil(span / GRID), 8, MOST)) + 1
    t = np.linspace(time[0], time[-1], count)
    none = np.zeros(0)
    run = Run("", "motion", 0.0, time, position, None, None, None, None, none, none)
    way = kinematics(run, t, choose_smoothing([run]))
    q, v, a = way.q, way.v, way.a
    tau = robot.body.torque(q, v, a)
    drive = np.sum(tau * v, axis=1)
    values = np.column_stack(
        [drive, np.maximum(drive, 0), np.sum(tau**2, axis=1), np.abs(v).sum(axis=1), np.sum(v**2, axis=1)]
    )
    values /= np.maximum(values.std(axis=0), 1e-9)
    return Activity(t, cumulative_trapezoid(values, dx=t[1] - t[0], axis=0, initial=0.0))


def evidence(motion: Activity, stamps: np.ndarray, window: np.ndarray, power: np.ndarray) -> tuple[float, float]:
    """How well the motion explains readings.

    Args:
        motion: the features. stamps: (M,) [s] on the joints' clock. window: (M,) [s]. power: (M,) [W].

    Returns:
        The log likelihood relative to that of a constant power, less the number of features; and the explained share of
            variance. -inf and 0 if fewer than FEWEST independent readings lie within the motion.
    """
    inside = (stamps >= motion.t[0] - 1e-9) & (stamps <= motion.t[-1] + 1e-9)
    if inside.sum() < FEWEST:
        return -np.inf, 0.0
    covered = float(np.ptp(stamps[inside]))
    count = min(float(inside.sum()), covered / APART)
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


def fits_as_well(
    motion: Activity | None, stamps: np.ndarray, offset: float, window: np.ndarray, power: np.ndarray
) -> bool:
    """Whether readings moved by an offset [s] fit the motion (None: there is none) no worse than they do unmoved."""
    if motion is None:
        return True
    moved, given = (evidence(motion, stamps + x, window, power)[0] for x in (offset, 0.0))
    return bool(moved >= given)


def align(
    motion: Activity, stamps: np.ndarray, windows: Sequence[np.ndarray], power: np.ndarray, given: bool, seek: bool
) -> tuple[Clock | None, int, np.ndarray]:
    """The meter's clock, and which of several windows its readings have.

    Args:
        motion: of the run. stamps, power: (M,) [s], [W] of the readings, perhaps on another clock.
        windows: one or two (M,) [s]; the readings may be means over them.
        given: whether the stamps claim to be on the joints' clock; otherwise every offset is equally likely.
        seek: whether to search for another clock; otherwise only the windows are compared.

    Returns:
        The clock (None: the given one is as good, or the data do not decide), the index of the window, and log
            likelihoods (windows, DELAYS) for `shows_means`.
    """
    fewer = [_thinned(stamps, window, power) for window in windows]
    scores = np.array([[evidence(motion, s - d, w, p)[0] for d in DELAYS] for s, w, p in fewer])
    at = int(shows_means(scores, float(np.median(windows[-1])))[0]) if len(windows) > 1 else 0
    found = [_search(motion, stamps, window, power, given) for window in windows] if seek else [(None, -np.inf)]
    best = max(range(len(found)), key=lambda k: found[k][1])
    clock, score = found[best]
    if clock is None or clock.explained < GOOD:
        return None, at, scores
    largest = abs(clock.offset) + abs(clock.drift) * float(stamps[-1] - stamps[0]) / 2
    if given and (score - scores[:, 0].max() < SURE or largest < LEAST):
        return None, at, scores
    return clock, best, np.tile(np.array([[score] for _, score in found]), (1, len(DELAYS)))


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


def _search(
    motion: Activity, stamps: np.ndarray, window: np.ndarray, power: np.ndarray, given: bool
) -> tuple[Clock | None, float]:
    """The clock with the best fit, and its log likelihood; None and -inf if no offset leaves enough readings within.

    Offsets are first scanned on a grid. Then Nelder-Mead refines offset and drift. The drift is kept if it improves the
    log likelihood by more than 5 + log(M) / 2 (the Bayesian information criterion with a margin).
    """
    from scipy.optimize import minimize

    stamps, window, power = _thinned(stamps, window, power)
    span, own = float(motion.t[-1] - motion.t[0]), float(stamps[-1] - stamps[0])
    middle = float(stamps[0] + stamps[-1]) / 2
    share = 0.5 * min(span, own)
    first, last = motion.t[0] + share - stamps[-1], motion.t[-1] - share - stamps[0]
    step = max(0.1, float(np.median(window)) / 8, (last - first) / 6000)
    offsets = np.arange(first, last + step, step)
    if given:
        offsets = np.append(offsets[np.abs(offsets) > step / 2], 0.0)
    scores = np.array([evidence(motion, stamps + x, window, power)[0] for x in offsets])
    if not np.isfinite(scores).any():
        return None, -np.inf
    best = float(offsets[int(np.argmax(scores))])

    def loss(x: np.ndarray) -> float:
        """Less the log likelihood of an offset [s], and of the drift over half of the readings [s], if there is one."""
        offset, drift = (*x, 0.0)[:2]
        if abs(drift) > DRIFT * own / 2:
            return 1e9
        score = evidence(motion, stamps + offset + drift * (stamps - middle) / (own / 2), window, power)[0]
        return max(-score, -1e9) if np.isfinite(score) else 1e9

    both = np.array([[best, 0.0], [best + step, 0.0], [best, min(0.05, DRIFT * own / 4)]])
    fine, alone = (
        minimize(loss, x[0], method="Nelder-Mead", options={"initial_simplex": x, "xatol": 1e-4})
        for x in (both, both[:2, :1])  # offset and drift, and the offset alone
    )
    drifts = alone.fun - fine.fun > 5.0 + 0.5 * np.log(len(power))
    offset, drift = (float(fine.x[0]), float(fine.x[1]) / (own / 2)) if drifts else (float(alone.x[0]), 0.0)
    clock = Clock(offset, drift, middle, 0.0)
    score, explained = evidence(motion, clock.moved(stamps), window, power)
    return Clock(offset, drift, middle, explained), score


def _thinned(*columns: np.ndarray) -> tuple[np.ndarray, ...]:
    """Every k-th reading, so that `READINGS` take part."""
    stride = max(1, len(columns[0]) // READINGS)
    return tuple(column[::stride] for column in columns)
