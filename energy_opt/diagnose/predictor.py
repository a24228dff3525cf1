"""The model to plan with: the best predictor of runs left out, physical, whatever may be claimed of causes.

Tried are the declared model, what is claimed, the likeliest hypothesis with its links, and in place of its friction
laws a free curve over speed for every joint. The one that foresees runs left out best is taken; a richer one must be
better by more than chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from energy_opt.diagnose.cross import left_out
from energy_opt.diagnose.ease import eased
from energy_opt.diagnose.fit import Fit, Stopped
from energy_opt.diagnose.search import Search
from energy_opt.diagnose.terms import Chart, Term, chart
from energy_opt.diagnose.trace import Trace
from energy_opt.effects import FrictionCurve
from energy_opt.power import PowerModel
from energy_opt.power.model import Doubt

FRICTIONS = (
    "coulomb_friction",
    "viscous_friction",
    "stribeck_friction",
    "power_law_friction",
    "asymmetric_friction",
    "thermal_viscous",
)
POINTS = 6  # of a friction curve
BETTER = 0.02  # share by which a richer model must foresee better


def predictor(found: Trace) -> Fit:
    """The fit that foresees best; what is accepted, or else known, where the work was stopped."""
    try:
        return _foreseeing_best(found)
    except Stopped:
        return found.accepted if found.verdict else found.root if found.best.free else found.best


def _foreseeing_best(found: Trace) -> Fit:
    search = found.search
    if not found.follows or found.blind:
        return found.root
    tried = [found.root, found.accepted]
    if found.best is not found.accepted:
        tried.append(eased(_plain(search, found.best)))
    tried += _curves(search, tried[-1])
    losses = [float(left_out(f).sum()) for f in tried]
    best = 0
    for k in range(1, len(tried)):
        if losses[k] < losses[best] * (1 - (BETTER if k > 1 else 0.0)):
            best = k
    return tried[best]


def _plain(search: Search, f: Fit) -> Fit:
    """A hypothesis less its free functions, which no plan can use."""
    if not f.free:
        return f
    return search.fitted(list(f.charts), list(f.numbers), [], f.nuisance, f.amounts)


def _curves(search: Search, f: Fit) -> list[Fit]:
    """The hypothesis with its frictions (or none) as a free curve, and standby and copper loss fitted anew."""
    s, declared = search.world.samples, search.world.declared
    fastest = float(np.quantile(np.abs(s.v).max(axis=1), 0.995))
    if fastest < 0.05 or declared.get(FrictionCurve.name) is not None:
        return []
    kept = [(c, z) for c, z in zip(f.charts, f.numbers, strict=True) if c.term.name not in FRICTIONS]
    for name in ("standby", "copper_loss"):
        if declared.get(name) is not None and name not in [c.term.name for c, _ in kept]:
            c = chart(Term(name, declared=True), declared, search.world.scale, s.n)
            if not c.unknown.any():
                kept.append((c, c.origin))
    speed = fastest * np.linspace(0, 1, POINTS) ** 1.5
    term = Term(FrictionCurve.name, (f"points={POINTS}",), (*speed, *np.zeros(s.n * POINTS)))
    curve = chart(term, declared, search.world.scale, s.n)
    charts: list[Chart] = [c for c, _ in kept] + [curve]
    starts = [z for _, z in kept] + [np.full(len(curve.origin), 1e-3)]
    return [search.fitted(charts, starts, [], f.nuisance, f.amounts)]


def calibrated(found: Trace, f: Fit, rivals: Sequence[Fit], wider: float) -> PowerModel:
    """The model of a fit, with its links, its doubt and its rivals."""
    model = f.full_model(links=found.follows and _links_help(f))
    names: list[str] = []
    slopes, at = [], 0
    for c, z in zip(f.charts, f.numbers, strict=True):
        effect = model.get(c.term.name)
        assert effect is not None
        names += [f"{effect.name}.{p.name}.{k}" for p in effect.parameters for k in range(effect.values[p.name].size)]
        block = np.zeros((c.values(z).size, f.count))
        block[:, at : at + len(z)] = c.slope(z)
        slopes.append(block)
        at += len(z)
    others = tuple(r.full_model(links=False) for r in rivals if r.names != f.names)
    if not slopes:
        doubt = Doubt((), np.zeros((0, 0)), others) if others else None
        return replace(model, doubt=doubt)
    slope = np.vstack(slopes)
    own = f.covariance[: f.count, : f.count] * wider**2
    matrix = slope @ own @ slope.T
    return replace(model, doubt=Doubt(tuple(names), (matrix + matrix.T) / 2, others))


def _links_help(f: Fit) -> bool:
    """Do the links' deviations show at all, beyond what is known before?"""
    count = len(f.levels)
    amounts = f.amounts
    if not len(amounts):
        return False
    spread = f.covariance[f.jacobian.shape[1] - count - len(amounts) : f.jacobian.shape[1] - count]
    own = np.sqrt(np.diag(spread[:, f.jacobian.shape[1] - count - len(amounts) : f.jacobian.shape[1] - count]))
    return bool(np.any(np.abs(amounts) > 3 * own))
