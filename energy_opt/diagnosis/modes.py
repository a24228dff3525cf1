"""Levels of power while the arm is at rest: motors on, brakes on, drives off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from energy_opt.diagnosis.data import Samples
from energy_opt.diagnosis.errors import reading_of
from energy_opt.power import PowerModel

LEAST = 1.0  # [s] shortest duration of a level
# levels differ by more than this [W], this share of the power, and this multiple of the noise
APART, SHARE, NOISES = 3.0, 0.05, 6.0


@dataclass(frozen=True)
class Mode:
    """A level of power at rest: mean [W] without the power of holding the pose, duration [s], number of standstills."""

    power: float
    seconds: float
    standstills: int


def modes_of(model: PowerModel, samples: Samples) -> list[Mode]:
    """Levels of power in a set's standstills, highest first.

    The model's power of each pose is subtracted first, so that holding a weight is no level of its own. A standstill is
    split where the mean changes most, recursively, while both parts are long enough and differ.
    """
    standby = model.get("standby")
    level = float(standby.values["power"][0]) if standby is not None else 0.0
    apart = max(APART, SHARE * level, NOISES * samples.floor)
    found: list[tuple[float, float, int]] = []  # level [W], duration [s], index of the standstill
    count = 0
    for span, (time, power), own in zip(samples.slices, samples.single, reading_of(model, samples), strict=True):
        live = (samples.v[span] != 0).any(axis=1).astype(float)
        still = np.concatenate([[False], np.interp(time, samples.t[span], live) == 0, [False]])
        edges = np.flatnonzero(np.diff(still.astype(int)))
        for a, b in zip(edges[::2], edges[1::2], strict=True):
            rest = level + power[a:b] - own[a:b]
            found += [(x, seconds, count) for x, seconds in _plateaus(time[a:b], rest, apart)]
            count += 1
    out: list[list[tuple[float, float, int]]] = []
    for plateau in sorted(found, reverse=True):
        if out and out[-1][-1][0] - plateau[0] < apart:
            out[-1].append(plateau)
        else:
            out.append([plateau])
    return [
        Mode(
            float(np.average([x for x, _, _ in group], weights=[s for _, s, _ in group])),
            float(sum(s for _, s, _ in group)),
            len({k for _, _, k in group}),
        )
        for group in out
    ]


def _plateaus(time: np.ndarray, power: np.ndarray, apart: float) -> list[tuple[float, float]]:
    """Mean [W] and duration [s] of the levels of one standstill."""
    lasts = float(time[-1] - time[0]) if len(time) else 0.0
    if lasts < LEAST:
        return []
    inner = np.flatnonzero((time - time[0] >= LEAST) & (time[-1] - time >= LEAST))
    if inner.size:
        before, count = np.cumsum(power)[inner - 1], inner.astype(float)
        left, right = before / count, (power.sum() - before) / (len(power) - count)
        at = int(np.argmax(count * (len(power) - count) * (left - right) ** 2))
        if abs(left[at] - right[at]) > apart:
            cut = int(inner[at])
            return _plateaus(time[:cut], power[:cut], apart) + _plateaus(time[cut:], power[cut:], apart)
    return [(float(np.median(power)), lasts)]


def mode_words(modes: list[Mode]) -> list[str]:
    """A remark if there are several levels."""
    if len(modes) < 2:
        return []
    each = ", ".join(f"{m.power:.4g} W ({m.seconds:.3g} s in {m.standstills} standstills)" for m in modes)
    return [f"Power at rest has {len(modes)} levels (for example motors on, brakes on, drives off): {each}."]
