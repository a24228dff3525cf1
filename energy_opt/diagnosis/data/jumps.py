"""Errors of a model's power beside jumps of the acceleration, whose exact times smoothed positions do not show.

Beside a jump, a lower cut-off changes velocities and accelerations as the smoothing itself does, see `Kinematics`. The
model's power at the changed motion, less that at the motion, is the error. It has both signs beside each jump, so what
counts is its mean square over the smoothing's period.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from energy_opt.diagnosis.data.noise import weighted
from energy_opt.diagnosis.data.predict import Prediction, predict
from energy_opt.diagnosis.data.samples import Samples
from energy_opt.power import PowerModel

# Step of a power over the rms error that smoothing causes beside it within 1 / f_c, with the smoother's response H(x):
# the root of 2 pi^2 / int_0^inf (1 - H(x))^2 x^-2 dx
JUMP = 4.8
# Share of the rms error that a mean over `BIN` leaves, as the error has both signs; seen in trapezoids at 100 to 500 Hz
LEFT = 0.4
SHORTEST = 3  # nodes of a run up to which no interval between them has two neighbours


def known_by(model: PowerModel, samples: Samples, repeats: Sequence[int]) -> tuple[Samples, Prediction]:
    """The samples with weights by all errors of clocks and positions, see `weighted`, and the model's prediction."""
    now = predict(model, samples)
    return weighted(samples, now, repeats, of_readings(samples, beside_jumps(model, samples, now))), now


def beside_jumps(model: PowerModel, samples: Samples, now: Prediction) -> np.ndarray:
    """Error (K,) [W] of the power of `model` beside jumps, with its sign; `now`: its prediction at the samples."""
    if not samples.jumps.any():
        return np.zeros(len(samples.q))
    return predict(model, samples.shifted).power - now.power


def of_readings(samples: Samples, error: np.ndarray) -> np.ndarray:
    """Rms error (M,) [W] of the readings, each over its window, from the error (K,) at the nodes."""
    out = np.zeros(len(samples.power))
    for k, period in enumerate(samples.periods):
        span, part, op = samples.slices[k], samples.parts[k], samples.operators[k]
        own = error[span] * (1.0 if samples.counts[k] == 1 else LEFT) if op is None else op @ error[span]
        out[part] = _rms(samples.at[part], own, period)
    return out


def of_single(samples: Samples, error: np.ndarray, power: np.ndarray) -> list[np.ndarray]:
    """Variance [W^2] of every single reading of the meter by these errors, an array for each run.

    Between nodes, a step s of the power adds to it: where in the interval it lies is not known. At a share u of the
    interval the reading has the variance u (1 - u) s^2, whose mean is s^2 / 6. What the power changes in both
    neighbouring intervals is no step. Steps are at most as large as such errors show, except where a joint turns:
    friction then changes its sign.

    Args:
        error: (K,) W. power: (K,) [W] at the nodes.
    """
    readings, out = of_readings(samples, error), []
    for k, (span, part, op) in enumerate(zip(samples.slices, samples.parts, samples.operators, strict=True)):
        time, averaged = samples.single[k][0], samples.counts[k] > 1 and span.stop - span.start > SHORTEST
        turns = (samples.v[span][1:] * samples.v[span][:-1] < 0).any(axis=1)
        if not (error[span].any() or (averaged and turns.any())):
            out.append(np.zeros(len(time)))
        elif op is not None and len(time) == part.stop - part.start:
            out.append(readings[part] ** 2)
        else:
            at = samples.t[span]
            size = _rms(at, error[span], samples.periods[k])
            variance = np.interp(time, at, size**2)
            if averaged:
                change = np.abs(np.diff(power[span]))
                step = np.maximum(change - np.convolve(change, [0.5, 0.0, 0.5], "same"), 0.0)
                step = np.where(turns, step, np.minimum(step, JUMP * np.maximum(size[1:], size[:-1])))
                variance += step[np.clip(np.searchsorted(at, time) - 1, 0, len(step) - 1)] ** 2 / 6
            out.append(variance)
    return out


def _rms(time: np.ndarray, values: np.ndarray, period: float) -> np.ndarray:
    """Root of the mean square of values (N,) over a `period` [s] around each time (N,) [s]."""
    total = np.concatenate([[0.0], np.cumsum(values**2)])
    first = np.searchsorted(time, time - period / 2)
    last = np.searchsorted(time, time + period / 2, side="right")
    return np.asarray(np.sqrt((total[last] - total[first]) / np.maximum(last - first, 1)))
