"""Numbers in which a law has steps or kinks: they are searched over their range, as a descent along slopes gets stuck.

These are durations after which the power jumps, and the size of a store: each motion that fills it adds a kink. Here
also: laws of negative power, and lags of the meter, that single steps of the search do not reach.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from energy_opt.diagnosis.evidence.odds import Subset
from energy_opt.diagnosis.fit.candidates import Candidate, candidates, sized_store
from energy_opt.diagnosis.fit.posterior import Fit, columns_of, fit, linearised
from energy_opt.diagnosis.hypothesis.terms import Chart, Term, entries
from energy_opt.diagnosis.search.effect_sets import Search, root, without
from energy_opt.effects import Effect, MeterEffect, StoreEffect

TRIED = 30  # values over the whole range of a number that are tried
AROUND, COUNTS, FEW = 1.5, (17, 5, 5), 3  # first range around the best, over and below it; values in each; iterations
# as -2 log likelihood: difference within which values are alike; least gain by another value, as single readings at the
# edge of a hold may be off
FLAT, LEAST = 1.0, 15.0
# friction of most arms, and laws by speed that may imitate it
USUAL = ("coulomb_friction", "viscous_friction")
BY_SPEED = (
    "asymmetric_friction", "power_law_friction", "sigmoid_friction", "stribeck_friction", "friction_curve", "iron_loss"
)  # fmt: skip
SEVERAL = 2  # least effects that may imitate a law of negative power together


def settled(found: Search, f: Fit) -> Fit:
    """The hypothesis with such numbers at their likeliest values, with the others fitted again at each value."""
    if f.token in found.settled:
        return f
    for k, (c, z) in enumerate(zip(f.charts, f.numbers, strict=True)):
        at = _kinked(c)
        if at is None or c.term.declared:
            continue
        low, high = (x[at] for x in c.term.kind.chart_bounds(c.n))

        def badness(value: float, iterations: int = FEW, f: Fit = f, k: int = k, at: int = at) -> float:
            charts, numbers = _with(f, k, at, value)
            if at in charts[k].kept:
                charts[k] = replace(charts[k], lower=numbers[k], upper=numbers[k])
            new = fit(found.world, f.nuisance, charts, numbers, f.free, f.amounts, iterations)
            off = new.theta - new.mean
            return round(float(np.sum(found.world.whiten(new.residual) ** 2) + off @ new.precision @ off), 1)

        given = float(c.values(z)[at])
        best, factor = min([given, *sizes(low, high)], key=lambda x: badness(x, 0)), AROUND
        for count in COUNTS:
            tried = np.clip(best * np.geomspace(1 / factor, factor, count), low, high).tolist()
            best = min(tried, key=lambda x: (badness(x), abs(np.log(x / given))))
            factor **= 2 / (count - 1)
        here = badness(given)
        if badness(best) >= here - LEAST:  # of values that the data cannot tell apart, the middle one
            alike = sorted({given, *(x for x in _trials(c) if abs(badness(x) - here) < FLAT)})
            best = alike[(len(alike) - 1) // 2]
        if best != given:
            f = found.keep(found.renewed(fit(found.world, f.nuisance, *_with(f, k, at, best), f.free, f.amounts)))
    found.settled.add(f.token)
    return f


def _kinked(c: Chart) -> int | None:
    """Index of the chart value with steps or kinks that a single number [s or J] of an effect has, or None."""
    if issubclass(c.term.kind, StoreEffect):
        return 0
    own = entries(c.term.kind, c.n, len(c.base))
    return next((k for k, (p, *_) in enumerate(own) if p.steps and p.unit == "s"), None)


def _trials(c: Chart) -> tuple[float, ...]:
    """The values of such a number that the search starts from."""
    return next(p.trials for p in c.term.kind.parameters if p.steps or issubclass(c.term.kind, StoreEffect))


def _with(f: Fit, k: int, at: int, value: float) -> tuple[list[Chart], list[np.ndarray]]:
    """Charts and numbers of a fit, with another value of the k-th effect at an index of its chart values."""
    charts, numbers, c = list(f.charts), list(f.numbers), f.charts[k]
    if at in c.kept:
        charts[k], numbers[k] = sized_store(c, value), np.array([value])
    else:
        base = np.where(np.arange(len(c.base)) == at, value, c.base)
        charts[k] = replace(c, base=base, term=replace(c.term, trial=tuple(base.tolist())))
    return charts, numbers


def sizes(low: float, high: float) -> list[float]:
    """`TRIED` values over the whole range of a positive number; from a thousandth of its end on if it begins at 0."""
    return list(np.geomspace(low or 1e-3 * high, high, TRIED).tolist())


def elsewhere(found: Search, f: Fit) -> list[Fit]:
    """Fits with other laws of negative power, lags of the meter, options and friction, as far as the fit has one."""
    others = *other_drives(found, f), *other_lags(found, f), *other_options(found, f), *usual_friction(found, f)
    return [*others, *redeclared(found, f)]


def redeclared(found: Search, f: Fit) -> list[Fit]:
    """Fits with the declared effects, fitted anew, in place of an effect that replaces them: one of them, and all.

    While they are replaced, they are no candidates, so no exchange of effects reaches them.
    """
    out = []
    for k, c in enumerate(f.charts):
        if c.term.instead:
            bank = found.bank(without(found, f, k))
            anew = [j for j, b in enumerate(bank.blocks) if b.name in c.term.instead]
            some = {frozenset(own) for own in (*([j] for j in anew), anew) if own}
            out += [found.refit(bank, found.whole(bank) | own) for own in sorted(some, key=sorted)]
    return out


def usual_friction(found: Search, f: Fit) -> list[Fit]:
    """The fit with dry and viscous friction in place of all its losses by speed, if another law is among these.

    One law, or two, may imitate these two in the speeds of a set. No exchange of one effect reaches them.
    """
    own = {c.term.name for c in f.charts if c.term.name in (*USUAL, *BY_SPEED)}
    if own <= {*USUAL} or any(e.name in own.union(USUAL) for e in f.world.declared.effects):
        return []
    base = f
    while (k := next((k for k, name in enumerate(base.names) if name in own), None)) is not None:
        base = without(found, base, k)
    bank = found.bank(base)
    first = {b.name: k for k, b in reversed(list(enumerate(bank.blocks)))}
    both = {first[name] for name in USUAL if name in first}
    return [found.refit(bank, found.whole(bank) | both)] if len(both) == len(USUAL) else []


def usual_laws(found: Search, f: Fit) -> list[Fit]:
    """Fits of dry and viscous friction and of each law of negative power as the only effects, if a fit has several.

    Most arms have these laws together. Where the power is often negative, none of them alone explains much. So a search
    begins with other effects, which imitate them together, and no exchange of two effects reaches them.
    """
    world = found.world
    laws = {*USUAL, *BY_SPEED}
    if len(f.charts) < len(world.given) + SEVERAL or any(
        e.stage == "drive" or e.name in laws for e in world.declared.effects
    ):
        return []
    bank = found.bank(root(world, f.nuisance))
    friction = found.whole(bank) | {k for k, b in enumerate(bank.blocks) if b.name in USUAL}
    drives: dict[Term, list[Subset]] = {}
    for k, b in enumerate(bank.blocks):
        if isinstance(b.source, Candidate) and b.source.chart.term.kind.stage == "drive":
            drives.setdefault(b.source.chart.term, []).append(friction | {k})
    return [found.refit(bank, max(tried, key=bank.glance)) for tried in drives.values()]


def other_options(found: Search, f: Fit) -> list[Fit]:
    """Fits with other options of an effect of the fit: some agree to first order, so single steps do not tell them."""
    out = []
    for k, c in enumerate(f.charts):
        if c.term.declared or c.term.kind.stage == "drive" or c.term.kind.free_options:
            continue
        for words in c.term.kind.offered(()):
            term = replace(c.term, options=tuple(f"{key}={word}" for key, word in sorted(words.items())))
            if words and term != c.term:
                charts = [*f.charts[:k], replace(c, term=term), *f.charts[k + 1 :]]
                out.append(found.fitted(charts, list(f.numbers), list(f.free), f.nuisance, f.amounts))
    return out


def other_lags(found: Search, f: Fit) -> list[Fit]:
    """Fits with each lag of the meter as the only one, in place of all of the fit.

    Readings are nonlinear in a lag. So two lags that imitate a third one are a local optimum of linearised steps.
    """
    own = [c.term for c in f.charts if _is_lag(c.term.kind)]
    if not own or any(term.declared for term in own):
        return []
    base = f
    for term in own:
        base = without(found, base, next(k for k, c in enumerate(base.charts) if c.term == term))
    bank = found.bank(base)
    here = found.whole(bank)
    lags: dict[str, list[Subset]] = {}
    for k, b in enumerate(bank.blocks):
        if isinstance(b.source, Candidate) and _is_lag(b.source.chart.term.kind):
            lags.setdefault(b.name, []).append(here | {k})
    return [found.refit(bank, max(tried, key=bank.glance)) for tried in lags.values()]


def _is_lag(kind: type[Effect]) -> bool:
    """True for an effect by which the meter is late."""
    return issubclass(kind, MeterEffect) and kind.late > 0


def other_drives(found: Search, f: Fit) -> list[Fit]:
    """Fits with each other law of negative power: in place of the present one, and as the only effect.

    The search does not reach these fits by single steps, because other effects may compensate for a wrong law: a gain
    of 0.5 beside friction of the whole load takes the negative power of each joint away. The readings are nonlinear in
    the size of a store. So the fit starts at the likeliest of many sizes, also for a store of the present fit, whose
    size may be a local optimum. The law alone starts with the URDF's links, because links that were fitted without it
    also compensate for it.
    """
    at = next((k for k, c in enumerate(f.charts) if c.term.kind.stage == "drive"), None)
    if any(e.stage == "drive" for e in f.world.declared.effects) or (at is None and len(f.charts) < SEVERAL):
        return []
    bases = [(root(found.world, f.nuisance), np.zeros_like(f.amounts))]
    if at is not None:
        bases.insert(0, (without(found, f, at), f.amounts))
    own = f.charts[at].term.name if at is not None else ""
    drives = [c for c in candidates(bases[0][0]) if c.chart.term.kind.stage == "drive"]
    stores = {c.chart.term.name: c.chart for c in drives if issubclass(c.chart.term.kind, StoreEffect)}
    others = [c for c in drives if c.chart.term.name != own]
    laws = [(c.chart, c.start(np.where(np.isfinite(c.low), c.low, c.high) / 2)) for c in others]
    out = []
    for base, amounts in bases:
        tried = [row for row in laws if row[0].term.name not in stores]
        tried += [(c, _likeliest_size(base, c, amounts)) for c in stores.values()]
        for c, start in tried:
            out.append(found.fitted([*base.charts, c], [*base.numbers, start], list(base.free), f.nuisance, amounts))
    return out


def _likeliest_size(base: Fit, c: Chart, amounts: np.ndarray) -> np.ndarray:
    """The size (1,) of a store, of `TRIED`, beside a fit with these amounts of links, by the white residual."""
    world, charts = base.world, [*base.charts, c]

    def squares(size: float) -> float:
        theta = np.concatenate([*base.numbers, [size], base.weights, amounts, base.levels])
        return float(np.sum(linearised(world, charts, columns_of(world, base.free), theta)[3][:, 0] ** 2))

    return np.array([min(sizes(c.lower[0], c.upper[0]), key=squares)])
