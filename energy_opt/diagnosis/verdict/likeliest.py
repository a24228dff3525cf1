"""The likeliest hypothesis of a set of runs, under the noise and the settling that are likeliest for it."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from energy_opt.diagnosis.data.clusters import repeats
from energy_opt.diagnosis.data.noise import Noise
from energy_opt.diagnosis.data.samples import Samples
from energy_opt.diagnosis.evidence.odds import noise_of
from energy_opt.diagnosis.evidence.settling import LASTS, SUPPOSED, Settling, settling_of, with_settling
from energy_opt.diagnosis.fit.posterior import Fit, World
from energy_opt.diagnosis.search.effect_sets import Search, moved, root, without
from energy_opt.diagnosis.search.kinks import elsewhere, settled, usual_laws
from energy_opt.diagnosis.verdict.claims import CLAIM, alike, alternatives, shaped_otherwise, widened

# most noise estimates, and search rounds before each: few, as effects that imitate a misfit hide it
TURNS, EARLY = 5, 2
SEVERAL = 3  # effects from which a search from none, with free functions, is tried, too
MANY = 6  # effects above which they imitate an unknown law: exchanges of one are then slow, and of no use
NONE = Settling()
log = logging.getLogger(__name__)


class Likeliest(NamedTuple):
    """What a search found: its hypothesis, the noise, and the settling."""

    search: Search
    best: Fit
    noise: Noise
    settling: Settling


def likeliest_with_settling(world: World, nothing: Fit, tried: list[Search], first: Likeliest) -> Likeliest | None:
    """Search once more, supposing that power settles after stops; None where the `first` result is likelier.

    Effects may imitate settling, which the first search then does not see. A search that comes back to the settling of
    the first one ends early.
    """
    supposed = Settling(SUPPOSED * world.whiten.noise.white, LASTS[1])
    try:
        other = likeliest_of(world, nothing, tried, supposed, first.settling)
    except _NothingNew:
        return None
    first_score, score = (_score(each, world.samples) for each in (first, other))
    return other if score > first_score else None


class _NothingNew(Exception):
    """A search came back to a settling that is known."""


def likeliest_of(
    world: World, nothing: Fit, tried: list[Search], settling: Settling = NONE, known: Settling | None = None
) -> Likeliest:
    """Search for the likeliest hypothesis, and for the noise and the settling that are likeliest for it.

    Args:
        nothing: the fit without new effects, where the search begins. tried: holds the search in progress.
        settling: that of the first round.
        known: the search ends by `_NothingNew` where it finds this settling.
    """
    plain = world.samples
    world = replace(world, samples=with_settling(plain, settling, repeats(plain)))
    found = Search(world.under(world.whiten.noise))
    best = moved(nothing, found.world) if settling.size else nothing
    for turn in range(TURNS):
        log.info("effects, round %d of at most %d", turn + 1, TURNS, extra={"share": 0.05 + 0.06 * turn})
        tried[:] = [found]
        best = found.descend(best, EARLY)
        others = [_redeclared(best), *elsewhere(found, best), *usual_laws(found, best)]
        best = settled(found, max([best, *others], key=found.score))
        new, _ = settling_of(best.residual, found.world.whiten.noise.white, plain)
        if known is not None and new.is_alike(known):
            raise _NothingNew
        same = new.is_alike(settling)
        if not same:
            settling, world = new, replace(world, samples=with_settling(plain, new, repeats(plain)))
            best = moved(best, world.under(found.world.whiten.noise))
        noise = noise_of(best)
        if alike(noise, found.world.whiten.noise) and same:
            break
        found = Search(world.under(noise))
        best = moved(best, found.world)
    log.info("effects under the noise that was found", extra={"share": 0.35})
    tried[:] = [found]
    best = found.descend(best)
    log.info("structures that no effect has", extra={"share": 0.5})
    found.open()
    best = found.descend(best)
    if len(best.charts) - len(found.world.given) >= SEVERAL:  # together they may imitate an unlisted law
        best = max(best, found.descend(root(found.world, best.nuisance)), key=found.score)

    def likelier(f: Fit) -> Fit:  # the steps of a descent may end beside a set with other laws that is likelier
        return (
            f if len(f.charts) - len(found.world.given) > MANY else max(alternatives(found, f, CLAIM), key=found.score)
        )

    best = likelier(best)
    seen: set[frozenset[str]] = set()  # what is left out may be likelier again beside the rest: it is not put back
    while (k := shaped_otherwise(found, best)) is not None:
        seen.add(frozenset(best.names))
        other = likelier(best)  # linearised evidence is not exact
        best = without(found, best, k) if other is best or frozenset(other.names) in seen else other
    best = settled(found, max([best, *elsewhere(found, best)], key=found.score))
    return Likeliest(found, best, noise, settling)


def _redeclared(f: Fit) -> Fit:
    """The fit with prior widths of declared effects that their numbers ask for: declared values may be far off."""
    return widened(f, lambda chart: chart.term.declared)


def _score(likeliest: Likeliest, plain: Samples) -> float:
    """Score of a hypothesis if noise and settling are those that suit its residual best, whatever the fit's weights."""
    found, f = likeliest.search, likeliest.best
    whiten = f.world.whiten
    own = -0.5 * float(np.sum(whiten(f.residual) ** 2)) - 0.5 * whiten.log_determinant
    return found.score(f) - own + settling_of(f.residual, whiten.noise.white, plain)[1]
