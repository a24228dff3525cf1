"""The residual of a hypothesis, and the signals that it correlates with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.diagnosis.candidates import functions
from energy_opt.diagnosis.data import Samples
from energy_opt.diagnosis.evidence import STEADY
from energy_opt.diagnosis.fit import Fit, Free
from energy_opt.diagnosis.predict import Prediction

LEVELS = 0.03  # share of the arm's level by which the levels of runs may differ, as meters drift


WEAKEST = 0.05  # least share of the residual that a named signal explains
MOST = 8


@dataclass(frozen=True)
class Attribution:
    """A signal that a part of the residual follows.

    Attributes:
        signal: its name. joint: name, or None. strength: share of the residual. watts: rms of this part [W].
    """

    signal: str
    joint: str | None
    strength: float
    watts: float


def goes_with(f: Fit, free: Sequence[Free], joints: Sequence[str]) -> list[Attribution]:
    """Signals that the residual of a fit follows, the strongest first.

    The strength of a signal is the share that a function of it predicts in parts of runs that it was not fitted to; or,
    for functions in `free`, which the search has accepted, the share that it removes where it is fitted.

    Args:
        f: the fit. free: accepted free functions. joints: names.
    """
    samples = f.world.samples
    rest = f.residual * samples.weight
    open_part = max(float(rest @ rest) - len(rest) * f.world.whiten.noise.white**2, 1e-9)
    chosen = {g.signal for g in free}
    records: list[Attribution] = []
    for g in functions(f):
        for joint, columns in _by_joint(g, samples.n):
            own = g.signal in chosen and (joint is None or columns.shape[1] == g.columns.shape[1])
            watts = _removed(f, rest, columns, g.size, own)
            strength = float(np.clip(watts**2 * len(rest) / open_part, 0.0, 1.0))
            if strength > WEAKEST:
                records.append(Attribution(g.signal, joints[joint] if joint is not None else None, strength, watts))
    if wandering(f):
        records.append(Attribution("time (run to run)", None, 1.0, float(np.std(f.levels))))
    best: dict[tuple[str, str | None], Attribution] = {}
    for row in records:
        held = best.get((row.signal, row.joint))
        if held is None or row.strength > held.strength:
            best[row.signal, row.joint] = row
    return sorted(best.values(), key=lambda row: (row.signal not in chosen, -row.watts))[:MOST]


def wandering(f: Fit) -> bool:
    """True if the levels of the runs differ by more than the drift of a meter."""
    apart = float(np.ptp(f.levels))
    return apart > LEVELS * (f.world.scale.level + STEADY) and apart > 6 * float(np.median(f.level_deviations))


def _by_joint(g: Free, n: int) -> list[tuple[int | None, np.ndarray]]:
    """Columns of a function split by joint, or (None, all columns) if the signal does not belong to single joints."""
    if g.signal.startswith("time") or g.columns.shape[1] % n or g.signal == "temperature":
        return [(None, g.columns)]
    count = g.columns.shape[1] // n
    return [(j, g.columns[:, j * count : (j + 1) * count]) for j in range(n)]


def _removed(f: Fit, rest: np.ndarray, columns: np.ndarray, size: float, accepted: bool) -> float:
    """Rms [W] that a free function removes in quarters of every run that it was not fitted to.

    Of a function that the search has `accepted`: the rms that it removes where it is fitted.
    """
    samples = f.world.samples
    columns = columns * samples.weight[:, None]
    half = np.concatenate([(np.arange(p.stop - p.start) * 4 // max(p.stop - p.start, 1)) % 2 for p in samples.parts])
    before = (f.world.whiten.noise.white / size) ** 2 * np.eye(columns.shape[1])
    everywhere, gained = np.ones(len(half), dtype=bool), 0.0
    for fitted, judged in [(everywhere, everywhere)] if accepted else [(half == 0, half != 0), (half != 0, half == 0)]:
        own = columns[fitted]
        weights = np.linalg.solve(own.T @ own + before, own.T @ rest[fitted])
        gained += float(np.sum(rest[judged] ** 2) - np.sum((rest[judged] - columns[judged] @ weights) ** 2))
    return float(np.sqrt(max(gained, 0.0) / len(rest)))


LAGS = (-0.2, 0.0, 0.2, 0.5)  # [s] lags of the meter that are tried
SHIFTS = 199
CHANCE = 0.2  # largest p-value at which the power counts as following the motion
ROUGH_CHANCE = 0.01  # the same if neighbouring readings hardly correlate, as in noise
ALIKE = 0.5  # least correlation of neighbouring samples of an arm's power
FEW = 3.0  # least readings per column; with fewer, the columns fit anything
SHOWN = 0.5  # share of the meter's noise below which variations of mechanical power are not visible


def follows(samples: Samples, now: Prediction, seed: int = 0) -> bool:
    """False if the power follows the motion no better than by chance.

    Args: now: the declared model at the samples. The power must correlate with its mechanical power, torques, reading
    or the speed, which friction follows.
    """
    mechanical = np.einsum("nj,nj->n", now.tau, samples.v)
    speed = np.abs(samples.v)
    heat, lost, dragged = np.sum(now.tau**2, axis=1), speed.sum(axis=1), np.sum(speed**2, axis=1)
    columns = _centred(samples.shown(np.column_stack([mechanical, heat, now.power, lost, dragged])), samples)
    if np.std(columns[:, 0]) < SHOWN * samples.noise:
        return True
    lags = [lag for lag in LAGS if lag == 0 or abs(lag) > samples.step / 2]
    lagged = np.column_stack([_shifted(columns, samples, lag) for lag in lags])
    if len(lagged) - len(samples.parts) < FEW * lagged.shape[1]:
        return True
    u, s, _ = np.linalg.svd(lagged / np.maximum(np.linalg.norm(lagged, axis=0), 1e-12), full_matrices=False)
    u = u[:, s > 1e-6 * s[0]]
    power = _centred(samples.power[:, None], samples)[:, 0]
    seen = float(np.sum((u.T @ power) ** 2))
    rng = np.random.default_rng(seed)
    by_chance = 0
    for _ in range(SHIFTS):
        turned = np.concatenate([np.roll(power[s], rng.integers(1, max(s.stop - s.start, 2))) for s in samples.parts])
        by_chance += float(np.sum((u.T @ turned) ** 2)) >= seen
    together = sum(float(power[s][1:] @ power[s][:-1]) for s in samples.parts)
    rough = together < ALIKE * float(power @ power)
    return (1 + by_chance) / (SHIFTS + 1) <= (ROUGH_CHANCE if rough else CHANCE)


def _centred(x: np.ndarray, samples: Samples) -> np.ndarray:
    """Columns (N, c) less their mean in each run."""
    return np.concatenate([x[s] - x[s].mean(axis=0) for s in samples.parts])


def _shifted(x: np.ndarray, samples: Samples, lag: float) -> np.ndarray:
    """Columns (N, c) delayed by `lag` seconds, the ends of each run held."""
    out = np.empty_like(x)
    for s in samples.parts:
        t = samples.at[s]
        for k in range(x.shape[1]):
            out[s, k] = np.interp(t - lag, t, x[s, k])
    return out
