"""Candidates for the next effect, judged by how much of the residual their linearised columns would take away."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.diagnose.fit import Fit, bounded_least_squares
from energy_opt.diagnose.predict import predict
from energy_opt.diagnose.samples import Samples
from energy_opt.diagnose.terms import Chart, Term, chart
from energy_opt.effects import Effect, MeterEffect, known_effects
from energy_opt.power import PowerModel

NOT_SOUGHT = (
    "friction_curve", "asymmetric_friction", "power_law_friction", "thermal_viscous", "psu_loss", "iron_loss",
    "dc_link", "idle_hold", "run_offset", "link_inertia",
)  # fmt: skip
SOAKED = 0.1  # of what is left that a further joint's spring must take away


@dataclass(frozen=True)
class Candidate:
    """A term that may be added, its columns (N, c) at the current model, bounds of their weights, and a start."""

    term: Term
    columns: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    origin: np.ndarray  # numbers z at weight 0

    def start(self, weights: np.ndarray) -> np.ndarray:
        """Numbers z to start a fit from, given the columns' best weights."""
        z = self.origin.copy()
        z[: len(weights)] += weights
        return z


def candidates(current: Fit, declared: PowerModel, samples: Samples) -> Iterator[Candidate]:
    """Every effect of the table that the hypothesis does not free already, in each of its variants."""
    taken, model = set(current.names), current.model
    now = predict(model, samples)
    absent = []
    for kind in known_effects().values():
        if kind.name in taken or kind.name in NOT_SOUGHT:
            continue
        held = declared.get(kind.name)
        if held is not None:
            yield from _declared(kind, held, now.jacobian, model, declared, samples)
        elif issubclass(kind, MeterEffect):
            yield from _meter(kind, now.reading, samples)
        elif all(model.get(name) is not None for name in kind.needs):
            absent += [kind] if kind.sought else []
    yield from _absent(absent, model, declared, samples)


def _modes(kind: type[Effect]) -> tuple[str, ...]:
    if not any(p.per_joint for p in kind.parameters):
        return ("number",)
    return ("shared", "joint") if kind.same_on_all_joints else ("joint",)


def _declared(
    kind: type[Effect], held: Effect, jacobian: np.ndarray, model: PowerModel, declared: PowerModel, samples: Samples
) -> Iterator[Candidate]:
    where = dict(zip((e.name for e in model.effects), model.slices(samples.n), strict=True))
    own = jacobian[:, where[kind.name]]
    options = tuple(f"{k}={v}" for k, v in sorted(held.choices.items()))
    per_joint = any(q.per_joint for q in kind.parameters)
    zero = not np.any(held.full(samples.n))
    modes = (("shared", "joint") if zero else ("scale", "joint")) if per_joint else ("number",)
    for mode in modes:
        term = Term(kind.name, mode, options, declared=True)
        c = chart(term, declared, samples.n)
        z0 = _numbers(c, held)
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = c.slope(z0)
        if np.isfinite(slope).all():  # it has none where nothing is there, as at a payload of no mass
            yield Candidate(term, own @ slope, c.lower - z0, c.upper - z0, z0)


def _numbers(c: Chart, effect: Effect) -> np.ndarray:
    """The numbers z at which a chart is nearest to an effect's values."""
    return np.linalg.lstsq(c.matrix, c.term.kind.to_chart(effect.full(c.n), c.n) - c.base, rcond=None)[0]


def _meter(kind: type[MeterEffect], now: np.ndarray, samples: Samples) -> Iterator[Candidate]:
    """By its slope, or tried at several sizes: what it would make of the reading `now` (N,)."""
    term, p = Term(kind.name, "number"), kind.parameters[0]
    neutral = np.array([p.neutral])
    if not p.trials:
        slopes = [kind.sensitivity(samples.t[rows], now[rows], p.neutral) for rows in samples.slices]
        low, high = (np.array([bound - p.neutral]) for bound in p.bounds)
        yield Candidate(term, np.concatenate(slopes)[:, None], low, high, neutral)
    for trial in p.trials:
        away = trial - p.neutral
        changed = [kind.reading(samples.t[rows], now[rows], trial) - now[rows] for rows in samples.slices]
        ends = sorted((0.0, 3 * away))
        yield Candidate(term, np.concatenate(changed)[:, None] / away, np.array(ends[:1]), np.array(ends[1:]), neutral)


def _absent(
    kinds: Sequence[type[Effect]], model: PowerModel, declared: PowerModel, samples: Samples
) -> Iterator[Candidate]:
    """Effects that the model lacks, all at once at values where they change nothing, for each trial of their shapes."""
    n = samples.n
    for option in range(2):
        for trial in range(max((len(_trials(kind)) for kind in kinds), default=1)):
            chosen = [kind for kind in kinds if _has(kind, option, trial)]
            if not chosen:
                continue
            effects = [_idle(kind, option, trial, n) for kind in chosen]
            whole = model
            for effect in effects:
                whole = whole.replaced(effect)
            jacobian = predict(whole, samples).jacobian
            where = dict(zip((e.name for e in whole.effects), whole.slices(n), strict=True))
            for kind, effect in zip(chosen, effects, strict=True):
                options = tuple(f"{key}={word}" for key, word in sorted(effect.choices.items()))
                for mode in _modes(kind):
                    term = Term(kind.name, mode, options)
                    c = chart(term, declared, n)
                    z0 = _numbers(c, effect)
                    columns = jacobian[:, where[kind.name]] @ c.slope(z0)
                    width = columns.shape[1] - (1 if kind.parameters[-1].trials else 0)
                    yield Candidate(term, columns[:, :width], (c.lower - z0)[:width], (c.upper - z0)[:width], z0)


def _has(kind: type[Effect], option: int, trial: int) -> bool:
    """True where an effect has a variant of this option and trial of shape."""
    words = max((len(choices) for choices in kind.options.values()), default=1)
    return option < words and trial < len(_trials(kind))


def _trials(kind: type[Effect]) -> tuple[float, ...]:
    """Values of the last parameter, which shapes an effect, at which it is tried."""
    return kind.parameters[-1].trials or (kind.parameters[-1].neutral,)


def _idle(kind: type[Effect], option: int, trial: int, n: int) -> Effect:
    """An effect that changes (next to) nothing, with its option and shape set."""
    words = {key: choices[option] for key, choices in kind.options.items()}
    effect = kind.idle(n, **words)
    if not kind.parameters[-1].trials:
        return effect
    values = effect.full(n)
    values[-1] = _trials(kind)[trial]
    return kind.from_full(values, n, **words)


def gain(current: Fit, candidate: Candidate, samples: Samples) -> tuple[float, np.ndarray]:
    """By how much the loss falls when the columns are added (linearised, bounded), and their weights."""
    columns = candidate.columns * samples.weight[:, None]
    alive = np.linalg.norm(columns, axis=0) > 1e-9
    weights = np.zeros(columns.shape[1])
    if not alive.any():
        return 0.0, weights
    apart, residual = orthogonal(current, columns[:, alive])
    size = np.maximum(np.linalg.norm(apart, axis=0), 1e-12)
    q, r = np.linalg.qr(apart / size)
    k = len(size)
    r = np.vstack([r, 1e-6 * np.eye(k)])
    target = np.concatenate([q.T @ residual, np.zeros(k)])
    x = bounded_least_squares(r, target, candidate.lower[alive] * size, candidate.upper[alive] * size)
    left = residual - (apart / size) @ x
    weights[alive] = x / size
    return float(residual @ residual - left @ left) / samples.noise**2, weights


def sprung_joints(current: Fit, candidate: Candidate, samples: Samples) -> Candidate:
    """A spring on those joints only where one shows: joints are added while each is worth its two numbers.

    While much is unexplained, linearised columns of idle joints soak up curvature; a joint must then take away a share.
    """
    whole = float(current.residual @ current.residual) / samples.noise**2
    n = samples.n
    price = 2 * np.log(len(samples.power)) + 4
    chosen: list[int] = []
    reached = 0.0
    while len(chosen) < n:
        trials = [
            (gain(current, _columns(candidate, [*chosen, j], n), samples)[0], j) for j in range(n) if j not in chosen
        ]
        best, joint = max(trials)
        if best - reached < max(price, SOAKED * (whole - reached)) and chosen:
            break
        chosen, reached = [*chosen, joint], best
    return _columns(candidate, sorted(chosen), n)


def single_springs(candidate: Candidate, n: int) -> list[Candidate]:
    """The candidate with one joint's spring at a time."""
    return [_columns(candidate, [j], n) for j in range(n)]


def _columns(spring: Candidate, joints: list[int], n: int) -> Candidate:
    rows = [*joints, *(n + j for j in joints)]
    term = spring.term.with_joints(tuple(joints))
    return Candidate(term, spring.columns[:, rows], spring.lower[rows], spring.upper[rows], spring.origin[rows])


def orthogonal(current: Fit, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns and residual less what the hypothesis' own free numbers already reach."""
    if not current.jacobian.shape[1]:
        return columns, current.residual
    q = basis(current.jacobian)
    return columns - q @ (q.T @ columns), current.residual - q @ (q.T @ current.residual)


def basis(jacobian: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the columns' span."""
    size = np.linalg.norm(jacobian, axis=0)
    u, s, _ = np.linalg.svd(jacobian[:, size > 0] / size[size > 0], full_matrices=False)
    return u[:, s > 1e-9 * (s[0] if len(s) else 1.0)]


def best_of(found: Sequence[tuple[float, Candidate, np.ndarray]]) -> list[tuple[float, Candidate, np.ndarray]]:
    """The best start of each term, by gain, best first."""
    by_term: dict[Term, tuple[float, Candidate, np.ndarray]] = {}
    for row in found:
        if row[1].term not in by_term or row[0] > by_term[row[1].term][0]:
            by_term[row[1].term] = row
    return sorted(by_term.values(), key=lambda row: -row[0])
