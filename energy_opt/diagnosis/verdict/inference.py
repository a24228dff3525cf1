"""From samples and a declared model to a verdict: which effects, which alternatives, judged on motions held out.

The search finds likely effects. Then the error on held-out motions, which were never fitted, decides: a claim must
lower it. For `explained` and `nothing_missing` it must be no larger than the noise, in motion and at rest.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from energy_opt.diagnosis.data.clusters import FEWEST, clusters, moves, repeats
from energy_opt.diagnosis.data.jumps import known_by
from energy_opt.diagnosis.data.noise import Noise
from energy_opt.diagnosis.data.samples import Samples
from energy_opt.diagnosis.data.standing import by_chance, standing_noise
from energy_opt.diagnosis.evidence.errors import Quality, mostly_explained
from energy_opt.diagnosis.evidence.odds import links_odds
from energy_opt.diagnosis.evidence.residual import follows, other_unit
from energy_opt.diagnosis.evidence.settling import LASTS, settling_at, stops, with_settling
from energy_opt.diagnosis.fit.posterior import Fit, Nuisance, Stopped, World
from energy_opt.diagnosis.hypothesis.links import links_of
from energy_opt.diagnosis.hypothesis.terms import Measured, Scale
from energy_opt.diagnosis.search.effect_sets import Search, moved, root
from energy_opt.diagnosis.search.kinks import usual_friction
from energy_opt.diagnosis.verdict.claims import (
    CLAIM,
    RIVAL,
    RIVAL_DETAIL,
    Claim,
    alternatives,
    claimed,
    clock_error,
    instead_of_links,
    is_a_line,
    is_a_step,
    is_beyond_bounds,
    only,
    plain_fit,
    shaped_otherwise,
    structures,
    warms,
    widened,
    written,
)
from energy_opt.diagnosis.verdict.judge import Judge, by_chance_least, contradicted, same_readings, scattered
from energy_opt.diagnosis.verdict.likeliest import Likeliest, likeliest_of, likeliest_with_settling
from energy_opt.diagnosis.verdict.plausible import is_far
from energy_opt.diagnosis.verdict.rivals import as_good, left_open, pair, supported
from energy_opt.power import PowerModel
from energy_opt.robot import Limits

log = logging.getLogger(__name__)

NO_CLAIM = (is_a_step, is_a_line, is_beyond_bounds, is_far)  # an effect is not claimed if one of these is true
BESIDE = 0.3  # share of the explained log odds that a claimed effect must have if more than noise is left
NOISE = 1.2  # factor on the noise below which a model's held-out error counts as noise
LITTLE = 1.5  # the same, below which an unknown law is too weak for dry and viscous friction together to imitate it


@dataclass(frozen=True)
class Inference:
    """Result of the inference.

    Attributes:
        root: fit of the declared model with links and levels. best: the likeliest hypothesis.
        accepted: its claimed part. claims: of its effects, in order. rivals: sets that explain as well, the
            accepted one first. noise, still: of the readings, in the fit and at standstill.
        before, after: errors of the declared model and of the one that is written, on motions held out.
        links: True if deviating links are claimed as the cause.
        idle: joints (indices) that never move. follows: False if the power does not depend on the motion.
        verdict: as in diagnosis.json; "" where the search was stopped before it had one.
        blind: True if no cause was sought. unknown: True if a law that the library lacks may rule beside the claims.
        misspecified: True if one surely rules: effects imitated it, or more is left in motion than any noise.
        fitted: errors of the declared model on the runs fitted, where it does not fit these, but those held out; else
            None. unseen: joints (indices) that move only in the runs fitted then.
        unit: unit that the power may be in rather than W, and its ratio to the declared model's, see `other_unit`.
        late: [s] by which the meter's readings must be moved before the set is judged; 0 if it was judged.
    """

    search: Search
    root: Fit
    best: Fit
    accepted: Fit
    verdict: str
    claims: tuple[Claim, ...]
    rivals: tuple[Fit, ...]
    noise: Noise
    still: Noise
    before: Quality
    after: Quality
    model: PowerModel
    links: bool = False
    idle: tuple[int, ...] = ()
    follows: bool = True
    blind: bool = False
    unknown: bool = False
    misspecified: bool = False
    fitted: Quality | None = None
    unseen: tuple[int, ...] = ()
    unit: tuple[str, float] | None = None
    late: float = 0.0

    @property
    def beside_noise(self) -> dict[str, Any]:
        """Errors of single readings with their ratio to the noise, as in diagnosis.json."""
        if self.fitted is None:
            return self.after.document()
        error, noise = self.fitted.worst
        return self.after.document() | {"fitted": {"power_rmse": error, "noise": noise, "ratio": error / noise}}


def infer(
    samples: Samples, declared: PowerModel, limits: Limits, moving: np.ndarray, held: Samples | None = None,
    given: tuple[str, ...] = (), stopped: Callable[[], bool] = lambda: False,
    measured: Mapping[str, Measured] | None = None, blind: bool = False, clock: bool = False,
) -> Inference:  # fmt: skip
    """Run the search and judge it.

    Args:
        samples: the training runs. declared: the owner's model. held: runs that are kept for the judgement.
        moving: (n,) True for the joints that the set excites, see `excited`.
        given: declared effects whose values are fitted but not reported as findings.
        stopped: called during the search; True ends it without a verdict.
        measured: values of effects' numbers from other readings than the power, see `Scale`.
        blind: True if no cause may be claimed from these runs; none is sought.
        clock: True if an error of the clocks may still be corrected: nothing is judged if there is one.
    """
    samples, now = known_by(declared, samples, repeats(samples))
    held = known_by(declared, held, [1] * len(held.parts))[0] if held is not None else None
    idle = tuple(int(j) for j in np.flatnonzero(~moving))
    plausible, most = standing_noise(*([samples] if held is None else [samples, held]))
    # [s] motion and rest are assumed to take half of the time each
    lasts = sum(float(np.ptp(time)) for time, _ in (held or samples).single) / 2
    still = plausible[0][1]
    judge = Judge(held, plausible, by_chance(most, max(lasts, samples.step)))
    scale = replace(Scale.of(limits, samples.power), measured=measured or {})
    world = replace(World.of(samples, declared, scale, links_of(samples, declared), still), given=given)
    nothing = root(world, Nuisance(0.03, 0.3 * still.white))
    as_declared, unit = judge.of_model(declared, nothing), other_unit(samples, now)

    def plain(found: Search, verdict: str, best: Fit = nothing, **more: Any) -> Inference:
        model = written(best, links=False) if given or best is not nothing else declared
        after = judge.of_model(model, best)
        return Inference(
            found, nothing, best, nothing, verdict, (), (nothing,), still, still, as_declared, after, model,
            idle=idle, unit=unit, **more,
        )  # fmt: skip

    if blind:
        return plain(Search(world), "insufficient", blind=True)
    if not follows(samples, now):
        return plain(Search(world), "unexplained", follows=False)
    if unit and (unit[0] == "kW" or declared.get("standby")):  # a missing standby may look like milliwatts
        return plain(Search(world), "unexplained")
    tried: list[Search] = []
    searching = True  # a stop ends the search; what is computed for the result after it is not stopped again
    world = replace(world, stopped=lambda: searching and stopped())

    def judged(likeliest: Likeliest) -> Inference:
        found, best, noise, settling = likeliest
        if clock and (late := clock_error(best)):
            return plain(found, "", late=late)
        start = moved(nothing, found.world) if settling.size else nothing
        kept = held
        if held is not None:  # like noise, settling is judged by all runs: stops differ
            own = max(settling, settling_at(written(best), held, noise.white), key=lambda x: x.size)
            kept = with_settling(held, own, [1] * len(held.parts))
        return _judged(found, best, noise, start, replace(judge, held=kept, seen={}, foreseen={}), idle)

    try:
        first = likeliest_of(world, nothing, tried)
        out = judged(first)
    except Stopped:
        searching = False
        best = tried[-1].so_far(nothing)
        return plain(tried[-1], "", nothing if best.free else best)
    # effects may imitate settling, which is then not seen: suppose it, and judge the likelier result
    if out.verdict in ("partly", "unexplained") and stops(samples, LASTS[0]).motions:
        with suppress(Stopped):
            other = likeliest_with_settling(world, nothing, tried, first)
            out = out if other is None else judged(other)
    searching = False
    return replace(out, unit=unit)


def _judged(found: Search, best: Fit, noise: Noise, nothing: Fit, judge: Judge, idle: tuple[int, ...]) -> Inference:
    """Judge the result of a search."""
    world = found.world
    log.info("evidence for each effect", extra={"share": 0.65})
    sure, claims = claimed(found, best)
    unsure = [c.term.kind for c in best.charts if c.term.name not in sure.names]
    # an uncertain warm-up is as likely the meter's drift
    judge.drifts = drifting = sure if all(map(warms, unsure)) else best
    declared = judge.of_model(world.declared, nothing)
    accepted, claims = _borne_out(found, judge, sure, claims)  # takes back what held-out motions do not support
    if accepted is not sure:  # smoothing blurs laws near rest: a finer one may be likelier than those that foresee best
        for usual in usual_friction(found, best):
            part, kept = _borne_out(found, judge, *claimed(found, usual, pair(usual)))
            if kept and part.names == usual.names and judge.of(part).ratio < NOISE:
                sure, accepted, claims = usual, part, kept
    log.info("alternatives", extra={"share": 0.8})
    rivals: tuple[Fit, ...] = (accepted,)
    # signs of a law that is not in the library: it makes all forms inexact, so fine differences decide nothing
    odd = bool(claims and structures(found, accepted)) or any(g.signal != "time" for g in accepted.free)
    unknown = odd or bool(accepted.free) or judge.of(accepted).ratio >= NOISE
    # not confirmed by held-out motions; an effect that hardly changes the readings imitates no law
    imitated = found.score(sure) - found.score(accepted) > CLAIM and not same_readings((accepted, sure))
    loud = judge.loud
    most = loud.of(accepted)  # if the noise is larger than estimated, it is larger at rest, too
    misfit = most.motion / most.noise_motion >= NOISE * max(1.0, most.rest / most.noise_rest)
    misspecified = odd or imitated or misfit
    if accepted.free:
        accepted = plain_fit(found, accepted)
        claims = tuple(replace(c, without=plain_fit(found, c.without)) for c in claims)
    # an error above the noise may be noise, which then decides less between the alternatives
    weigher, known, seen = loud if unknown else judge, dict[frozenset[str], Fit](), set[frozenset[str]]()
    while claims and frozenset(accepted.names) not in seen:  # a likelier set has alternatives of its own
        seen.add(frozenset(accepted.names))
        reach = RIVAL + RIVAL_DETAIL * max(c.odds for c in claims)
        # held-out motions may change the likeliest set
        known |= {frozenset(f.names): f for f in alternatives(found, accepted, RIVAL + reach)}
        best = max((best, *known.values()), key=found.score)
        nearly = tuple(known.values())
        rivals = as_good(found, judge, accepted) if misspecified else left_open(found, weigher, nearly, reach)
        borne = [
            (accepted, claims) if f is accepted else _borne_out(found, judge, *claimed(found, f, pair(f)), not unknown)
            for f in rivals
        ]
        rivals, own = supported(found, rivals, borne, misspecified)
        if not rivals:
            rivals, own = (accepted,), {id(accepted): claims}
        if not misspecified or same_readings(rivals):
            rivals = left_open(found, weigher, rivals, reach)
        accepted, claims = rivals[0], own[id(rivals[0])]
        if misspecified:
            break
    start = root(found.world, best.nuisance)
    # an effect that only some of the sets have may imitate the unknown law
    if claims and misspecified and not same_readings(rivals):
        shared = set.intersection(*(set(f.names) for f in rivals))
        accepted, claims = _borne_out(found, judge, *claimed(found, only(found, rivals[0], shared)), shaped=False)
        rivals = (accepted,)
    rivals = tuple(scattered(widened(f)) if unknown else widened(f) for f in rivals)
    best, accepted = rivals[0] if best is accepted else best, rivals[0]
    # the written model must predict held-out motions better than the declared one
    after = judge.of(accepted)
    model = written(accepted)
    if claims and judge.held is not None and not after.lower(declared):
        accepted, claims = only(found, accepted), ()
        rivals, model, after = (accepted,), written(accepted), judge.of(accepted)
    if not claims:
        start = accepted
        if not world.given:
            model, after = world.declared, declared
    linked = not claims and _links_are_off(found, judge, start, best)
    # the residual may be noise alone: judge with the largest plausible noise
    if not claims and not linked:
        linked = _links_are_off(found, loud, start, best)
        if linked or not (drifting.names or drifting.free):
            judge, declared, after = loud, loud.of_model(world.declared, nothing), loud.of_model(model, accepted)
    if linked:
        accepted, rivals = start, (start, *instead_of_links(found, start))
        model, after = written(start, links=True), judge.of_model(written(start, links=True), start, True)
    fits, fitted, unseen = after.ratio < NOISE, None, np.zeros(world.samples.n, dtype=bool)
    if len(rivals) > 1:
        verdict = "ambiguous"
    elif claims or linked:
        other = claims and (misspecified or structures(found, accepted))
        verdict = "explained" if fits and not other else "partly"
    else:
        verdict = "nothing_missing" if fits else "unexplained"
        # motions that do not excite what the others show are no proof that nothing is missing
        if fits and (others := judge.fitted.of_model(model, accepted)).ratio >= NOISE:
            fitted, unseen = others, moves(world.samples) & ~moves(judge.held or world.samples)
            verdict = "insufficient" if unseen.any() else "unexplained"
    if (idle or _unjudged(judge, accepted)) and verdict != "ambiguous":
        verdict = "insufficient"
    return Inference(
        found, start, best, accepted, verdict, claims, rivals, noise, judge.noise, declared, after, model, linked, idle,
        unknown=unknown, misspecified=misspecified, fitted=fitted,
        unseen=tuple(int(j) for j in np.flatnonzero(unseen)),
    )  # fmt: skip


def _links_are_off(found: Search, judge: Judge, start: Fit, best: Fit) -> bool:
    """True if links alone lower the held-out error to the noise, and one of them is surely (3 deviations) off.

    Those of the URDF must be excluded by deviating ones, or also by the effects of `best`, which are alternatives then.
    """
    declared = judge.of_model(found.world.declared, start)
    after = judge.of_model(written(start, links=True), start, True)
    better = float(np.sum((declared.squares - after.squares) * after.counts)) > 0 and after.rmse < declared.rmse
    if not (better and declared.ratio >= NOISE > after.ratio):
        return False
    odds = links_odds(found.bank(start)) + max(0.0, found.score(best) - found.score(start))
    return odds > CLAIM and bool((np.abs(start.amounts) > 3 * np.sqrt(np.diag(start.link_covariance))).any())


def _unjudged(judge: Judge, f: Fit) -> bool:
    """True if no motion is held out, and there are too few to leave one out."""
    samples = f.world.samples
    return judge.held is None and sum(samples.kinds[g[0]] == "motion" for g in clusters(samples)) < FEWEST


def _borne_out(
    found: Search, judge: Judge, accepted: Fit, claims: tuple[Claim, ...], shaped: bool = True
) -> tuple[Fit, tuple[Claim, ...]]:
    """Keep the claims that held-out motions support: each lowers the error there.

    If the error is larger than the noise, several effects may imitate an unknown law. Then each claim must explain a
    good part, and all together most of the excess over the largest plausible noise, also if any single motion is left
    out. If little is left, dry and viscous friction explain a part together: beside the other, neither has much alone.

    Args:
        shaped: True if the effects must have the form of the library's laws. If an unknown law is present, no rival's
            form is exact.
    """
    while claims and not _unjudged(judge, accepted):
        other = next((c for c in claims if any(no(accepted, c) for no in NO_CLAIM)), None)
        if other is None and shaped and (k := shaped_otherwise(found, accepted)) is not None:
            other = next((c for c in claims if c.name == accepted.names[k]), None)
        if other is not None:
            accepted, claims = claimed(found, other.without)
            continue
        plain, start = plain_fit(found, accepted), root(found.world, accepted.nuisance)
        noisy = (ratio := (judge.loud if judge.unseen else judge).of(plain).ratio) >= NOISE
        if noisy and not mostly_explained(judge.loud.of(start), judge.loud.of(plain), bool(accepted.free)):
            return only(found, accepted), ()
        whole = BESIDE * float(np.sum(judge.gains(plain, only(found, plain)))) if noisy else 0.0
        fewer, both = [plain_fit(found, c.without) for c in claims], pair(plain) if NOISE <= ratio < LITTLE else ()
        rest = only(found, plain, {*plain.names} - {*both})
        gains = [judge.gains(plain, less) for less in fewer]
        expected = [judge.expected(plain, c, less) for c, less in zip(claims, fewer, strict=True)]
        spare = [
            -np.inf if contradicted([*g, *judge.trained(accepted, c.without)])
            else min(float(np.sum(g)), float(np.sum(judge.gains(plain, part))) - max(whole, 0.0)) - by_chance_least(x)
            for g, x, c, less in zip(gains, expected, claims, fewer, strict=True)
            for part in [rest if c.name in both else less]
        ]  # fmt: skip
        worst = int(np.argmin(spare))
        if spare[worst] > 0:
            return accepted, claims
        accepted, claims = claimed(found, claims[worst].without)
    return accepted, claims
