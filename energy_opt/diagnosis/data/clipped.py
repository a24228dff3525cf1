"""Readings of a meter that stops at a limit: they are left out, as no law of an arm explains them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from energy_opt.diagnosis.data.predict import predict
from energy_opt.diagnosis.data.samples import Samples
from energy_opt.diagnosis.data.standing import standing_noise
from energy_opt.measured import MeasuredSet
from energy_opt.power import PowerModel

FEW = 10  # least readings at a limit
ALIKE = 1.5  # their largest scatter over the meter's noise
VARIED = 3.0  # least scatter of the model's power there, and distance from the limit of the readings that stay, over it


def unclipped(measured: MeasuredSet, samples: Samples, model: PowerModel) -> MeasuredSet:
    """The set without readings at a limit of the meter, if there is one.

    Where the model's power exceeds the largest reading, in several runs, the readings are then alike, and the model's
    power is not.
    """
    now = predict(model, samples).reading
    over = samples.moving & (now > samples.power.max(initial=-np.inf))
    if over.sum() < FEW or sum(bool(over[part].any()) for part in samples.parts) < 2:
        return measured
    (_, noise), *_ = standing_noise(samples)[0]
    size = float(np.hypot(noise.white, noise.wave))
    if np.std(samples.power[over]) > ALIKE * size or np.std(now[over]) < VARIED * size:
        return measured
    limit, single = float(np.median(samples.power[over])), float(np.hypot(samples.floor, noise.wave))
    runs = []
    for run in measured.runs:
        kept = run.power < limit - VARIED * single
        read = replace(run, power_time=run.power_time[kept], power=run.power[kept], window=run.window[kept])
        runs.append(read if kept.any() else run)
    count = sum(len(run.power) for run in measured.runs) - sum(len(run.power) for run in runs)
    remark = (
        f"Readings stop at {limit:.4g} W, where the declared model predicts up to {now.max():.4g} W: is the meter "
        f"clipped? {count} readings there are left out."
    )
    return replace(measured, runs=tuple(runs), remarks=(*measured.remarks, remark))
