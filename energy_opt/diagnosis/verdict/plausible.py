"""New values of declared effects that are too far from the declared ones: they imitate a law that no effect has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from energy_opt.diagnosis.fit.posterior import Fit, fit
from energy_opt.diagnosis.hypothesis.terms import entries, usual
from energy_opt.diagnosis.verdict.claims import DETAIL, RIVAL, Claim, widened

FAR = 15.0  # largest plausible value of a joint over the declared one, or over a usual one if that is larger


def times_most(f: Fit, k: int) -> np.ndarray:
    """Values (Z,) of the k-th effect over the largest plausible ones; 0 where the declared model has no such value."""
    c, scale = f.charts[k], f.world.scale
    own = [entries(c.term.kind, c.n, len(c.base))[i] for i in c.kept]
    given = zip(own, c.origin.tolist(), strict=True)
    sizes = [(usual(p.unit, j, scale) or np.inf) if p.lower == 0 < x else np.inf for (p, j, _), x in given]
    return f.numbers[k] / (FAR * np.maximum(sizes, c.origin)) if c.term.declared else np.zeros(len(c.origin))


def is_far(f: Fit, claim: Claim) -> bool:
    """True if a declared effect needs implausible values: with plausible ones it fits worse, as in `is_beyond_bounds`.

    A heat that is hundreds of times too large makes a constant power of a joint's dry friction, for example.
    """
    f = widened(f)
    k = f.names.index(claim.name)
    over = times_most(f, k)
    if (over <= 1).all():
        return False
    c = f.charts[k]
    most = np.where(over > 1, f.numbers[k] / over, c.upper)
    charts = [*f.charts[:k], replace(c, upper=most), *f.charts[k + 1 :]]
    near = fit(f.world, f.nuisance, charts, f.numbers, f.free, f.amounts)
    return _misfit(near) - _misfit(f) > RIVAL + DETAIL * claim.odds


def _misfit(f: Fit) -> float:
    """Negative log likelihood and prior of a fit."""
    off = f.theta - f.mean
    return 0.5 * float(np.sum(f.world.whiten(f.residual) ** 2) + off @ f.precision @ off)
