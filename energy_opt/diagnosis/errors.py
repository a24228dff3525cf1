"""How far a model is from the measured power and energy, over all readings of some runs, and beside the noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from energy_opt.diagnosis.clusters import clusters
from energy_opt.diagnosis.data import Samples
from energy_opt.diagnosis.noise import Noise
from energy_opt.diagnosis.predict import predict
from energy_opt.power import PowerModel

DRAWS = 999
SLOWER = 1.6  # times as slow is the motion that one is compared with
STATED = 0.7  # of further motions, of which the stated error is not exceeded
HALF = 0.5  # of the error above the noise, that claims must take away to be claimed where more than noise is left
DIFFERENCE = 20.0  # [%] of the difference of energy between two motions, within which a model can plan


@dataclass(frozen=True)
class Quality:
    """A model's error beside noise of the same kind of readings.

    Attributes:
        motion, rest, rmse: rms error of single readings while the arm moves and while it stands, and of all, W;
            0 where there are none.
        noise_motion, noise_rest: what the noise alone would leave there, W.
        noise: the same over all readings.
        squares: (C,) W^2, mean square error of every distinct motion or pose. least: W^2, of the meter's noise alone.
    """

    motion: float
    rest: float
    noise_motion: float
    noise_rest: float
    rmse: float
    noise: float
    squares: np.ndarray
    least: float

    @property
    def ratio(self) -> float:
        """The error over the noise, in motion, at rest or in all, whichever is worst."""
        return max(self.motion / self.noise_motion, self.rest / self.noise_rest, self.rmse / self.noise)

    @property
    def excess(self) -> float:
        """W^2, mean square above the noise, every distinct motion counted once."""
        return max(float(np.mean(self.squares)) - self.least, 0.0)

    def document(self) -> dict[str, Any]:
        """As in diagnosis.json."""
        moving, resting = (
            {"power_rmse": rms or None, "noise": noise, "ratio": rms / noise if rms else None}
            for rms, noise in ((self.motion, self.noise_motion), (self.rest, self.noise_rest))
        )
        return {"motion": moving, "rest": resting}


def halved(before: Quality, after: Quality) -> bool:
    """Is `HALF` of the error above the noise gone, over all motions and without any one of them (of three or more)?

    What an unknown law does in a single motion many effects can follow.
    """
    if after.excess > (1 - HALF) * before.excess:
        return False
    spare = (1 - HALF) * (before.squares - before.least) - (after.squares - after.least)
    return len(spare) < 3 or bool(np.sum(spare) >= np.max(spare))


def quality(model: PowerModel, samples: Samples, noise: Noise, drift: np.ndarray) -> Quality:
    """The error of a model on some runs.

    Args:
        noise: of the meter at standstill. drift: (R,) of its level in each run, W.
    """
    shown = reading_of(model, samples)
    squares, moving, allowed = [], [], []
    usual = samples.floor**2 + noise.wave**2
    runs = zip(samples.slices, samples.parts, shown, samples.single, drift, strict=True)
    for rows, part, own, (time, power), level in runs:
        squares.append((power - own) ** 2)
        live = (samples.v[rows] != 0).any(axis=1).astype(float)
        moving.append(np.interp(time, samples.t[rows], live) > 0.5)
        allowed.append(usual + level**2 + np.interp(time, samples.at[part], samples.allowed[part]))
    every, live, expected = (np.concatenate(x) for x in (squares, moving, allowed))

    def rms(x: np.ndarray, where: np.ndarray) -> float:
        return float(np.sqrt(np.mean(x[where]))) if where.any() else 0.0

    own = np.array([np.mean([np.mean(squares[r]) for r in group]) for group in clusters(samples)])
    least, always = usual**0.5, np.ones(len(live), dtype=bool)
    return Quality(
        rms(every, live), rms(every, ~live), rms(expected, live) or least, rms(expected, ~live) or least,
        rms(every, always), rms(expected, always), own, usual,
    )  # fmt: skip


def reading_of(model: PowerModel, samples: Samples) -> list[np.ndarray]:
    """The model's power [W] at every single reading of every run."""
    p = predict(model, samples)
    out = []
    for rows, part, op, (time, _) in zip(samples.slices, samples.parts, samples.operators, samples.single, strict=True):
        if op is None:
            out.append(np.interp(time, samples.t[rows], p.power[rows]))
        elif len(time) == part.stop - part.start:
            out.append(p.reading[part])
        else:  # instants of which neighbours were averaged
            out.append(np.interp(time, samples.t[rows], p.metered[rows]))
    if any(e.stage == "meter" for e in model.effects):
        out = [
            np.interp(time, samples.at[part], p.reading[part]) if op is None else shown
            for part, op, (time, _), shown in zip(samples.parts, samples.operators, samples.single, out, strict=True)
        ]
    return out


def energy(time: np.ndarray, power: np.ndarray) -> float:
    """J of readings [W] at some times [s]; of a single reading its own value."""
    return float(np.trapezoid(power, time)) if len(time) > 1 else float(power.sum())


def errors(model: PowerModel, samples: Samples, runs: Sequence[int]) -> dict[str, Any] | None:
    """Mean energy error per run [%] and power RMSE [W] over the given runs, with bootstrap intervals over motions."""
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
    return {
        "energy_percent": float(np.mean(percent)),
        "power_rmse": float(np.sqrt(sum(squares) / sum(count))),
        "energy_percent_ci95": bootstrap_interval([float(np.mean([percent[r] for r in g])) for g in groups]),
        "power_rmse_ci95": [max(x, 0.0) ** 0.5 for x in bootstrap_interval(by_motion)],
        "runs": len(percent),
        "motions": len(groups),
    }


def bootstrap_interval(values: Sequence[float], seed: int = 0) -> list[float]:
    """95 % interval of the mean of values per motion, by resampling motions."""
    x = np.asarray(values, dtype=float)
    rng = np.random.default_rng(seed)
    means = x[rng.integers(0, len(x), (DRAWS, len(x)))].mean(axis=1)
    return [float(v) for v in np.quantile(means, [0.025, 0.975])]


@dataclass(frozen=True)
class Foreseen:
    """How well a model foresees what a plan changes: energies of motions of the same ends in the same time.

    Attributes:
        percent: error of the difference of energy between going evenly and going `SLOWER` times as fast and waiting,
            over that difference, %: with probability `STATED` a further motion has less (conformal over motions).
        motions: how many distinct ones the set has.
    """

    percent: float | None
    motions: int


def foreseen(model: PowerModel, samples: Samples, noise: Noise, offset: float) -> Foreseen:
    """The error of energies over a set's distinct motions, beside what going faster and waiting changes there.

    A motion's error is e = measured - model [J] less the common level, which two plans of the same time share; the
    errors of two plans differ by about sqrt(2) |e|. What the meter's noise adds to an energy is taken off first, in
    squares. The difference is the model's own, in rms over the motions.

    Args:
        noise: of the meter at standstill. offset: of its level from run to run, W.
    """
    shown = reading_of(model, samples)
    slow = replace(samples.bare(), v=samples.v / SLOWER, a=samples.a / SLOWER**2, t=samples.t * SLOWER)
    fast_power, slow_power = (predict(model, s).power for s in (samples, slow))
    errors_, lasting, changes = [], [], []
    for group in clusters(samples):
        if samples.kinds[group[0]] != "motion":
            continue
        error, change, length = [], [], []
        for r in group:
            (time, power), rows = samples.single[r], samples.slices[r]
            own = samples.t[rows]
            error.append(energy(time, power) - energy(time, shown[r]))
            length.append(float(np.ptp(own)))
            waiting = fast_power[rows][-1] * (SLOWER - 1) * length[-1]
            change.append(energy(own, fast_power[rows]) + waiting - energy(slow.t[rows], slow_power[rows]))
        errors_.append(float(np.mean(error)))
        lasting.append(float(np.mean(length)))
        changes.append(float(np.mean(change)))
    if not errors_:
        return Foreseen(None, 0)
    e, time = np.array(errors_), np.array(lasting)
    e = e - time * (e @ time) / max(float(time @ time), 1e-9)
    by_noise = (noise.white**2 * samples.step + 2 * noise.wave**2 * noise.memory) * time + (offset * time) ** 2
    own = np.sqrt(np.maximum(e**2 - by_noise, 0.0))
    scores = np.sort(2**0.5 * own / max(float(np.sqrt(np.mean(np.square(changes)))), 1e-9))
    rank = min(int(np.ceil((len(scores) + 1) * STATED)), len(scores))
    return Foreseen(100 * float(scores[rank - 1]), len(scores))


def usable(ahead: Foreseen, after: dict[str, Any] | None, tolerance: float) -> bool:
    """Is the difference foreseen within `DIFFERENCE`, and energies (as `errors`) within `tolerance` %?"""
    known = ahead.percent is not None and after is not None
    return bool(known and ahead.percent <= DIFFERENCE and after["energy_percent"] <= tolerance)  # type: ignore[operator, index]
