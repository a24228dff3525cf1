"""The model that predicts best where no cause can be named."""

from __future__ import annotations

from energy_opt.diagnosis.search.effect_sets import without
from energy_opt.diagnosis.verdict.claims import plain_fit, written
from energy_opt.diagnosis.verdict.inference import Inference
from energy_opt.diagnosis.verdict.plausible import times_most
from energy_opt.power import PowerModel


def predictor_of(found: Inference) -> PowerModel | None:
    """The likeliest hypothesis as a model, for a set whose verdict is `unexplained`; else None.

    Several effects together imitate a law that no effect has. None of them is a cause, but they may predict other
    motions better than the declared model does. Effects that the declared model lacks are left out if a plan does not
    follow them: those of the meter, and changes with time. No value of a declared effect may be implausible, and links
    alone are no such model.
    """
    best = found.best
    if found.verdict != "unexplained" or found.blind or not found.follows or best is found.accepted:
        return None
    for k in range(len(best.charts) - 1, -1, -1):
        term = best.charts[k].term
        if not term.declared and (term.kind.stage == "meter" or term.kind.drifts):
            best = without(found.search, best, k)
    if not best.charts or any((times_most(best, k) > 1).any() for k in range(len(best.charts))):
        return None
    return written(plain_fit(found.search, best))
