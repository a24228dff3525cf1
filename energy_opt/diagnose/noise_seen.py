"""The meter's noise as the data show it: at standstill, and in what a fit leaves."""

from __future__ import annotations

from itertools import product

import numpy as np

from energy_opt.diagnose.fit import Fit
from energy_opt.diagnose.noise import Noise, Whitener
from energy_opt.diagnose.samples import Samples

WAVES, MEMORIES = (0.0, 0.3, 0.6, 1.0, 1.7, 3.0, 5.0), (0.08, 0.25, 0.7, 2.0)  # over white noise; s


def standing_noise(samples: Samples) -> Noise:
    """The meter's noise while the arm stands still, each stretch's own mean taken out."""
    stretches: list[tuple[np.ndarray, np.ndarray]] = []
    for part in samples.parts:
        still = np.concatenate([[False], ~samples.moving[part], [False]]).astype(int)
        edges = np.flatnonzero(np.diff(still))
        for a, b in zip(edges[::2], edges[1::2], strict=True):
            a, b = a + 2, b - 2  # what is doubted of a motion's ends
            if b - a >= 6:
                stretches.append((samples.at[part][a:b], samples.power[part][a:b]))
    count = sum(len(t) for t, _ in stretches)
    if count < 40:
        return Noise(samples.noise, 0.3 * samples.noise, 0.5)
    times = [t for t, _ in stretches]
    y = np.concatenate([p for _, p in stretches])
    levels = np.zeros((count, len(times)))
    at = 0
    for k, t in enumerate(times):
        levels[at : at + len(t), k] = 1.0
        at += len(t)

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

    return _likeliest(worth, samples.noise)


def noise_of(f: Fit) -> Noise:
    """The noise under which a fit's residual is likeliest, its numbers integrated out."""
    s, count = f.world.samples, len(f.residual)
    times = [s.at[p] for p in s.parts]
    old = f.world.whiten.noise
    raw = np.column_stack([f.residual, _unwhitened(f)])
    off = f.theta - f.mean
    penalty = float(off @ f.precision @ off)
    here = [w for w in WAVES if 0.2 * old.wave <= w * old.white <= 5 * max(old.wave, 0.6 * old.white)] or list(WAVES)

    def worth(wave: float, memory: float) -> tuple[float, float]:
        whiten = Whitener(Noise(1.0, wave, memory), times, s.weight)
        w = whiten(raw)
        white = max((float(w[:, 0] @ w[:, 0]) + penalty) / count, 1e-12)
        hessian = w[:, 1:].T @ w[:, 1:] / white + f.precision
        value = -0.5 * count * np.log(white) - 0.5 * whiten.log_determinant - 0.5 * float(np.linalg.slogdet(hessian)[1])
        return value, white**0.5

    return _likeliest(worth, s.noise, here)


def _unwhitened(f: Fit) -> np.ndarray:
    """Columns (M, P) of a fit by theta, W."""
    p, s = f.prediction, f.world.samples
    where = dict(zip((e.name for e in f.model.effects), f.model.slices(s.n), strict=True))
    own = [p.jacobian[:, where[c.term.name]] @ c.slope(z) for c, z in zip(f.charts, f.numbers, strict=True)]
    return np.column_stack([*own, *(g.columns for g in f.free), p.pushed, f.world.offsets])


def _likeliest(worth, least: float, waves=WAVES) -> Noise:  # type: ignore[no-untyped-def]
    """The noise of greatest worth, (value, white) by the wave over white noise and its memory, on a grid."""
    rows = [(*worth(w, m), w, m) for w, m in product(waves, MEMORIES) if w or m == MEMORIES[0]]
    _, white, wave, memory = max(rows)
    white = max(white, 0.8 * least)
    return Noise(white, wave * white, memory)
