"""Which sets of effects remain beside the accepted one, because they explain the data as well."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from energy_opt.diagnosis.fit.posterior import Fit
from energy_opt.diagnosis.search.effect_sets import ODDS, Search, root
from energy_opt.diagnosis.search.kinks import USUAL
from energy_opt.diagnosis.verdict.claims import Claim, alternatives, widened
from energy_opt.diagnosis.verdict.judge import Judge

ALIKE = 1.1  # factor on the held-out error within which a set predicts equally well
HALF = 0.5  # least log odds of such a set, as a share of those of the accepted one


def as_good(found: Search, judge: Judge, accepted: Fit) -> tuple[Fit, ...]:
    """If a law is not in the library: all sets that predict held-out motions as well, highest prior odds first.

    Evidence compares the details of laws. Small differences decide nothing here, because no law holds in detail. But a
    set that has less than `HALF` of the log odds of another does not explain the same.
    """
    most = ALIKE * judge.of(accepted).rmse
    none = found.score(root(found.world, accepted.nuisance))
    least = none + HALF * (found.score(accepted) - none)
    rivals = [
        f for f in alternatives(found, accepted, np.inf)
        if f is accepted or (judge.of(f).rmse <= most and found.score(f) > least)
    ]  # fmt: skip
    return tuple(sorted(rivals, key=found.odds, reverse=True))


def left_open(found: Search, judge: Judge, rivals: tuple[Fit, ...], reach: float) -> tuple[Fit, ...]:
    """Those of `rivals` whose log odds, with held-out motions, are within `reach` of the best, the likeliest first.

    The lower prior odds of rare effects exclude none of them, nor do priors that are narrower than the numbers ask for.
    Dry and viscous friction, which most arms have together, count as one effect. Laws that agree to first order, as
    load friction and gear efficiency, have equal evidence before they are fitted: rounding decides which of them the
    search finds.
    """
    gains = [0.0 if judge.held is None else float(np.sum(judge.gains(f, rivals[0]))) for f in rivals]
    views = np.array(
        [
            (found.score(f), found.level_score(f), found.score(f) - (ODDS if pair(f) else 0), found.score(widened(f)))
            for f in rivals
        ]
    )
    scores = views + np.array(gains)[:, None]
    order = sorted(range(len(rivals)), key=lambda k: -scores[k, 0])
    return tuple(rivals[k] for k in order if (scores[k] > scores[order[0]] - reach).any())


def pair(f: Fit) -> tuple[str, ...]:
    """Dry and viscous friction if a fit has both, else nothing: effects that most arms have together."""
    return USUAL if {*USUAL} <= {*f.names} else ()


def supported(
    found: Search, rivals: Sequence[Fit], borne: Sequence[tuple[Fit, tuple[Claim, ...]]], misspecified: bool
) -> tuple[tuple[Fit, ...], dict[int, tuple[Claim, ...]]]:
    """The rivals all of whose effects are certain enough, and their claims by the identity of the fit.

    A rival that is likelier without its uncertain effects counts without them.

    Args:
        borne: of each rival the part that is certain enough, with its claims.
        misspecified: an unknown law rules; then no part of a rival counts.
    """
    out: dict[frozenset[str], tuple[Fit, tuple[Claim, ...]]] = {}
    for f, (part, claims) in zip(rivals, borne, strict=True):
        likelier = not misspecified and found.score(part) > found.score(f)
        if claims and (part.names == f.names or likelier):
            out.setdefault(frozenset(part.names), (part, claims))
    return tuple(f for f, _ in out.values()), {id(f): claims for f, claims in out.values()}
