"""From training samples and a declared model to a verdict: which effects, which rivals, what is left."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from energy_opt.diagnose.claims import claimed
from energy_opt.diagnose.evidence import Leftover, inflation, leftover
from energy_opt.diagnose.fit import Fit
from energy_opt.diagnose.follows import follows
from energy_opt.diagnose.predict import predict
from energy_opt.diagnose.samples import Samples, weighted
from energy_opt.diagnose.search import Search, search
from energy_opt.power import PowerModel
from energy_opt.robot import Limits

TOLERANCE = 6.0  # rivals whose score is this near cannot be told from the best
EVEN = 0.5  # gain per number below which joints are alike beyond chance and share one
RIVALS = 5  # tried in place of each accepted effect
MOVES = 0.03  # [rad/s] a joint that never exceeds this does not move
SLOW = 0.1  # of a joint's velocity limit
KEPT_SHARE = 0.8  # of what can be explained that effects must hold to be named beside unlisted structure
OWN_SHARE = 0.5  # and that unlisted structures alone must miss


@dataclass(frozen=True)
class Trace:
    """What the training runs say.

    Attributes:
        root: the declared model as it is. best: the hypothesis with the best score, structures included.
        accepted: the hypothesis whose effects are claimed.
        verdict: see CONTRACT.md. rivals: hypotheses that fit equally well, the accepted one first.
        left: what `accepted` leaves. idle: joints (indices) that never move.
        follows: False where the measured power does not go with the motion, so that nothing can be claimed.
    """

    search: Search
    root: Fit
    best: Fit
    accepted: Fit
    verdict: str
    rivals: tuple[Fit, ...]
    left: Leftover
    idle: tuple[int, ...]
    follows: bool = True


def excited(samples: Samples, limits: Limits) -> np.ndarray:
    """(n,) True for the joints whose motion can show what moves them costs.

    A joint must move at all; and where no joint of the arm reaches `SLOW` of its velocity limit, all count as idle,
    since friction's dependence on speed, regeneration and inertia hide at a crawl.
    """
    fastest = np.abs(samples.v).max(axis=0)
    if (fastest < SLOW * limits.velocity).all():
        return np.zeros(samples.n, dtype=bool)
    return fastest > MOVES


def trace(samples: Samples, declared: PowerModel, moving: np.ndarray) -> Trace:
    """Run the search and judge it.

    Args:
        samples: the training runs.
        declared: the owner's model.
        moving: (n,) True for the joints that the set excites, see `excited`.
    """
    now = predict(declared, samples)
    samples = weighted(samples, now.reading)
    idle = tuple(int(j) for j in np.flatnonzero(~moving))
    if not follows(samples, now):
        found = Search(samples, declared)
        root = found.hypothesis((), [], ())
        return Trace(found, root, root, root, "unexplained", (root,), leftover(root, root, samples), idle, False)
    found = search(samples, declared)
    root = found.hypothesis((), [], ())
    best = _refine(found, found.ranked()[0])
    found.inflation = inflation(best, samples)
    if found.inflation > 1:
        found.looked.clear()
        best = _refine(found, found.ranked()[0])
    listed = _listed(found, best)
    left = leftover(best, root, samples)
    if best.extras or left.structured:
        accepted = claimed(found, _kept(found, root, best, listed))
        verdict = "unexplained"
        rivals: tuple[Fit, ...] = (accepted,)
    else:
        accepted = claimed(found, listed)
        rivals = _rivals(found, accepted)
        simpler = [f for f in rivals if set(f.names) < set(accepted.names)]
        if simpler:  # the data do not insist on more
            accepted = min(simpler, key=lambda f: (len(f.terms), found.score(f)))
            rivals = _rivals(found, accepted)
        verdict = "explained" if accepted.terms else "nothing_missing"
        if len(rivals) > 1:
            verdict = "ambiguous"
        if accepted.terms != listed.terms and leftover(accepted, root, samples).structured:
            verdict = "unexplained"  # what there is cannot be claimed
    if idle:
        verdict = "insufficient" if verdict != "ambiguous" else verdict
    final = _settled(_per_joint(found, accepted), samples)
    rivals = tuple(_settled(f, samples) for f in rivals)
    return Trace(found, root, best, final, verdict, rivals, leftover(accepted, root, samples), idle)


def _refine(found: Search, start: Fit) -> Fit:
    """Swap and drop terms until the score no longer falls; with unlisted structure the verdict stands without."""
    best = found.polish(start)
    for _ in range(8):
        if found.exhausted or best.extras:
            break
        before = found.score(best)
        options = []
        for k in range(len(best.terms)):
            less = found.without(best, k)
            options.append(less)
            for _, candidate, weights in found.proposals(less)[:RIVALS]:
                options.append(found.add(less, candidate, weights))
        for value, candidate, weights in found.proposals(best)[:2]:
            if value > 0:
                options.append(found.add(best, candidate, weights))
        if options:
            near = sorted(options, key=found.score)[:3]
            polished = [found.polish(f) for f in near]
            top = min(polished, key=found.score)
            if found.score(top) < before - 1e-6:
                best = top
                continue
        break
    return best


def _listed(found: Search, best: Fit) -> Fit:
    """The best hypothesis without unlisted structures."""
    if not best.extras:
        return best
    return found.polish(next(f for f in found.ranked() if not f.extras))


def _kept(found: Search, root: Fit, best: Fit, listed: Fit) -> Fit:
    """Effects that stand beside unlisted structure: only those that hold what structures cannot.

    Claimed are the effects of the best hypothesis without structures, where they explain `KEPT_SHARE` of what can be
    explained, and where the effects of the best hypothesis hold `OWN_SHARE` of it that its structures alone do not.
    """
    explainable = root.loss - min(best.loss, listed.loss)
    if not best.terms or not listed.terms or explainable <= 0:
        return root
    alone = found.hypothesis((), [], best.extras, thorough=True) if best.extras else root
    own = (alone.loss - best.loss) / explainable
    share = (root.loss - listed.loss) / explainable
    return listed if share > KEPT_SHARE and own > OWN_SHARE else root


def _rivals(found: Search, accepted: Fit) -> tuple[Fit, ...]:
    """Hypotheses with other effects, no more of them, whose score is as good."""
    limit = found.score(accepted) + TOLERANCE
    out = {frozenset(accepted.names): accepted}
    for f in found.ranked():
        if found.score(f) > limit + 40:
            break
        names = frozenset(f.names)
        if f.extras or names in out or len(f.terms) > len(accepted.terms):
            continue
        f = found.polish(f)
        if found.score(f) <= limit:
            out[names] = f
    return tuple(out.values())


def _per_joint(found: Search, accepted: Fit) -> Fit:
    """One number per joint in place of a shared one where the data carry it."""
    best = accepted
    for k, term in enumerate(accepted.terms):
        if term.mode not in ("shared", "scale"):
            continue
        joint = replace(term, mode="joint")
        terms = tuple(joint if i == k else t for i, t in enumerate(best.terms))
        starts = [_spread(best, i, found.samples.n) if i == k else z for i, z in enumerate(best.numbers)]
        trial = found.hypothesis(terms, starts, best.extras, thorough=True)
        if (best.loss - trial.loss) / found.inflation > EVEN * (trial.count - best.count):
            best = trial
    return best


def _settled(f: Fit, samples: Samples) -> Fit:
    """Joints whose number the data leave open take the median of the others.

    Open is a number whose standard error, noise over the norm of its column, exceeds the usual size of such numbers:
    that of a joint that (nearly) rests, whose fitted value is an accident.
    """
    numbers, model, at = list(f.numbers), f.model, 0
    for k, (term, chart) in enumerate(zip(f.terms, f.charts, strict=True)):
        column = np.linalg.norm(f.jacobian[:, at : at + len(numbers[k])], axis=0)
        at += len(numbers[k])
        if term.mode != "joint" or term.joints is not None:
            continue
        z, row = numbers[k].copy(), 0
        for p in term.kind.parameters:
            block = slice(row, row + p.count(samples.n))
            row = block.stop
            usual = float(np.median(np.abs(z[block])))
            free = samples.noise > usual * column[block]
            if p.size == "joint" and free.any() and not free.all():
                z[block] = np.where(free, np.median(z[block][~free]), z[block])
        numbers[k] = z
        model = model.replaced(term.effect(chart.values(z), samples.n))
    return replace(f, numbers=tuple(numbers), model=model)


def _spread(f: Fit, index: int, n: int) -> np.ndarray:
    """The numbers of a shared term, one per joint."""
    from energy_opt.diagnose.terms import chart

    term, own = f.terms[index], f.charts[index]
    joint = chart(replace(term, mode="joint"), f.model.without(term.name), n)
    x = term.kind.to_chart(own.values(f.numbers[index]), n)
    return np.linalg.lstsq(joint.matrix, x, rcond=None)[0]
