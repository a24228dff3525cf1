"""Bounded nonlinear least squares of a hypothesis on samples: Gauss-Newton steps on exact derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.diagnose.predict import predict
from energy_opt.diagnose.samples import Samples
from energy_opt.diagnose.terms import Chart, Term, chart
from energy_opt.power import PowerModel

ITERATIONS = 30  # at most
FALLING = 0.02  # a fit that still falls by this share at a step goes on whatever it was allowed
ENOUGH = 0.02  # a step that lowers the loss by less ends the fit


@dataclass(frozen=True)
class Extra:
    """An unlisted structure: linear columns (N, c), times the samples' weight, by family, joint and setting."""

    family: str
    joint: int
    setting: float
    columns: np.ndarray


@dataclass(frozen=True)
class Fit:
    """A fitted hypothesis.

    Attributes:
        terms, extras: what it adds; `starts` the free numbers of each term, `weights` those of the extras.
        model: the declared model with the terms' values.
        residual: (N,) W and jacobian (N, K) by all free numbers, both times the samples' weight; loss: sum of
            squares over the meter's noise variance.
        evaluations: of the model, in this fit.
    """

    terms: tuple[Term, ...]
    extras: tuple[Extra, ...]
    charts: tuple[Chart, ...]
    numbers: tuple[np.ndarray, ...]
    weights: np.ndarray
    model: PowerModel
    residual: np.ndarray
    jacobian: np.ndarray
    loss: float
    evaluations: int

    @property
    def count(self) -> int:
        """Free numbers; an extra's setting counts as one more."""
        return sum(len(z) for z in self.numbers) + len(self.weights) + len(self.extras)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(term.name for term in self.terms)


def fit(
    samples: Samples,
    declared: PowerModel,
    terms: Sequence[Term],
    starts: Sequence[np.ndarray],
    extras: Sequence[Extra] = (),
    iterations: int = ITERATIONS,
) -> Fit:
    """Fit the terms' numbers, from `starts` (one vector per term), and the extras' weights.

    Each step solves the linearised problem within the bounds; a step that does not lower the loss is shortened.
    """
    charts = tuple(chart(term, declared, samples.n) for term in terms)
    lower = np.concatenate([c.lower for c in charts] or [np.zeros(0)])
    upper = np.concatenate([c.upper for c in charts] or [np.zeros(0)])
    z = np.clip(np.concatenate([*starts, np.zeros(0)]), lower, upper)
    cuts: list[int] = np.cumsum([len(c.lower) for c in charts])[:-1].tolist()
    added = np.column_stack([e.columns for e in extras]) if extras else np.zeros((len(samples.power), 0))
    scale = 1 / samples.noise
    trust = samples.weight

    def state(
        z: np.ndarray, weights: np.ndarray | None
    ) -> tuple[PowerModel, np.ndarray, np.ndarray, np.ndarray, float]:
        model = declared
        parts = np.split(z, cuts) if charts else []
        for c, numbers in zip(charts, parts, strict=True):
            model = model.replaced(c.term.effect(c.values(numbers), samples.n))
        p = predict(model, samples)
        where = dict(zip((e.name for e in model.effects), model.slices(samples.n), strict=True))
        columns = [p.jacobian[:, where[c.term.name]] @ c.slope(x) for c, x in zip(charts, parts, strict=True)]
        own = np.column_stack(columns) * trust[:, None] if columns else np.zeros((len(trust), 0))
        jacobian = np.column_stack([own, added])
        residual = (samples.power - p.reading) * trust
        if added.shape[1]:
            if weights is None:
                weights = np.linalg.lstsq(added, residual, rcond=None)[0]
            residual = residual - added @ weights
        else:
            weights = np.zeros(0)
        return model, residual, jacobian, weights, float(residual @ residual) * scale**2

    model, residual, jacobian, weights, loss = state(z, None)
    evaluations = 1
    for k in range(ITERATIONS if charts else 0):
        step = _bounded_step(jacobian, residual, lower - z, upper - z, len(weights))
        moved = False
        for shorten in (1.0, 0.5, 0.2, 0.05):
            trial = np.clip(z + shorten * step[: len(z)], lower, upper)
            evaluations += 1
            new = state(trial, weights + shorten * step[len(z) :])
            if np.isfinite(new[4]) and new[4] < loss:
                moved = True
                break
        if not moved:
            break
        gained = loss - new[4]
        z, (model, residual, jacobian, weights, loss) = trial, new
        if gained < ENOUGH or (k >= iterations - 1 and gained < FALLING * loss):
            break
    parts = tuple(np.split(z, cuts)) if charts else ()
    return Fit(tuple(terms), tuple(extras), charts, parts, weights, model, residual, jacobian, loss, evaluations)


def _bounded_step(
    jacobian: np.ndarray, residual: np.ndarray, low: np.ndarray, high: np.ndarray, free: int
) -> np.ndarray:
    """Least-squares step with each entry within [low, high]; the last `free` entries have no bounds."""
    size = np.linalg.norm(jacobian, axis=0)
    size[size == 0] = 1.0
    k = len(size)
    q, r = np.linalg.qr(jacobian / size)
    target = q.T @ residual
    r = np.vstack([r, 1e-6 * np.eye(k)])  # keeps what the data leave open where it is
    target = np.concatenate([target, np.zeros(k)])
    low = np.concatenate([low, np.full(free, -np.inf)]) * size
    high = np.concatenate([high, np.full(free, np.inf)]) * size
    return bounded_least_squares(r, target, low, high) / size


def bounded_least_squares(a: np.ndarray, b: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """min |a x - b| with low <= x <= high, low <= 0 <= high, by an active set; a has full column rank."""
    x, *_ = np.linalg.lstsq(a, b, rcond=None)
    if (x >= low).all() and (x <= high).all():
        return x
    from scipy.optimize import lsq_linear

    pinned = high - low < 1e-14
    high = np.where(pinned, low + 1e-12, high)
    return np.asarray(lsq_linear(a, b, (low, high), method="bvls", max_iter=200).x)
