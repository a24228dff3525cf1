"""How far a model is from the measured power and energy, over all readings of some runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from energy_opt.diagnose.predict import predict
from energy_opt.diagnose.samples import Samples
from energy_opt.power import PowerModel

DRAWS = 999


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


def energy_errors(model: PowerModel, samples: Samples) -> np.ndarray:
    """Error of every run's energy (R,), as a share of the measured one, with its sign."""
    out = []
    for shown, (time, power) in zip(reading_of(model, samples), samples.single, strict=True):
        measured = _energy(time, power)
        out.append((_energy(time, shown) - measured) / abs(measured))
    return np.array(out)


def _energy(time: np.ndarray, power: np.ndarray) -> float:
    return float(np.trapezoid(power, time)) if len(time) > 1 else float(power.sum())


def errors(model: PowerModel, samples: Samples, runs: Sequence[int]) -> dict[str, Any] | None:
    """Mean energy error per run [%] and power RMSE [W] over the given runs, with bootstrap intervals over runs."""
    if not runs:
        return None
    shown = reading_of(model, samples)
    energy, squares, count = [], [], []
    for r in runs:
        time, power = samples.single[r]
        measured = _energy(time, power)
        energy.append(abs(_energy(time, shown[r]) - measured) / abs(measured) * 100)
        squares.append(float(np.sum((power - shown[r]) ** 2)))
        count.append(len(power))
    mean_squares = [s / c for s, c in zip(squares, count, strict=True)]
    interval = [max(x, 0.0) ** 0.5 for x in bootstrap_interval(mean_squares)]
    return {
        "energy_percent": float(np.mean(energy)),
        "power_rmse": float(np.sqrt(sum(squares) / sum(count))),
        "energy_percent_ci95": bootstrap_interval(energy),
        "power_rmse_ci95": interval,
        "runs": len(energy),
    }


def bootstrap_interval(values: Sequence[float], seed: int = 0) -> list[float]:
    """95 % interval of the mean of per-run values, by resampling runs."""
    x = np.asarray(values, dtype=float)
    if len(x) == 0:
        return []
    rng = np.random.default_rng(seed)
    means = x[rng.integers(0, len(x), (DRAWS, len(x)))].mean(axis=1)
    return [float(v) for v in np.quantile(means, [0.025, 0.975])]


def usable(errors: np.ndarray, tolerance: float) -> bool:
    """Is the mean energy error of runs (R,) within +- `tolerance`, by two one-sided tests at 5 % (equivalence)?

    With fewer than three runs the tests cannot tell; then every run must lie within half of the tolerance.
    """
    from scipy.stats import t

    count = len(errors)
    if count == 0:
        return False
    if count < 3:
        return bool(np.abs(errors).max() < tolerance / 2)
    mean, spread = float(errors.mean()), float(errors.std(ddof=1)) / count**0.5
    return bool(abs(mean) + float(t.ppf(0.95, count - 1)) * spread < tolerance)
