"""Errors of a model in power and energy over all readings of some runs, and their comparison with the noise.

Evidence compares hypotheses with one another. It does not say whether the best of them is good: this needs the error of
single readings beside the noise that standstills show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from energy_opt.diagnosis.data.clusters import clusters
from energy_opt.diagnosis.data.jumps import beside_jumps, of_single
from energy_opt.diagnosis.data.noise import Noise, Whitener
from energy_opt.diagnosis.data.predict import Prediction, predict
from energy_opt.diagnosis.data.samples import Samples
from energy_opt.power import PowerModel

DRAWS = 999
SHARE = 0.9  # share of the squares above the noise that claims must remove if more than noise is left
OPEN_NOISE = 0.1  # relative uncertainty of the noise variance


@dataclass(frozen=True)
class Quality:
    """Error of a model, compared with the noise of the same readings.

    Attributes:
        motion, rest: rms error of single readings while the arm moves and while it rests, less the meter's drift in
            each run, W; 0 where there are none.
        noise_motion, noise_rest: rms error [W] that noise alone may cause there.
        rmse, noise: rms error [W] of all readings, and its expectation from noise and drift alone.
        squares: (C,) mean square error of each distinct motion or pose, whitened to a noise variance of 1, so that
            correlated readings count less.
        counts: (C,) how many readings a repeat of each has.
        whole: rms error [W] in motion and at rest with the drift.
    """

    motion: float
    rest: float
    noise_motion: float
    noise_rest: float
    rmse: float
    noise: float
    squares: np.ndarray
    counts: np.ndarray
    whole: tuple[float, float] = (0.0, 0.0)

    @property
    def worst(self) -> tuple[float, float]:
        """Error and noise [W] in motion, at rest or of all readings: where their ratio is largest."""
        each = (self.motion, self.noise_motion), (self.rest, self.noise_rest), (self.rmse, self.noise)
        return max(each, key=lambda pair: pair[0] / pair[1])

    @property
    def ratio(self) -> float:
        """Error divided by the noise: the largest of motion, rest and all readings."""
        return self.worst[0] / self.worst[1]

    @property
    def excess(self) -> float:
        """Rms error [W] above the noise where it is `worst`."""
        return max(self.worst[0] ** 2 - self.worst[1] ** 2, 0.0) ** 0.5

    def floor(self, left: bool) -> float:
        """Rms error [W] of all readings by noise alone.

        Args:
            left: True if more than noise is left. Then levels of runs that count as drift may be the model's error.
        """
        return min(self.noise, max(self.noise_motion, self.noise_rest)) if left else self.noise

    def lower(self, other: Quality) -> bool:
        """True if the error is lower, both over all readings and with each distinct motion counted once."""
        return self.rmse < other.rmse and float(np.sum(self.squares - other.squares)) < 0

    def document(self) -> dict[str, Any]:
        """As in diagnosis.json."""
        moving, resting = (
            {"power_rmse": rms or None, "noise": noise, "ratio": rms / noise if rms else None}
            for rms, noise in ((self.motion, self.noise_motion), (self.rest, self.noise_rest))
        )
        return {"motion": moving, "rest": resting}


def mostly_explained(before: Quality, after: Quality, unknown: bool) -> bool:
    """True if `SHARE` of the squares above the noise is removed, over all motions and without any one of three or more.

    Effects that resemble an unknown law follow most of it, or all of it in a single motion. `SHARE` must be removed in
    watts, too: whitened squares hardly contain slow errors.

    Args:
        unknown: True if a free function is likelier; otherwise `OPEN_NOISE` of the residual may be noise, and in watts
            as much as the noise, as few standstills show how large slow noise is.
    """
    left = 1 - SHARE
    spare = left * (before.squares - 1) - (after.squares - 1 - (0.0 if unknown else OPEN_NOISE))
    watts = left * (before.rmse**2 - before.noise**2) - (after.rmse**2 - (1 if unknown else 2) * after.noise**2)
    return watts >= 0 and bool(np.sum(spare) >= (max(np.max(spare), 0.0) if len(spare) > 2 else 0.0))


def quality(model: PowerModel, samples: Samples, noise: Noise, drift: np.ndarray) -> Quality:
    """The error of a model on some runs.

    Args:
        samples: of these runs, with their weights.
        noise: of the meter at standstill. drift: (R,) of its level in each run, W.
    """
    now = predict(model, samples)
    shown = reading_of(model, samples, now)
    levels = np.concatenate([np.full(p.stop - p.start, x) for p, x in zip(samples.parts, drift, strict=True)])
    whiten = Whitener(noise, [samples.at[p] for p in samples.parts], samples.weight)
    white = whiten(samples.power - now.reading - levels) ** 2
    # `floor` comes from neighbours, which share noise: that of the means of `count` readings is added
    mean, count = noise.white * samples.group**0.5, max(samples.counts)
    single = max(samples.floor, float(np.hypot((1 - 1 / count) ** 0.5 * samples.floor, mean)))
    usual, lives, allowed, sure = single**2 + noise.wave**2, [], [], []
    unresolved = of_single(samples, beside_jumps(model, samples, now), now.power)
    for span, part, (time, _), more in zip(samples.slices, samples.parts, samples.single, unresolved, strict=True):
        lives.append(np.interp(time, samples.t[span], (samples.v[span] != 0).any(axis=1).astype(float)) > 0.5)
        allowed.append(usual + more + np.interp(time, samples.at[part], samples.allowed[part]))
        sure.append(np.interp(time, samples.at[part], samples.doubted[part]) < 0.5)
    off = [power - own for (_, power), own in zip(samples.single, shown, strict=True)]
    less = [(x - level) ** 2 for x, level in zip(off, drift, strict=True)]
    own, expected, live = np.concatenate(less), np.concatenate(allowed), np.concatenate(lives)
    drifted, counted = np.repeat(drift**2, [len(x) for x in off]), np.concatenate(sure)

    def rms(x: np.ndarray, where: np.ndarray) -> float:
        where = where & counted if (where & counted).any() else where
        return float(np.sqrt(np.mean(x[where]))) if where.any() else 0.0

    each = [[(np.mean(x := white[samples.parts[r]]), len(x)) for r in group] for group in clusters(samples)]
    by_motion, counts = np.array([np.mean(group, axis=0) for group in each]).T
    least, always, squares = usual**0.5, np.ones(len(live), dtype=bool), np.concatenate(off) ** 2
    return Quality(
        rms(own, live), rms(own, ~live), rms(expected, live) or least, rms(expected, ~live) or least,
        rms(squares, always), rms(expected + drifted, always), by_motion, counts,
        (rms(squares, live), rms(squares, ~live)),
    )  # fmt: skip


def reading_of(model: PowerModel, samples: Samples, p: Prediction | None = None) -> list[np.ndarray]:
    """The model's power [W] at every single reading, an array for each run; `p` is its prediction at the samples."""
    p, out = p or predict(model, samples), []
    for span, part, op, (time, _) in zip(samples.slices, samples.parts, samples.operators, samples.single, strict=True):
        if op is None:
            out.append(_between(time, samples.t[span], p.power[span]))
        elif len(time) == part.stop - part.start:
            out.append(p.reading[part])
        else:  # single readings whose neighbours were averaged
            out.append(_between(time, samples.t[span], p.metered[span]))
    if any(e.stage == "meter" for e in model.effects):
        out = [
            _between(time, samples.at[part], p.reading[part]) if op is None else shown
            for part, op, (time, _), shown in zip(samples.parts, samples.operators, samples.single, out, strict=True)
        ]
    return out


def _between(time: np.ndarray, at: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Interpolate values with Akima's splines, which follow a smooth power and do not overshoot at steps."""
    from scipy.interpolate import Akima1DInterpolator

    if len(at) < 3:
        return np.interp(time, at, values)
    return np.asarray(Akima1DInterpolator(at, values)(np.clip(time, at[0], at[-1])))


def energy(time: np.ndarray, power: np.ndarray) -> float:
    """Energy [J] of readings [W] at times [s] by the trapezoidal rule; of a single reading its own value."""
    return float(np.trapezoid(power, time)) if len(time) > 1 else float(power.sum())


def errors(model: PowerModel, samples: Samples, runs: Sequence[int]) -> dict[str, Any] | None:
    """Mean energy error per run [%] and power RMSE [W] over the given runs, with bootstrap intervals over motions.

    Args:
        samples: of the whole set. runs: indices of those to use.

    Returns:
        As in diagnosis.json; None without any run.
    """
    if not runs:
        return None
    samples = samples.part(runs)
    percent, squares, count = [], [], []
    for shown, (time, power) in zip(reading_of(model, samples), samples.single, strict=True):
        measured = energy(time, power)
        percent.append(abs(energy(time, shown) - measured) / abs(measured) * 100)
        squares.append(float(np.sum((power - shown) ** 2)))
        count.append(len(power))
    groups = clusters(samples)
    by_motion = [sum(squares[r] for r in g) / sum(count[r] for r in g) for g in groups]
    interval = bootstrap_interval(by_motion)
    return {
        "energy_percent": float(np.mean(percent)),
        "power_rmse": float(np.sqrt(sum(squares) / sum(count))),
        "energy_percent_ci95": bootstrap_interval([float(np.mean([percent[r] for r in g])) for g in groups]),
        "power_rmse_ci95": interval and [max(x, 0.0) ** 0.5 for x in interval],
        "runs": len(percent),
        "motions": len(groups),
    }


def bootstrap_interval(values: Sequence[float]) -> list[float] | None:
    """95 % interval of the mean of values per motion, by resampling motions; None for a single motion."""
    if len(values) < 2:
        return None
    x = np.asarray(values, dtype=float)
    rng = np.random.default_rng(0)
    means = x[rng.integers(0, len(x), (DRAWS, len(x)))].mean(axis=1)
    return [float(v) for v in np.quantile(means, [0.025, 0.975])]
