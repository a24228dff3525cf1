"""Claims: effects of the likeliest hypothesis that are certain enough. Alternatives: other sets that fit as well.

The likeliest set is not yet a claim. An effect is claimed if the set is a thousand times as likely with it as without
it, and if it is neither an error of the clocks, nor the meter's drift, nor an imitation of a law of another shape.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import cache

import numpy as np

from energy_opt.diagnosis.data.noise import Noise
from energy_opt.diagnosis.data.predict import predict
from energy_opt.diagnosis.evidence.odds import SPREADS, Bank, Subset, drifts_most, noise_of
from energy_opt.diagnosis.fit.candidates import Candidate
from energy_opt.diagnosis.fit.posterior import Fit, Free, fit
from energy_opt.diagnosis.hypothesis.terms import Chart
from energy_opt.diagnosis.search.effect_sets import FREE_ODDS, Search, buildable, free_block, moved, rarity, without
from energy_opt.diagnosis.search.kinks import elsewhere
from energy_opt.effects import Effect, MeterEffect
from energy_opt.power import PowerModel

CLAIM = 7.0  # least log odds for claiming an effect: a thousand to one
DETAIL = 0.01  # share of the largest log odds, added to CLAIM: a law that is off by 10 % leaves 1 % of its evidence
# the same, added to RIVAL: with 0 a wrong law is claimed at 3.4 of 319 (tests/diagnosis/test_resembling_laws.py)
RIVAL_DETAIL = 0.0025
RIVAL = 3.0  # log odds within which another set explains the data equally well: twenty to one
TURNS = 3
SURE = 2.0  # standard deviations added to a time constant to get the longest plausible one
LAGS = 1.5  # a meter lag is claimed only above this multiple of the time uncertainty `Samples.lag`
SHORTEST = 5e-4  # [s] a shorter error of the clocks is ignored
MOST = 6  # most alternatives that are fitted
GLANCED = 50.0  # log odds by which a quick look may be lower than the evidence over all nuisances
LIKE = 0.1  # largest share of an effect's squares that a free function of the same signal may fail to represent
BENT = 0.2  # least change of the power of an effect's watts that makes it another law
WIDE_ENOUGH = 1.1  # priors stay if the numbers ask for less than this multiple of their present width


@dataclass(frozen=True)
class Claim:
    """A claimed effect: its name, the logarithm of its odds, and the fit without it."""

    name: str
    odds: float
    without: Fit


def plain_fit(found: Search, f: Fit) -> Fit:
    """Refit a hypothesis without its free functions, which a plan cannot use."""
    return found.fitted(list(f.charts), list(f.numbers), [], f.nuisance, f.amounts) if f.free else f


def alike(a: Noise, b: Noise) -> bool:
    """True if two noise estimates agree within chance in white part, slow part, misfit and memory."""
    return (
        abs(np.log(a.white / b.white)) < 0.15
        and abs(a.wave - b.wave) < 0.35 * max(a.wave, b.wave, 0.3 * a.white)
        and abs(a.misfit - b.misfit) < 0.5 * max(a.misfit, b.misfit, 0.3 * a.white)
        and (a.memory == b.memory or a.wave < 0.5 * a.white)
    )


def claimed(found: Search, best: Fit, together: Collection[str] = ()) -> tuple[Fit, tuple[Claim, ...]]:
    """The hypothesis `best` without its uncertain effects (the least certain is removed first), and the other claims.

    No law holds in every detail. So the error of a very certain effect must not be claimed as another effect. A narrow
    prior must not divide an effect that is stronger than usual between two effects of usual strength. So the odds are
    the smaller ones of those with the usual priors and with priors as wide as the numbers ask for. A warm-up whose
    rival is a meter that drifts farther than meters do is claimed as soon as no rival is as likely. So is a wrong
    declared value beside another one that is certain: then declared values are not reliable. Effects of
    `together` occur together in most arms: each needs only odds of twenty to one beside the others.
    """
    while True:
        claims: list[tuple[Chart, Claim, bool]] = []
        reached = [_profiled(found, f) for f in (best, widened(best))]
        for k, c in enumerate(best.charts):
            if c.term.name in found.world.given:
                continue
            less = without(found, best, k)
            gains = [high - _profiled(found, f) for high, f in zip(reached, (less, widened(less)), strict=True)]
            claim = Claim(c.term.name, min(gains), less)
            claims.append((c, claim, warms(c.term.kind) and drifts_most(less) and not is_a_line(best, claim)))
        if not claims:
            return best, ()
        wrong = {claim.name for c, claim, _ in claims if c.term.declared and claim.odds >= CLAIM}
        detail = DETAIL * max(claim.odds for _, claim, _ in claims)
        spare = [
            claim.odds - RIVAL if claim.name in together and len(claims) > 1
            else claim.odds - detail - (RIVAL if no_drift or (c.term.declared and wrong - {claim.name}) else CLAIM)
            for c, claim, no_drift in claims
        ]  # fmt: skip
        if min(spare) >= 0:
            return best, tuple(claim for _, claim, _ in claims)
        best = claims[int(np.argmin(spare))][1].without


def warms(kind: type[Effect]) -> bool:
    """True if an effect changes the level of the power with time, as the drift of a meter does."""
    return kind.drifts and kind.overhead


def is_a_step(f: Fit, claim: Claim) -> bool:
    """True if the claimed effect is a meter lag that sampling, quantisation and smoothing of the positions explain.

    The same holds for a filter with an opposite delay: together they smooth without a lag, as the positions are
    smoothed.
    """
    lags = _lags(f.model, f.world.samples.n)
    return claim.name in lags and min(abs(lags[claim.name]), abs(sum(lags.values()))) <= LAGS * f.world.samples.lag


def clock_error(f: Fit) -> float:
    """Lag [s] of the meter in a fit if it is an error of the clocks rather than of the meter, else 0.

    Sampling, quantisation and smoothing of the positions explain such a lag, see `is_a_step`.
    """
    n, declared = f.world.samples.n, _lags(f.world.declared, f.world.samples.n)
    late = sum(_lags(f.model, n).values()) - sum(declared.values())
    return late if SHORTEST < abs(late) <= LAGS * f.world.samples.lag else 0.0


def _lags(model: PowerModel, n: int) -> dict[str, float]:
    """Lags [s] of the meter by the effects of a model."""
    meter = [e for e in model.effects if isinstance(e, MeterEffect)]
    return {e.name: e.late * float(e.full(n)[0]) for e in meter if e.late}


def is_a_line(f: Fit, claim: Claim) -> bool:
    """True if the claim is a change of level whose time constant may exceed the set's duration: meter drift."""
    effect, samples = f.model.get(claim.name), f.world.samples
    if effect is None or not warms(type(effect)):
        return False
    f = widened(f)  # a prior that is too narrow for the level limits its time constant, too
    effect = f.model.get(effect.name) or effect
    units = [p.unit for p in effect.parameters for _ in range(p.count(samples.n, effect.extents))]
    longest = effect.full(samples.n) + SURE * f.deviations[f.names.index(claim.name)]
    return any(x > float(np.ptp(samples.t)) for x, unit in zip(longest, units, strict=True) if unit == "s")


def is_beyond_bounds(f: Fit, claim: Claim) -> bool:
    """True if the best value of a parameter of the claimed effect is beyond its bound, e.g. a negative resistance.

    Another law is then the cause. The test: beyond the bound, the log likelihood would be larger by more than `RIVAL`,
    and `DETAIL` of the claim's log odds, which a law that is right loses by the errors of the others.
    """
    k = f.names.index(claim.name)
    if not _at_bounds(f.charts[k], f.numbers[k]).any():
        return False
    f = widened(f)
    pull = f.jacobian.T @ f.world.whiten(f.residual) - f.precision @ (f.theta - f.mean)
    fixed = np.zeros(len(f.theta), dtype=bool)
    fixed[: f.count] = np.concatenate([_at_bounds(c, z) for c, z in zip(f.charts, f.numbers, strict=True)])
    own, first = f.charts[k], f.places[k].start
    for i in np.flatnonzero(fixed[first : first + len(own.lower)]):
        loose = np.append(np.flatnonzero(~fixed), first + i)
        variance = float(np.linalg.inv(f.hessian[np.ix_(loose, loose)])[-1, -1])
        outwards = (pull[first + i] < 0) == (f.numbers[k][i] <= own.lower[i])
        if outwards and 0.5 * pull[first + i] ** 2 * variance > RIVAL + DETAIL * claim.odds:
            return True
    return False


def _at_bounds(c: Chart, z: np.ndarray) -> np.ndarray:
    """Which numbers (Z,) of an effect are at a bound."""
    return (z <= c.lower) | (z >= c.upper)


def only(found: Search, f: Fit, names: Collection[str] = ()) -> Fit:
    """Refit a hypothesis with only the effects in `names`, as far as it has them, and those in `World.given`."""
    kept = {*names, *found.world.given}
    while not kept.issuperset(f.names):
        f = without(found, f, next(k for k, name in enumerate(f.names) if name not in kept))
    return f


def _profiled(found: Search, f: Fit) -> float:
    """Score of a hypothesis under the noise that suits it best: its residual may be correlated noise, or misfit."""
    if f.token not in found.profiled:
        own = noise_of(f)
        value = found.score(f)
        if not alike(own, f.world.whiten.noise):
            other = Search(f.world.under(own), variants=found.variants)
            value = max(value, other.score(moved(f, other.world)))
        found.profiled[f.token] = value
    return found.profiled[f.token]


def structures(found: Search, f: Fit) -> list[int]:
    """Indices of free functions in the bank of a fit that are more likely, besides its effects, than noise.

    Evidence alone decides: the prior odds of free functions are removed. The best of c functions must be c times as
    likely as a single one. Functions of time are ignored, as a meter drifts.
    """
    bank = found.bank(f)
    here = found.whole(bank)
    free = [k for k, b in enumerate(bank.blocks) if b.name.startswith("free") and b.name != "free time"]
    least = bank.weigh(here).value + FREE_ODDS + RIVAL + float(np.log(max(len(free), 1)))
    return [k for k in free if k not in here and bank.weigh(here | {k}).value > least]


def shaped_otherwise(found: Search, f: Fit) -> int | None:
    """Index of an effect of a fit that has another law than the library's, or None.

    Its shape parameter ends at a bound: it then represents another law. Or another power of the effect's watts is
    likelier, see `bent`. Or a free function that is likely besides the effect can represent it, so that it follows the
    same signal: it adds what the law's shape lacks.
    """
    causes = [k for k, c in enumerate(f.charts) if c.term.name not in found.world.given]
    for k in causes:
        c, z = f.charts[k], f.numbers[k]
        if (c.shapes & _at_bounds(c, z)).any():
            return k
    if not causes:
        return None
    plain = plain_fit(found, f)
    bends = bent(found, plain)
    left, bank = structures(found, plain), found.bank(plain)
    return next((k for k in causes if bends[k] or any(bank.unlike(k, b) < LIKE for b in left)), None)


def bent(found: Search, f: Fit) -> list[bool]:
    """For each effect of a fit: are its watts P likelier as P |P|^x, with x beyond `BENT`?

    To first order in x this adds P log |P| to the readings: Ramsey's test of a regression's form (1969), by evidence.
    Most of the laws that resemble one another, as copper loss and a saturated motor's, differ by such a power.
    """
    w, own = f.world, found.own(f)
    here = frozenset(range(len(own)))
    push = w.links.torques @ f.amounts
    bends = []
    for c in f.charts:
        watts = f.prediction.metered - predict(c.out_of(f.model, w.declared), w.samples, push).metered
        share = np.abs(watts) / max(float(np.sqrt(np.mean(watts**2))), 1e-9)
        column = w.samples.shown(watts * np.log(np.maximum(share, 1e-9)))
        bends.append(Free(f"power of {c.term.name}", column[:, None], 1.0))
    blocks = [free_block(g, w.whiten(g.columns), g, 0.0) for g in bends]
    bank = Bank(f, [*own, *blocks])
    least = bank.weigh(here).value + RIVAL
    weighed = [bank.weigh(here | {k}) for k in range(len(own), len(bank.blocks))]
    return [x.value > least and abs(float(x.amounts[-1][0])) > BENT for x in weighed]


def alternatives(found: Search, accepted: Fit, reach: float) -> tuple[Fit, ...]:
    """The accepted fit, then fits with one effect exchanged whose score is within `reach` of its own.

    Scores with the usual priors or with widened ones count. Linearised evidence, by which fits are chosen, is uncertain
    by a share `DETAIL` of what the effects explain.
    """
    if all(c.term.name in found.world.given for c in accepted.charts):
        return (accepted,)
    bank = found.bank(accepted)
    here = found.whole(bank)
    value = bank.weigh(here).value
    least = value - 2 * reach - DETAIL * max(value - bank.weigh(frozenset()).value, 0.0)
    wide = cache(lambda: found.score(widened(accepted)))

    def as_likely(f: Fit) -> bool:
        return found.score(f) > found.score(accepted) - reach or found.score(widened(f)) > wide() - reach

    names, near = {bank.blocks[k].name for k in here}, []
    others = [j for j, b in enumerate(bank.blocks) if b.name not in names and not b.name.startswith("free")]
    for k in here:
        if bank.blocks[k].name in found.world.given:
            continue
        for j in others:
            option = (here - {k}) | {j}
            if buildable(bank, option) and bank.glance(option) > least - GLANCED:
                near.append((bank.weigh(option).value, option))
    # fits that no exchange of one effect reaches: other laws of negative power, other lags of the meter
    out = {frozenset(accepted.names): accepted}
    for new in elsewhere(found, accepted):
        if as_likely(new):
            out.setdefault(frozenset(new.names), new)
    first: dict[frozenset[str], Subset] = {}
    for _, option in sorted((row for row in near if row[0] > least), key=lambda row: -row[0]):
        first.setdefault(frozenset(bank.blocks[i].name for i in option), option)
    for option in list(first.values())[:MOST]:
        new = found.refit(bank, option)
        if frozenset(new.names) not in out and as_likely(new):
            out[frozenset(new.names)] = new
    return tuple(out.values())


def instead_of_links(found: Search, start: Fit) -> list[Fit]:
    """Fits with one effect that are as likely as deviating links alone, the likeliest first, at most `MOST`.

    A payload may act like a heavier link, and the loss of a supply like links that are all too light. `start` is the
    fit with deviating links alone.
    """
    bank = found.bank(start)
    here = found.whole(bank)
    value, out = bank.weigh(here).value, {}
    for k, b in enumerate(bank.blocks):
        option = here | {k}
        if k in here or not isinstance(b.source, Candidate) or not buildable(bank, option):
            continue
        if bank.weigh(option).value - rarity(b.source.chart.term) > value - RIVAL:
            new = found.refit(bank, option)
            if found.level_score(new) > found.level_score(start) - RIVAL:
                out[new.names] = new
    return sorted(out.values(), key=found.score, reverse=True)[:MOST]


def widened(f: Fit, may: Callable[[Chart], bool] = lambda chart: True) -> Fit:
    """The hypothesis fitted again with empirical-Bayes prior widths; unchanged if the usual widths fit.

    Numbers of an effect share a width. Declared ones have each their own: one joint's friction may have changed alone.

    Args:
        may: whose widths may change.
    """
    measured = f.world.scale.measured
    usual, widened = f.charts, f
    widths = [np.ones(len(c.mean)) for c in usual]
    for _ in range(TURNS):
        wanted = []
        for c, z in zip(usual, widened.numbers, strict=True):
            squares = np.where(c.shapes, 0.0, (z - c.mean) ** 2 / np.diag(np.linalg.inv(c.precision)))
            if c.term.name in measured or not may(c):
                squares = np.zeros_like(squares)
            elif not c.term.declared:
                squares[:] = squares.sum() / max((~c.shapes).sum(), 1)
            wanted.append(np.maximum(1.0, np.sqrt(squares)))
        if all((new <= WIDE_ENOUGH * old).all() for new, old in zip(wanted, widths, strict=True)):
            break
        widths = wanted
        charts = [c.wider(width) for c, width in zip(usual, widths, strict=True)]
        widened = fit(f.world, f.nuisance, charts, list(widened.numbers), list(f.free), widened.amounts)
    return widened


def written(f: Fit, links: bool | None = None) -> PowerModel:
    """Model of a fit for model.toml: link deviations if likely, and the runs' common level in `standby`.

    If an effect adds to the level, the fit compensates for it in the levels of the runs. A model has no such levels, so
    its standby takes the compensation.
    """
    model = f.full_model(f.nuisance.spread > min(SPREADS) if links is None else links)
    standby = model.get("standby")
    if standby is None or "standby" in f.names:
        return model
    power = float(standby.values["power"][0]) + float(np.mean(f.levels))
    return model.replaced(type(standby)(power=max(power, 0.0)))
