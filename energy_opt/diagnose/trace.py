"""From training samples and a declared model to a verdict: which effects, which rivals, what is left."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from energy_opt.diagnose.candidates import candidates
from energy_opt.diagnose.ease import eased
from energy_opt.diagnose.fit import Fit, Nuisance, Stopped, World
from energy_opt.diagnose.follows import follows
from energy_opt.diagnose.leftover import leftover, wandering
from energy_opt.diagnose.links import links_of
from energy_opt.diagnose.noise import Noise
from energy_opt.diagnose.noise_seen import noise_of, standing_noise
from energy_opt.diagnose.predict import predict
from energy_opt.diagnose.samples import Samples, weighted
from energy_opt.diagnose.search import GAIN, Search, moved, root
from energy_opt.diagnose.terms import Scale, Told
from energy_opt.power import PowerModel
from energy_opt.robot import Limits

log = logging.getLogger(__name__)

CLAIM = 7.0  # logarithm of odds at which an effect is claimed: a thousand to one
RIVAL = 3.0  # and within which another set explains as well: twenty to one
LOOKED = 6.0  # rivals this near when weighed linearly are fitted
CHANGES = 3  # of the accepted set for a likelier rival
BESIDE = 0.3  # of what is explained, that an effect must hold to be claimed beside an unknown structure
TRIFLE = 0.02  # of what can be explained, that free functions or the rest may take up without a word
MOVES = 0.03  # [rad/s] a joint that never exceeds this does not move
SLOW = 0.1  # of a joint's velocity limit


@dataclass(frozen=True)
class Claim:
    """How surely an effect is there: logarithm of the odds, and what it takes away (W rms of the residual)."""

    odds: float
    without: Fit


@dataclass(frozen=True)
class Trace:
    """What the training runs say.

    Attributes:
        root: the declared model as it is, links and levels allowed for. best: the likeliest hypothesis.
        accepted: what is claimed of it. claims: of its effects, in order. rivals: sets that explain as well, the
            accepted one first. noise: of the readings. left: rms of what is left over noise's slow part.
        idle: joints (indices) that never move. follows: False where power does not go with the motion.
        verdict: as in diagnosis.json; "" where the search was stopped before it had one.
        blind: True where no cause was sought.
    """

    search: Search
    root: Fit
    best: Fit
    accepted: Fit
    verdict: str
    claims: tuple[Claim, ...]
    rivals: tuple[Fit, ...]
    noise: Noise
    left: float
    structured: bool
    idle: tuple[int, ...]
    follows: bool = True
    blind: bool = False


def excited(samples: Samples, limits: Limits) -> np.ndarray:
    """(n,) True for the joints whose motion can show what moves them costs.

    A joint must move at all; and where no joint of the arm reaches `SLOW` of its velocity limit, all count as idle,
    since friction's dependence on speed, regeneration and inertia hide at a crawl.
    """
    fastest = np.abs(samples.v).max(axis=0)
    if (fastest < SLOW * limits.velocity).all():
        return np.zeros(samples.n, dtype=bool)
    return np.asarray(fastest > MOVES)


def trace(
    samples: Samples,
    declared: PowerModel,
    limits: Limits,
    moving: np.ndarray,
    given: tuple[str, ...] = (),
    stopped: Callable[[], bool] = lambda: False,
    told: Mapping[str, Told] | None = None,
    blind: bool = False,
) -> Trace:
    """Run the search and judge it.

    Args:
        samples: the training runs. declared: the owner's model.
        moving: (n,) True for the joints that the set excites, see `excited`.
        given: declared effects whose values are free without being news.
        stopped: asked on the way; True ends the search, with what is known and no verdict.
        told: what is known of effects' numbers from elsewhere than the power, see `Scale`.
        blind: the runs are such that no cause may be claimed of them; none is sought.
    """
    now = predict(declared, samples)
    samples = weighted(samples, now.power)
    idle = tuple(int(j) for j in np.flatnonzero(~moving))
    still = standing_noise(samples)
    scale = replace(Scale.of(limits, samples.power), told=told or {})
    world = World.of(samples, declared, scale, links_of(samples, declared), still, given)
    nothing = root(world, Nuisance(0.03, 0.3 * still.white))
    if blind:
        found = Search(world)
        none = (nothing,)
        return Trace(found, *none * 3, "insufficient", (), none, still, 1.0, False, idle, blind=True)
    if not follows(samples, now):
        found = Search(world)
        return Trace(found, nothing, nothing, nothing, "unexplained", (), (nothing,), still, np.inf, True, idle, False)
    tried: list[Search] = []
    try:
        return _searched(replace(world, stopped=stopped), nothing, still, idle, tried)
    except Stopped:
        best = tried[-1].so_far(nothing)
        return Trace(tried[-1], nothing, best, nothing, "", (), (nothing,), still, np.nan, False, idle)


def _searched(world: World, nothing: Fit, still: Noise, idle: tuple[int, ...], tried: list[Search]) -> Trace:
    """The search, judged; `tried` holds the one under way."""
    best, noise = nothing, still
    for turn in range(3):
        log.info("effects, round %d of at most 3", turn + 1, extra={"share": 0.05 + 0.1 * turn})
        tried[:] = [found := Search(world)]
        best = found.descend(best)
        noise = noise_of(best)
        if _alike(noise, world.whiten.noise):
            break
        world = world.under(noise)
        best = moved(best, world)
    log.info("effects under the noise that was found", extra={"share": 0.35})
    tried[:] = [found := Search(world)]
    named = found.descend(best)
    log.info("structures that no effect has", extra={"share": 0.5})
    found.open()
    best = found.descend(named)
    if _trifling(found, named, best):
        best = named
    best = max([best, *_other_drives(found, best)], key=found.score)
    log.info("evidence for each effect", extra={"share": 0.65})
    accepted, claims = _claimed(found, best)
    left, structured = _structure(found, best, accepted, still)
    log.info("rivals", extra={"share": 0.8})
    rivals: tuple[Fit, ...] = (accepted,)
    if not accepted.free and not structured:
        accepted, claims, rivals = likelier(found, accepted, claims)
        best = max(best, accepted, key=found.score)
        left, structured = _structure(found, best, accepted, still)
    if accepted.free or structured:
        verdict = "unexplained"
    elif len(rivals) > 1:
        verdict = "ambiguous"
    else:
        verdict = "explained" if claims else "nothing_missing"
    if idle and verdict != "ambiguous":
        verdict = "insufficient"
    rivals = tuple(eased(f) for f in rivals)
    best, accepted = rivals[0] if best is accepted else best, rivals[0]
    return Trace(
        found, root(world, best.nuisance), best, accepted, verdict, claims, rivals, noise, left, structured, idle
    )


def _structure(found: Search, best: Fit, accepted: Fit, still: Noise) -> tuple[float, bool]:
    """What the accepted hypothesis leaves, over the noise's slow part, and is there structure in it?"""
    left, structured = leftover(accepted, still)
    if structured:  # small beside what the declared model leaves?
        before, _ = leftover(root(found.world, best.nuisance), still)
        structured = left**2 - 1 > TRIFLE * (before**2 - 1)
    return left, structured or wandering(accepted)


def _trifling(found: Search, named: Fit, best: Fit) -> bool:
    """Do free functions take away little beside what effects do? Then they are errors of smoothing, not structure."""
    if not best.free or not named.charts:
        return False
    start = root(found.world, best.nuisance)
    sizes = [float(np.mean(found.world.whiten(f.residual) ** 2)) for f in (start, named, best)]
    return sizes[1] - sizes[2] < TRIFLE * (sizes[0] - sizes[2])


def _alike(a: Noise, b: Noise) -> bool:
    return (
        abs(np.log(a.white / b.white)) < 0.15
        and abs(a.wave - b.wave) < 0.35 * max(a.wave, b.wave, 0.3 * a.white)
        and (a.memory == b.memory or a.wave < 0.5 * a.white)
    )


def _claimed(found: Search, best: Fit) -> tuple[Fit, tuple[Claim, ...]]:
    """The hypothesis less the effects that are not sure enough, the least sure first, and the claims that stay."""
    while True:
        claims = []
        for k, c in enumerate(best.charts):
            if c.term.name in found.world.given:
                continue
            less = _without(found, best, k)
            claims.append(Claim(_profiled(found, best) - _profiled(found, less), less))
        if not claims:
            return best, ()
        weakest = claims[int(np.argmin([c.odds for c in claims]))]
        if weakest.odds >= CLAIM:
            minor = _minor(found, best, claims) if best.free else None
            if minor is None:
                return best, tuple(claims)
            weakest = minor
        best = weakest.without


def _minor(found: Search, best: Fit, claims: list[Claim]) -> Claim | None:
    """Beside a structure that no effect has, the effect that holds least of what is explained, if that is little.

    What an unknown law leaves is shared out among effects that resemble it.
    """
    white = found.world.whiten
    sizes = [float(np.mean(white(c.without.residual) ** 2)) for c in claims]
    here = float(np.mean(white(best.residual) ** 2))
    whole = float(np.mean(white(root(found.world, best.nuisance).residual) ** 2)) - here
    least = int(np.argmin(sizes))
    return claims[least] if sizes[least] - here < BESIDE * whole else None


def _without(found: Search, f: Fit, k: int) -> Fit:
    charts = [c for i, c in enumerate(f.charts) if i != k and f.charts[k].term.name not in c.term.kind.needs]
    kept = [z for c, z in zip(f.charts, f.numbers, strict=True) if c in charts]
    return found.fitted(charts, kept, list(f.free), f.nuisance, f.amounts)


def _profiled(found: Search, f: Fit) -> float:
    """A hypothesis' score under the noise that suits it best: what it leaves may be noise with memory."""
    key = id(f)
    if key not in found.profiled:
        own = noise_of(f)
        value = found.score(f)
        if not _alike(own, f.world.whiten.noise):
            other = Search(f.world.under(own), variants=found.variants)
            value = max(value, other.score(moved(f, other.world)))
        found.profiled[key] = value
    return found.profiled[key]


def _other_drives(found: Search, f: Fit) -> list[Fit]:
    """Every other law of what becomes of negative power, for the one that there is and alone in place of all.

    Stores are no straight step away, and what stands beside the wrong law may only make up for it. A store's size is
    begun at each value tried, as readings bend in it.
    """
    at = next((k for k, c in enumerate(f.charts) if c.term.kind.stage == "drive"), None)
    if at is None or f.charts[at].term.declared:
        return []
    bases = [_without(found, f, at)]
    if len(f.charts) > 1 or f.free:
        bases.append(root(found.world, f.nuisance))
    out = []
    for c in candidates(bases[0]):
        if c.chart.term.kind.stage == "drive" and c.chart.term.name != f.charts[at].term.name:
            start = c.start(np.where(np.isfinite(c.low), c.low, c.high) / 2)
            for base in bases:
                charts, starts = [*base.charts, c.chart], [*base.numbers, start]
                out.append(found.fitted(charts, starts, list(base.free), f.nuisance, f.amounts))
    return out


def likelier(found: Search, accepted: Fit, claims: tuple[Claim, ...]) -> tuple[Fit, tuple[Claim, ...], tuple[Fit, ...]]:
    """The accepted hypothesis, or the rival that is likelier still once fitted; its claims, and the rivals to that.

    Laws that are the same to first order, as load friction and gears' efficiency are, tie where nothing is fitted yet:
    rounding decides at which of them the search ends.
    """
    rivals = _rivals(found, accepted)
    for _ in range(CHANGES):
        better = max(rivals, key=found.score)
        if found.score(better) <= found.score(accepted) + GAIN:
            break
        other, its = _claimed(found, better)
        if found.score(other) <= found.score(accepted):
            break
        accepted, claims, rivals = other, its, _rivals(found, other)
    return accepted, claims, rivals


def _rivals(found: Search, accepted: Fit) -> tuple[Fit, ...]:
    """Sets of other effects whose evidence is as good: one for another, one less, one more."""
    if all(c.term.name in found.world.given for c in accepted.charts):
        return (accepted,)
    bank = found.bank(accepted)
    here = found.whole(bank)
    value = bank.weigh(here).value
    near = []
    for k in here:
        if bank.blocks[k].name in found.world.given:
            continue
        for j, b in enumerate(bank.blocks):
            if j in here or b.name.startswith("free") or any(b.name == bank.blocks[i].name for i in here - {k}):
                continue
            option = (here - {k}) | {j}
            found_value = bank.weigh(option).value
            if b.name != bank.blocks[k].name and found_value > value - LOOKED:
                near.append((found_value, option))
    out = {frozenset(accepted.names): accepted}
    reached = found.score(accepted)
    for new in _other_drives(found, accepted):
        if found.score(new) > reached - RIVAL:
            out.setdefault(frozenset(new.names), new)
    for _, option in sorted(near, key=lambda row: -row[0])[:6]:
        new = found.refit(bank, option)
        names = frozenset(new.names)
        if names not in out and found.score(new) > reached - RIVAL:
            out[names] = new
    return tuple(out.values())
