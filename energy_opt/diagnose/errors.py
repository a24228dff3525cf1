"""How far a model is from the measured power and energy, over all readings of some runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from energy_opt.diagnose.evidence import bootstrap_interval
from energy_opt.diagnose.predict import predict
from energy_opt.diagnose.samples import Samples
from energy_opt.power import PowerModel


def reading_of(model: PowerModel, samples: Samples) -> list[np.ndarray]:
    """The model's power [W] at every single reading of every run."""
    power = predict(model, samples).reading
    return [
        np.interp(time, samples.t[rows], power[rows])
        for rows, (time, _) in zip(samples.slices, samples.readings, strict=True)
    ]


def errors(model: PowerModel, samples: Samples, runs: Sequence[int]) -> dict[str, Any] | None:
    """Mean energy error per run [%] and power RMSE [W] over the given runs, with bootstrap intervals over runs."""
    if not runs:
        return None
    shown = reading_of(model, samples)
    energy, squares, count = [], [], []
    for r in runs:
        time, power = samples.readings[r]
        measured = float(np.trapezoid(power, time))
        energy.append(abs(float(np.trapezoid(shown[r], time)) - measured) / abs(measured) * 100)
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
