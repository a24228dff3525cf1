"""The meter's noise as its readings at rest show it, where nothing else changes the power."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise, product

import numpy as np

from energy_opt.diagnosis.data.noise import EDGE, FLOOR, MEMORIES, Noise, Whitener, weighed
from energy_opt.diagnosis.data.samples import Samples

SETTLED, FEW = 0.5, 40  # [s] settling time of drives after a stop; least readings to estimate the noise
MOST = 2000  # readings that show a noise well enough
JUMP = 6.0  # standard deviations of the difference of neighbouring readings beyond which it is a step, not noise
SWITCHES = 0.02  # share of samples at which a signal changes; below it the signal counts as switched
# finer grid for readings at rest
FINE_WAVES = (0.0, 0.15, 0.3, 0.45, 0.6, 0.8, 1.0, 1.3, 1.7, 2.2, 3.0, 4.0, 5.0, 7.0, 10.0, 14.0, 20.0)
FINE_MEMORIES = (0.08, 0.14, 0.25, 0.42, 0.7, 1.2, 2.0)
GUESSED = (0.3, 1.0)  # the wave over the white noise where standstills are too few or too short to show it
LESS = 0.7  # least white noise at rest over the noise of single readings; a wave contributes to their differences
PLAUSIBLE = 3.0  # log odds below the likeliest noise within which others are plausible: twenty to one
Plausible = tuple[tuple[tuple[float, Noise], ...], Noise]  # noises with log odds, the likeliest first; the largest
Stretch = tuple[np.ndarray, np.ndarray]  # times [s] and readings [W]


def standing_noise(*sets: Samples) -> Plausible:
    """The meter's noise at rest: plausible ones with log odds, the likeliest first, and the largest of them.

    It is estimated from intervals at rest, each without its mean. An interval begins `SETTLED` after the arm stopped
    (if some standstills are long enough). It ends where the power jumps or a logged signal switches, because brakes
    and fans are not noise. The largest plausible noise has more correlated noise, so that its total is one standard
    deviation higher: a few standstills determine noise with a long memory only roughly.
    """
    single = sets[0].noise
    stretches = [x for samples in sets for x in _standing(samples, SETTLED)]
    if sum(len(t) for t, _ in stretches) < FEW:
        stretches = [x for samples in sets for x in _standing(samples, 0.0)]
    count = sum(len(t) for t, _ in stretches)
    if count < FEW:
        alone = [x for samples in sets for x in _standing_alone(samples)]
        if sum(len(t) for t, _ in alone) >= FEW:
            return _averaged(_estimated(_thinned(alone), sets[0].floor), sets[0])
        guesses = [Noise(single, wave * single, memory) for wave, memory in product(GUESSED, MEMORIES[1:])]
        return tuple((0.0, guess) for guess in guesses), guesses[-1]
    return _estimated(stretches, single)


def _estimated(stretches: Sequence[Stretch], single: float) -> Plausible:
    """Plausible noises of stretches at rest, and the largest, as `standing_noise` returns them.

    Args:
        stretches: times [s] and readings [W] of each. single: noise [W] of single readings.
    """
    count = sum(len(t) for t, _ in stretches)
    times = [t for t, _ in stretches]
    y = np.concatenate([p for _, p in stretches])
    levels = np.repeat(np.eye(len(times)), [len(t) for t in times], axis=0)

    def worth(wave: float, memory: float) -> tuple[float, float]:
        whiten = Whitener(Noise(1.0, wave, memory), times, np.ones(count))
        w = whiten(np.column_stack([y, levels]))
        q, _ = np.linalg.qr(w[:, 1:])
        r = w[:, 0] - q @ (q.T @ w[:, 0])
        free = count - len(times)
        white = max(float(r @ r) / free, 1e-12)
        gram = w[:, 1:].T @ w[:, 1:]
        value = -0.5 * free * np.log(white) - 0.5 * whiten.log_determinant - 0.5 * float(np.linalg.slogdet(gram)[1])
        return value, white**0.5

    found = weighed(worth, LESS * single, count - len(times), FINE_WAVES, FINE_MEMORIES)
    found.sort(key=lambda row: -row[0])
    value, best = found[0]
    odds = np.exp([v - value for v, _ in found])
    size = np.log([np.hypot(n.white, n.wave) for _, n in found])
    middle = np.average(size, weights=odds)
    most = np.exp(middle + np.average((size - middle) ** 2, weights=odds) ** 0.5)
    plausible = tuple((v - value, n) for v, n in found if v > value - PLAUSIBLE)
    return plausible, replace(best, wave=float(np.sqrt(max(most**2 - best.white**2, best.wave**2))))


def _averaged(found: Plausible, samples: Samples) -> Plausible:
    """Noises of single readings as those of the samples' readings, which are means of several."""
    apart = float(np.median(np.concatenate([np.diff(t) for t, _ in samples.single])))
    many = max(samples.step / apart, 1.0)

    def mean(noise: Noise) -> Noise:
        share = samples.step / noise.memory
        wave = noise.wave * (2 / share * (1 - (1 - np.exp(-share)) / share)) ** 0.5 if many > 1 else noise.wave
        white = max(noise.white / many**0.5, FLOOR * LESS * samples.noise)
        return replace(noise, white=white, wave=float(wave))

    return tuple((odds, mean(noise)) for odds, noise in found[0]), mean(found[1])


def _standing_alone(samples: Samples) -> list[Stretch]:
    """As `_standing`, of single readings of the meter: standstills may be shorter than a few means of these."""
    out = []
    for part, (time, power) in zip(samples.parts, samples.single, strict=True):
        at, moving = samples.at[part], samples.moving[part]
        if not len(at):  # fewer readings than a mean has
            continue
        near = np.searchsorted(at, time)
        still = ~(moving[np.clip(near, 0, len(at) - 1)] | moving[np.clip(near - 1, 0, len(at) - 1)])
        jumps = np.abs(np.diff(power, prepend=power[0])) > JUMP * 2**0.5 * samples.floor
        edges = np.flatnonzero(np.diff(np.concatenate([[False], still & ~jumps, [False]]).astype(int)))
        spans = [(a + EDGE, b - EDGE) for a, b in zip(edges[::2], edges[1::2], strict=True)]
        out += [(time[a:b], power[a:b]) for a, b in spans if b - a >= 6]
    return out


def _thinned(stretches: list[Stretch]) -> list[Stretch]:
    """Stretches of at most `MOST` readings in all, taken evenly."""
    stride = -(-sum(len(t) for t, _ in stretches) // MOST)
    return stretches[::stride]


def by_chance(noise: Noise, lasts: float) -> Noise:
    """The noise with a wave so large that its mean square over `lasts` [s] is one standard deviation higher."""
    return replace(noise, wave=noise.wave * (1 + (2 * noise.memory / lasts) ** 0.5) ** 0.5)


def _standing(samples: Samples, settled: float) -> list[Stretch]:
    """Times and readings of stretches at rest without a jump, from `settled` [s] after the arm stopped."""
    out, changes = [], [np.diff(x, prepend=x[0]) != 0 for x in samples.logged.values()]
    rare = [x for x in changes if np.mean(x) < SWITCHES]
    switched = samples.t[np.any(rare, axis=0)] if rare else np.zeros(0)
    for part in samples.parts:
        still = np.concatenate([[False], ~samples.moving[part], [False]]).astype(int)
        edges, time, power = np.flatnonzero(np.diff(still)), samples.at[part], samples.power[part]
        for first, last in zip(edges[::2], edges[1::2], strict=True):
            first = int(np.searchsorted(time, time[first] + settled))
            jumps = first + 1 + np.flatnonzero(np.abs(np.diff(power[first:last])) > JUMP * 2**0.5 * samples.noise)
            cuts = {*jumps.tolist(), *(k for k in np.searchsorted(time, switched).tolist() if first < k < last)}
            for a, b in pairwise([first, *sorted(cuts), last]):
                a, b = a + EDGE, b - EDGE  # leave out the uncertain samples next to motions
                if b - a >= 6:
                    out.append((time[a:b], power[a:b]))
    return out
