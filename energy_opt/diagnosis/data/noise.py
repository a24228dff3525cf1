"""Noise of the readings: a white part, a part with memory, and a model discrepancy that repeats of a motion share.

    y_k = w_k + x_k + d_c(phase),   w_k ~ N(0, white^2 / weight_k^2),
    x_{k+1} = e^{-h/memory} x_k + ...,   x ~ N(0, wave^2)

w and x are independent between runs. d_c is a random smooth function of the phase of a distinct motion, with standard
deviation `misfit`. It represents errors that every model of an arm has there. All repeats of the motion share it, so
ten repeats of a misfit are one piece of evidence. Whitening is the Kalman filter of w and x, followed by a low-rank
step for d_c. The same linear map applies to residuals and to the columns of their derivatives, so ordinary least
squares on its results maximises the likelihood.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np

from energy_opt.diagnosis.data.predict import Prediction
from energy_opt.diagnosis.data.samples import Samples

FLOOR = 0.8  # least noise of a fit, over the noise of single readings
NORMAL_MEDIAN = 0.6745  # median of |x| of a standard normal x
SAME_READING = 1e-9  # share of the level: readings that differ by less are equal
EDGE, DOUBTED = 2, 0.15  # least number of samples on both sides of the start and end of a motion, and their weight
GROWN, UNSEEN = 8.0, 0.1  # growth of a cube when time doubles; [s] longest time that a motion is not seen
NEAR, SWITCHED = 8, 3.0  # readings beside the middle of a dwell; step of power there over the noise of single readings
# change of the power at rest over two readings that is a step, over the noise of single readings; least number of
# readings between it and a motion, as a late meter shows the end of the motion later
STEPPED, AFTER = 8.0, 5
SLACK = 2e-3  # [s] time uncertainty between motion and meter
# standard deviation of a model's error that all repeats of a motion share, over the noise of a reading: repeats tell no
# more than four recordings would without it
SHARED = 0.5
SLOW_METER, SLOW_NOISE = 0.25, 0.01  # [s] between readings from which a meter is slow; its largest noise over the level


@dataclass(frozen=True)
class Noise:
    """The noise of a meter.

    Attributes:
        white: [W] standard deviation of w, independent from reading to reading.
        wave, memory: [W] that of x, and its correlation time [s].
        misfit: [W] that of d_c.
    """

    white: float
    wave: float = 0.0
    memory: float = 1.0
    misfit: float = 0.0


@dataclass(frozen=True)
class Shared:
    """Smooth functions of the distinct motions that were repeated.

    Attributes:
        columns: (M, k) basis functions of phase at the readings; weights of unit variance give a function.
        motions: of each motion its readings (m,) and how many of the columns it uses; motions share the columns, as
            none has another's readings.
    """

    columns: np.ndarray
    motions: tuple[tuple[np.ndarray, int], ...]


class Whitener:
    """The map that makes the noise of R runs white with variance 1.

    Args:
        times: (M_r,) s of every run's readings. weights: (M,) weight of each reading, run after run, 1 is full.
        shared: the smooth functions of which `noise.misfit` is the standard deviation.
    """

    def __init__(
        self, noise: Noise, times: Sequence[np.ndarray], weights: np.ndarray, shared: Shared | None = None
    ) -> None:
        self.noise = noise
        keep = np.concatenate([np.concatenate([[0.0], np.exp(-np.diff(t) / noise.memory)]) for t in times])
        variance = (noise.white / np.maximum(weights, 1e-6)) ** 2
        gain, total, prior, wave = [], [], 0.0, noise.wave**2
        # Python floats are faster here than arrays: a run may have 1e4 readings
        for k, v in zip((keep * keep).tolist(), variance.tolist(), strict=True):
            prior = k * prior + (1 - k) * wave
            whole = prior + v
            share = prior / whole
            total.append(whole)
            gain.append(share)
            prior *= 1 - share
        self._scale = 1 / np.sqrt(total)
        self._feed = keep[1:] * gain[:-1]
        self._band = np.ones((2, len(keep)))  # diagonal and subdiagonal of the recursion's matrix
        self._band[1, :-1] = self._feed - keep[1:]
        self.log_determinant = float(np.sum(np.log(total)))
        self._low_rank: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        if shared is not None and noise.misfit > 0:
            columns = noise.misfit * self._filtered(shared.columns)
            for samples, count in shared.motions:
                u, s, _ = np.linalg.svd(columns[samples, :count], full_matrices=False)
                self._low_rank.append((samples, u, 1 - 1 / np.sqrt(1 + s**2)))
                self.log_determinant += float(np.sum(np.log1p(s**2)))

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """White innovations (M, ...) of readings (M, ...)."""
        out = self._filtered(x.reshape(len(x), -1))
        for samples, u, less in self._low_rank:
            own = out[samples]
            out[samples] = own - u @ (less[:, None] * (u.T @ own))
        return out.reshape(x.shape)

    def _filtered(self, flat: np.ndarray) -> np.ndarray:
        """Innovations of the Kalman filter of w and x, scaled to variance 1, column by column."""
        from scipy.linalg.lapack import dtbtrs

        if self.noise.wave == 0 or not flat.size:  # LAPACK writes beyond an array without columns
            return np.asarray(flat * self._scale[:, None])
        state = np.zeros_like(flat, dtype=float, order="F")
        state[1:] = self._feed[:, None] * flat[:-1]
        state, _ = dtbtrs(self._band, state, uplo="L", diag="U", overwrite_b=True)
        return np.asarray((flat - state) * self._scale[:, None])


# Grids of the wave over the white noise and of its memory [s]. They reach so far that the readings may be a wave alone:
# over 2 s this is 20 times the least white noise that `no_less` allows beside it, at `BIN`.
WAVES, MEMORIES = (0.0, 0.3, 0.6, 1.0, 1.7, 3.0, 5.0, 10.0, 20.0), (0.08, 0.25, 0.7, 2.0)
MISFITS = (0.0, 0.3, 0.7, 1.5, 3.0, 6.0, 12.0)  # grid of the misfit over the white noise


def weighed(
    worth: Callable[[float, float], tuple[float, float]],
    least: float,
    count: int,
    waves: Sequence[float],
    memories: Sequence[float] = MEMORIES,
) -> list[tuple[float, Noise]]:
    """Noises on a grid of the wave over white noise and its memory, and the logarithm of evidence times odds of each.

    White noise is as likely before the data as all noises with memory together. Otherwise the best of these represents
    chance, which widens every interval.

    Args:
        worth: logarithm of the evidence and the white noise [W] that is likeliest, of wave and memory.
        least: white noise [W] of single readings. count: number of readings less fitted levels.
    """
    found = []
    for wave, memory in product(waves, memories):
        if wave or memory == memories[0]:
            value, white = no_less(*worth(wave, memory), least, count)
            found.append((value, Noise(white, wave * white, memory)))
    return [(value + float(np.log(len(found))) * (noise.wave == 0), noise) for value, noise in found]


def no_less(value: float, white: float, least: float, count: int) -> tuple[float, float]:
    """Log evidence and white noise under the constraint that this is at least f = `FLOOR` times `least`.

    The likelihood of a larger white noise w' = max(w, f) is lower by count (log(w' / w) + ((w / w')^2 - 1) / 2).

    Args:
        value: log evidence at the likeliest white noise w, which is `white` [W].
        least: [W] white noise of single readings. count: number of readings less fitted levels.
    """
    floor = max(white, FLOOR * least)
    return value - count * (float(np.log(floor / white)) + ((white / floor) ** 2 - 1) / 2), floor


def weighted(
    samples: Samples, now: Prediction, repeats: Sequence[int], beside_jumps: np.ndarray | None = None
) -> Samples:
    """The same samples with less weight where errors of clocks or positions make a model's power uncertain.

    The time between motion and meter is uncertain by `SLACK`, velocities and accelerations by `Samples.blur`. Smoothed
    positions do not show the exact start and end of a motion: the samples `_around` them have less weight. Such errors
    are the same in all repeats of a motion, see `repeated`.

    Args:
        now: a model's prediction; its slopes convert such errors to watts. repeats: (R,) of each run's motion.
        beside_jumps: (M,) [W] rms error of the model's readings beside jumps of the acceleration; None: there are none.
    """
    weight, allowed = np.ones(len(samples.power)), np.zeros(len(samples.power))
    unsure = np.zeros(len(samples.power), dtype=bool)
    moving = (samples.v != 0).any(axis=1)
    noise = samples.noise * samples.group**0.5
    open_power, fixed = _open_power(samples, now), _fixed_rounding(samples)
    for span, part, op, count in zip(samples.slices, samples.parts, samples.operators, repeats, strict=True):
        grouped = op is not None and (span.stop - span.start) // samples.group == part.stop - part.start
        if op is not None and not (samples.group > 1 and grouped):
            weight[part] = repeated(weight[part], count)
            continue
        slope = np.gradient(now.power[span], samples.t[span]) if span.stop - span.start > 1 else np.zeros(1)
        variance = (SLACK * slope) ** 2 + open_power[span] ** 2
        edges = (1 + np.flatnonzero(np.diff(moving[span]))).tolist()
        alike = np.zeros(len(variance))  # number of readings with one error of rounding
        for a, b in pairwise([0, *edges, len(variance)]):
            alike[a:b] = 0 if moving[span][a] else b - a
        own = 1 / np.sqrt(1 + (variance + alike * fixed**2) / noise**2)
        doubted = np.zeros(len(variance), dtype=bool)
        others = [*_switches(samples, span, part, noise), *_steps(samples, part, noise)]
        for near in [*(_around(samples, span, k) for k in edges), *(slice(max(0, k - EDGE), k + EDGE) for k in others)]:
            # a reading there may show the power before the change or after it; averaged ones do not show how much it is
            jump = np.ptp(samples.power[part][near]) if not grouped else 0.0
            own[near] *= 1 / np.hypot(1 / DOUBTED, jump / noise)
            doubted[near] = True
        own = repeated(own, count)
        if grouped:
            whole = len(own) // samples.group * samples.group
            own, variance = (x[:whole].reshape(-1, samples.group) for x in (own, variance))
            weight[part] = np.mean(own**-2.0, axis=1) ** -0.5  # variances, which grow by 1 / weight^2, add up
            allowed[part] = variance.mean(axis=1)
            unsure[part] = doubted[:whole].reshape(-1, samples.group).any(axis=1)
        else:
            weight[part], allowed[part], unsure[part] = own / samples.group**0.5, variance, doubted
    if beside_jumps is not None:
        recorded = np.repeat(repeats, [part.stop - part.start for part in samples.parts])
        weight = 1 / np.sqrt(1 / weight**2 + recorded * (beside_jumps / samples.noise) ** 2)
    return samples.reread(weight=weight, allowed=allowed, doubted=unsure)


def resolution(readings: Sequence[np.ndarray]) -> float:
    """Step [W] to which readings are rounded: the least difference between two of them; 0 if all are the same.

    Sums of rounded channels differ by their last binary digits, too: such differences are none.
    """
    values = np.unique(np.concatenate(readings))
    gaps = np.diff(values)
    gaps = gaps[gaps > SAME_READING * np.abs(values).max(initial=0.0)]
    return float(gaps.min()) if len(gaps) else 0.0


def _fixed_rounding(samples: Samples) -> float:
    """Standard deviation [W] of the error by rounding that no mean of readings of one and the same power removes.

    Noise s spreads readings over several steps h: the mean's first harmonic of the error falls by
    exp(-2 pi^2 s^2 / h^2) (Widrow and Kollar, Quantization Noise, 2008).
    """
    step = samples.resolution
    if step == 0:
        return 0.0
    noise = max((samples.floor / step) ** 2 - 1 / 12, 0.0)
    return float(step / 12**0.5 * np.exp(-2 * np.pi**2 * noise))


def repeated(weight: np.ndarray, count: int, shared: float = SHARED) -> np.ndarray:
    """Weight of readings (M,) in each of `count` repeats of a motion, from their weight in a single recording.

    The error that lowers a weight is the same in all repeats, and so is a model's error of `shared` over the noise: of
    the variance of the mean, only the noise falls with their number.
    """
    return np.asarray(1 / np.sqrt(1 + count * (1 / weight**2 - 1) + max(count - 1, 0) * shared**2))


def _around(samples: Samples, span: slice, k: int) -> slice:
    """Nodes of a run beside node k, where a motion starts or ends, whose exact time the positions do not show.

    A smooth start is first seen where it exceeds noise and resolution of the positions, at some displacement d. If
    positions grow as t^3 from the true start on, 8 d is reached after twice that time. An end is the same backwards.
    """
    q, t = samples.q[span], samples.t[span]
    starts = bool((samples.v[span.start + k] != 0).any())
    if starts:
        inside = np.arange(k, np.searchsorted(t, t[k] + UNSEEN, side="right"))
    else:
        inside = np.arange(k - 1, np.searchsorted(t, t[k - 1] - UNSEEN) - 1, -1)
    time = np.abs(t[inside] - t[inside[0]])
    moved = np.abs((q[inside] - q[k - 1 if starts else k]) / samples.unit).max(axis=1)
    grown = np.flatnonzero(moved >= GROWN * moved[0])
    before = time[grown[0]] if grown.size else UNSEEN
    if starts:
        return slice(max(0, min(k - EDGE, int(np.searchsorted(t, t[k] - before)))), k + EDGE)
    return slice(max(0, k - EDGE), max(k + EDGE, int(np.searchsorted(t, t[k - 1] + before, side="right"))))


def _switches(samples: Samples, span: slice, part: slice, noise: float) -> list[int]:
    """Nodes of a run in the middle of a dwell where the power at rest steps, as if a payload changed there.

    Speeds from positions show begin and end of a dwell, and so its middle, a few readings early or late.
    """
    power, still = samples.power[part], ~samples.moving[part]
    out = []
    for k in (1 + np.flatnonzero(np.diff(samples.dwell[span]))).tolist():
        at = k // samples.group
        before, after = (slice(max(at - NEAR, 0), max(at - EDGE, 0)), slice(at + EDGE, at + NEAR))
        levels = [np.median(power[own][still[own]]) for own in (before, after) if still[own].any()]
        if len(levels) == 2 and abs(levels[1] - levels[0]) > SWITCHED * noise:
            out.append(k)
    return out


def _steps(samples: Samples, part: slice, noise: float) -> list[int]:
    """Nodes of a run at rest, well after its last motion, where the power steps, as at the end of a hold.

    Speeds show the end of the motion, from which a hold lasts, a reading early or late.
    """
    power, moving = samples.power[part], samples.moving[part]
    if samples.group > 1 or not moving.any() or moving.all():
        return []
    near = np.convolve(moving, np.ones(2 * AFTER + 1), "same") > 0
    stepped = [
        k for k in range(1, len(power) - 1) if abs(power[k + 1] - power[k - 1]) > STEPPED * noise and not near[k]
    ]
    return [k for k in stepped if k - 1 not in stepped]


def _open_power(samples: Samples, now: Prediction) -> np.ndarray:
    """Standard deviation (K,) [W] of a model's power by errors of velocities and accelerations."""
    n, blur = samples.n, samples.blur
    if not blur.any():
        return np.zeros(len(samples.q))
    rest = np.zeros_like(samples.v)
    inertia = [samples.body.torque(samples.q, rest, rest + unit, None, np.zeros(3))[:, j]
               for j, unit in enumerate(np.eye(n))]  # fmt: skip
    by_state = np.column_stack([now.tau_m, now.by_tau * np.column_stack(inertia)])
    return np.asarray(np.sqrt(np.sum((by_state * blur) ** 2, axis=1)))


def meter_noise(readings: Sequence[tuple[np.ndarray, np.ndarray]]) -> float:
    """Standard deviation [W] of a reading's noise, from third differences, which a smooth power hardly has.

    The median within a run and then over the runs makes it robust against kinks and steps of the true power. Rounded
    readings have few distinct differences: the median is interpolated between these by their counts. Coarse readings,
    whose median difference is zero, use the rms. Power is not smooth between the readings of a slow meter: its noise is
    taken to be at most `SLOW_NOISE` of the level, or 1 W, and the fit finds it.
    """
    levels, steps = [], []
    for t, x in readings:
        if len(x) > 12:
            third = np.diff(x, 3)
            middle = _grouped_median(np.abs(third)) / NORMAL_MEDIAN
            levels.append((middle if middle > 0 else float(np.sqrt(np.mean(third**2)))) / np.sqrt(20))
            steps.append(float(np.median(np.diff(t))))
    if not levels:
        return 1.0
    level = float(np.median(np.abs(np.concatenate([x for _, x in readings]))))
    most = max(1.0, SLOW_NOISE * level) if np.median(steps) > SLOW_METER else np.inf
    return max(min(float(np.median(levels)), most), 1e-3)


def _grouped_median(x: np.ndarray) -> float:
    """Median of values x >= 0, with each value's count spread half-way to its neighbours; 0 if most are 0."""
    values, counts = np.unique(np.round(x, 9), return_counts=True)
    if values[0] == 0 and 2 * counts[0] > len(x):
        return 0.0
    edges = [0.0, *(values[1:] + values[:-1]) / 2, values[-1]]
    return float(np.interp(len(x) / 2, [0, *np.cumsum(counts)], edges))
