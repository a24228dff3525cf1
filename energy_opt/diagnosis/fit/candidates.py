"""Candidate terms for a hypothesis: every known effect in each of its variants, and free functions of one signal.

A candidate is its columns: the derivatives of the readings by its numbers, at values where the effect changes (almost)
nothing. So hundreds of candidates are weighed together, before any is fitted. Free functions stand for laws that are
not among the effects.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, product, zip_longest

import numpy as np

from energy_opt.diagnosis.data.predict import predict, recorded
from energy_opt.diagnosis.data.samples import Samples
from energy_opt.diagnosis.fit.posterior import Fit, Free
from energy_opt.diagnosis.hypothesis.terms import USUAL, Chart, Term, chart, entries, sized
from energy_opt.effects import Effect, LinkInertia, MeterEffect, MeterWindow, RunOffset, StoreEffect, known_effects

# effects that every hypothesis includes; they are never reported as a cause
ALLOWED_FOR = (LinkInertia.name, RunOffset.name)


@dataclass(frozen=True)
class Candidate:
    """A term that may be added to a hypothesis.

    Attributes:
        chart: parameterisation of the effect. columns: (M, c) [W] derivatives of the readings by the amounts x (c,).
        precision, mean, low, high: prior and bounds of x. origin, way: the effect's numbers are z = origin + way x.
    """

    chart: Chart
    columns: np.ndarray
    precision: np.ndarray
    low: np.ndarray
    high: np.ndarray
    origin: np.ndarray
    way: np.ndarray
    mean: np.ndarray

    def start(self, x: np.ndarray) -> np.ndarray:
        """Numbers z of the effect for amounts x (c,), within the chart's bounds."""
        return np.clip(self.origin + self.way @ x, self.chart.lower, self.chart.upper)


def candidates(now: Fit) -> Iterator[Candidate]:
    """Yield a candidate for each effect that the hypothesis lacks or that has fixed values in the declared model."""
    taken, model, declared = set(now.names), now.model, now.world.declared
    drives = [e.name for e in model.effects if e.stage == "drive"]
    absent: list[tuple[type[Effect], Term]] = []
    for kind in known_effects().values():
        if kind is MeterWindow and now.world.samples.averaged:  # a window that is known is applied, and never claimed
            continue
        if kind.name in taken or kind.name in ALLOWED_FOR:
            continue
        if declared.get(kind.name) is not None:
            if model.get(kind.name) is not None:  # another effect may be in its place
                yield from _declared(kind, now)
        elif not kind.sought or not _sizes_known(kind):
            continue
        elif kind.stage == "drive" and drives and not (issubclass(kind, StoreEffect) and declared.get(drives[0])):
            continue  # only a store may take the place of a declared law of negative power
        elif issubclass(kind, MeterEffect | StoreEffect):
            yield from _by_difference(kind, now, tuple(drives) if kind.stage == "drive" else ())
        elif all(model.get(name) is not None for name in kind.needs):
            terms = _variants(kind, now.world.samples)
            held = [e for name in kind.contains if (e := declared.get(name)) is not None]
            if terms and kind.contains and len(held) == len(kind.contains):
                starts = (tuple(e.full(now.world.samples.n).tolist()) for e in kind.containing(*held))
                terms += [Term(kind.name, (), start, instead=kind.contains) for start in starts]
            absent += [(kind, term) for term in terms]
    yield from _absent(absent, now)


def _sizes_known(kind: type[Effect]) -> bool:
    """True if the lengths of the effect's tables are known from the options under which it is offered."""
    return not any(p.free for p in kind.parameters) or bool(kind.free_options)


def _variants(kind: type[Effect], s: Samples) -> list[Term]:
    """Terms of the effect: one for each option that the recording allows and each starting value of its shapes."""
    out, n = [], s.n
    tried = [p.trials if p.trials and (p.shapes or p.steps) else (None,) for p in kind.parameters]
    for words in kind.offered(recorded(s)):
        neutral = kind.neutral(n, **words).full(n)
        options = tuple(f"{key}={word}" for key, word in sorted(words.items()))
        for trial in product(*tried):
            value = dict(zip((p.name for p in kind.parameters), trial, strict=True))
            tries = [value[p.name] for p, _, _ in entries(kind, n, len(neutral))]
            given = [x if at is None else at for x, at in zip(neutral, tries, strict=True)]
            shaped = any(x is not None for x in trial)
            out.append(Term(kind.name, options, tuple(float(x) for x in given) if shaped else ()))
    return out


def _absent(kinds: Sequence[tuple[type[Effect], Term]], now: Fit) -> Iterator[Candidate]:
    """Candidates for effects that the model lacks, linearised at values where they change almost nothing.

    Each round adds one variant of every effect to the model and predicts once.
    """
    w, n = now.world, now.world.samples.n
    variants = [list(group) for _, group in groupby(kinds, key=lambda pair: pair[0])]
    push = w.links.torques @ now.amounts
    for terms in zip_longest(*variants):
        whole, charts, driven = now.model, {}, False
        for kind, term in filter(None, terms):
            if kind.stage == "drive" and driven:
                continue
            driven = driven or kind.stage == "drive"
            c = chart(term, w.declared, w.scale, n)
            idle = kind.idle(n, **dict(word.split("=") for word in term.options)).full(n)
            parameters = [p for p, _, _ in entries(kind, n, len(idle))]
            if term.trial:
                idle = np.where([p.shapes or p.steps or bool(term.instead) for p in parameters], term.trial, idle)
            z0 = kind.to_chart(idle, n)[c.kept]
            charts[kind.name] = (c, z0, [p.shapes and p.neutral != 0 for p in parameters])
            whole = c.into(whole, z0)
        jacobian = predict(whole, w.samples, push).jacobian
        where = whole.places(n)
        for name, (c, z0, shapes) in charts.items():
            columns = jacobian[:, where[name]] @ c.slope(z0)
            if not columns.any():  # the effect does not influence these data, e.g. no run has a dwell
                continue
            c = sized(c, columns, w.scale)
            amount = columns.any(axis=0) if c.term.instead else ~np.array(shapes)[c.kept]
            way = np.eye(len(z0))[:, amount]
            covariance = np.linalg.inv(c.precision)[np.ix_(amount, amount)]
            low, high = (c.lower - z0)[amount], (c.upper - z0)[amount]
            mean = (c.mean - c.origin)[amount]
            yield Candidate(c, columns[:, amount], np.linalg.inv(covariance), low, high, z0, way, mean)


def _declared(kind: type[Effect], now: Fit) -> Iterator[Candidate]:
    """Candidate that refits the declared values of an effect."""
    w, n = now.world, now.world.samples.n
    held = w.declared.get(kind.name)
    assert held is not None
    options = tuple(f"{k}={v}" for k, v in sorted({**held.choices, **held.extents}.items()))
    term = Term(kind.name, options, declared=True)
    c = chart(term, w.declared, w.scale, n)
    slope = c.slope(c.origin)
    if not np.isfinite(slope).all():  # the slope is undefined, e.g. for a declared payload without mass
        return
    where = now.model.places(n)
    columns = now.prediction.jacobian[:, where[kind.name]] @ slope
    c = sized(c, columns, w.scale)
    low, high = np.minimum(c.lower - c.origin, 0.0), np.maximum(c.upper - c.origin, 0.0)
    yield Candidate(c, columns, c.precision, low, high, c.origin, np.eye(len(c.origin)), c.mean - c.origin)


def _by_difference(kind: type[Effect], now: Fit, instead: tuple[str, ...]) -> Iterator[Candidate]:
    """Candidates for an effect of one number that enters nonlinearly: one column per value tried, by difference.

    `instead`: the declared effects that it replaces.
    """
    w = now.world
    p, n = kind.parameters[0], w.samples.n
    for tried in p.trials or (p.neutral + 0.05,):
        c = chart(Term(kind.name, instead=instead), w.declared, w.scale, n)
        if issubclass(kind, StoreEffect):
            changed = predict(c.into(now.model, np.array([tried])), w.samples, w.links.torques @ now.amounts)
            columns = (changed.reading - now.prediction.reading)[:, None]
        else:
            columns = _metered(kind, now, tried)[:, None]
        if not np.any(columns):
            continue
        if issubclass(kind, StoreEffect):  # the store exists or not
            c, at = sized_store(c, tried), np.array([tried])
            yield Candidate(c, columns, np.eye(1), np.zeros(1), np.full(1, 1.2), at, np.zeros((1, 1)), np.zeros(1))
            continue
        width = abs(tried - p.neutral)
        c = sized(c, columns / width, w.scale)
        low, high = (0.0, 2.0) if p.trials else (-20.0, 20.0)
        precision = c.precision * width**2
        way = np.array([[tried - p.neutral]])
        yield Candidate(c, columns, precision, np.array([low]), np.array([high]), c.origin, way, np.zeros(1))


def sized_store(c: Chart, size: float) -> Chart:
    """The chart of a store about a size [J], which is also the standard deviation of the prior."""
    at = np.array([size])
    return replace(c, base=at, origin=at, mean=at, precision=np.array([[size**-2]]), unknown=np.zeros(1, bool))


def _metered(kind: type[Effect], now: Fit, value: float) -> np.ndarray:
    """Change [W] of the readings (M,) by a meter effect of the given value."""
    s, power = now.world.samples, now.prediction.power
    assert issubclass(kind, MeterEffect)
    changed = np.concatenate(
        [kind.reading(s.t[samples], power[samples], value) - power[samples] for samples in s.slices]
    )
    return s.shown(changed)


HATS, FEW_HATS, REST_HATS = 32, 12, 4  # knots of a free function of position or speed; of other signals; at rest
FASTEST_CHANGE = 1.0  # [s] shortest distance of the knots of a free function of time
MOST_KNOTS = 160
PRESLIDING = 0.1  # [`Samples.unit`] travel within which friction builds up after a reversal, as in gears
SIZES = (0.3, 1.5)  # prior standard deviations of a free function, over a usual friction torque or a usual power


def functions(now: Fit) -> Iterator[Free]:
    """Free functions of one signal.

    Torque of position, of speed, or of travel since the last reversal (Dahl's presliding). Power of time, of time since
    the motion ended, of joint torque (also in proportion to it, and at rest, where friction may bear a part of it), of
    the whole power, or of joint temperature.
    """
    w, s = now.world, now.world.samples
    by_tau, load = now.prediction.by_tau, np.abs(now.prediction.tau)
    usual = USUAL * w.scale.effort

    def torques(signal: str, hats: list[np.ndarray]) -> Iterator[Free]:
        columns = [s.shown(h * (by_tau[:, j] * usual[j])[:, None]) for j, h in enumerate(hats) if h.shape[1]]
        if columns:
            whole = np.column_stack(columns)
            yield from (Free(signal, whole, size) for size in SIZES)

    moving = s.v != 0
    yield from torques("position", [_hats(s.q[:, j], moving[:, j], HATS) for j in range(s.n)])
    yield from torques("velocity", [_hats(s.v[:, j], moving[:, j], HATS) for j in range(s.n)])
    presliding = np.exp(-travel(s.v, s.t, s.slices) / (PRESLIDING * s.unit)) * np.sign(s.v)
    yield from torques("travel since reversal", [presliding[:, [j]] for j in range(s.n)])
    power = 0.05 * w.scale.level
    always = np.ones(len(s.t), dtype=bool)
    for signal, columns in (
        ("time", _in_time(s.t, s.slices)),
        ("time since motion ended", _hats(s.idle, s.idle >= 0, FEW_HATS)),
        ("torque", np.column_stack([_hats(x, always, FEW_HATS) for x in now.prediction.tau.T])),
        ("torque at rest", np.column_stack([_hats(*x, REST_HATS) for x in zip(load.T, ~moving.T, strict=True)])),
        ("power", _hats(now.prediction.power, always, FEW_HATS)),
        ("signed torque", now.prediction.tau / np.maximum(np.abs(now.prediction.tau).max(axis=0), 1e-9)),
        *([("temperature", np.column_stack([_hats(x, always, 6) for x in s.temperature.T]))]
          if np.isfinite(s.temperature).all() else []),
    ):  # fmt: skip
        if columns.shape[1]:
            whole = s.shown(columns) * power
            yield from (Free(signal, whole, size) for size in SIZES)


def _hats(x: np.ndarray, where: np.ndarray, count: int) -> np.ndarray:
    """Piecewise linear basis functions (K, c) of x at the nodes in `where`; no columns if x hardly varies there."""
    if where.sum() < 20 or np.ptp(x[where]) < 1e-3:
        return np.zeros((len(x), 0))
    knots = np.linspace(x[where].min(), x[where].max(), count)
    place = np.clip((x - knots[0]) / (knots[1] - knots[0]), 0, count - 1)
    out = np.maximum(0.0, 1 - np.abs(place[:, None] - np.arange(count)))
    out[~where] = 0.0
    return np.asarray(out[:, np.abs(out).sum(axis=0) > 0])


def _in_time(t: np.ndarray, slices: Sequence[slice]) -> np.ndarray:
    """Piecewise linear basis functions of recorded time, without the pauses between runs."""
    recorded, total = np.empty_like(t), 0.0
    for samples in slices:
        recorded[samples] = total + t[samples] - t[samples.start]
        total = float(recorded[samples.stop - 1])
    count = int(np.clip(total / FASTEST_CHANGE, 4, MOST_KNOTS))
    return _hats(recorded, np.ones(len(t), dtype=bool), count)


def travel(v: np.ndarray, t: np.ndarray, slices: Sequence[slice]) -> np.ndarray:
    """Travel (K, n) [rad, m] of each joint since it last reversed, or since its run began.

    Args:
        v, t: (K, n) speeds and (K,) times [s] of the nodes. slices: where each run's nodes lie.
    """
    out = np.empty_like(v)
    for samples in slices:
        step = np.gradient(t[samples]) if samples.stop - samples.start > 1 else np.ones(1)
        for j, own in enumerate(v[samples].T):
            steps, at = np.abs(own) * step, np.arange(len(own))
            heading = np.sign(own[np.maximum.accumulate(np.where(own != 0, at, 0))])
            turned = np.diff(heading, prepend=heading[0]) * heading == 2
            out[samples, j] = np.cumsum(steps) - np.maximum.accumulate(np.where(turned, np.cumsum(steps) - steps, 0.0))
    return out
