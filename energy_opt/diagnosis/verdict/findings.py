"""The findings of a diagnosis: claimed effects with values and intervals, and their form in diagnosis.json."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from energy_opt.diagnosis.data.predict import predict
from energy_opt.diagnosis.data.samples import Samples
from energy_opt.diagnosis.fit.posterior import Fit
from energy_opt.diagnosis.hypothesis.terms import entries
from energy_opt.diagnosis.joint_side import JointSide
from energy_opt.diagnosis.verdict.inference import Inference
from energy_opt.effects import Effect, LinkInertia
from energy_opt.effects.parameter import Parameter
from energy_opt.measured import MeasuredSet
from energy_opt.power import PowerModel
from energy_opt.results import Document
from energy_opt.robot.limits import sliding

STUDENT = 1.96
SHOWN = 15  # most hypotheses in diagnosis.json


@dataclass(frozen=True)
class Finding:
    """An effect that is claimed.

    Attributes:
        parameters, ci95, units: values, 95 % intervals and units by parameter; a unit per joint if some joint slides.
        share_of_residual: share of the squares explained by all effects that is lost without this one.
        log_odds: for the effect, None if unknown. refit: True if the declared model has the effect.
    """

    name: str
    parameters: dict[str, Any]
    ci95: dict[str, Any]
    units: dict[str, str | list[str]]
    share_of_residual: float
    log_odds: float | None = None
    refit: bool = False

    def document(self) -> dict[str, Any]:
        """As in diagnosis.json. It states no p-value: effects are chosen among many, for which none is calibrated."""
        return {**asdict(self), "p_value": None}


def findings_of(found: Inference) -> list[Finding]:
    """The claimed effects, largest first."""
    if found.links:
        return [_of_links(found)]
    if not found.claims:
        return []
    f, n = found.accepted, found.accepted.world.samples.n
    samples, declared = f.world.samples, f.world.declared
    rest = f.residual - (samples.power - f.prediction.reading)  # minus the levels of the runs

    def size(model: PowerModel) -> float:
        own = samples.power - predict(model, samples, f.world.links.torques @ f.amounts).reading + rest
        return float(np.sum((own * samples.weight) ** 2))

    here = size(f.model)
    explained = max(size(declared) - here, 1e-9)
    records = []
    for c, deviation in zip(f.charts, f.deviations, strict=True):
        claim = next((x for x in found.claims if x.name == c.term.name), None)
        if claim is None:
            continue
        effect = f.model.get(c.term.name)
        assert effect is not None
        # the end of a motion, and of a hold after it, are each known to a reading; that of a hold which outlasts every
        # dwell is not known at all
        stepped = [p.steps and p.unit == "s" for p, *_ in entries(c.term.kind, n, len(deviation))]
        value = effect.full(n)
        unsure = np.where(value > samples.idle.max(initial=0.0), value / STUDENT, samples.step / 2)
        deviation = np.where(stepped, np.maximum(deviation, unsure), deviation)
        less = c.out_of(f.model, declared)
        if found.unknown:
            deviation = np.hypot(deviation, between(effect, found.rivals, n))
        values = _values(effect, deviation, samples.body.slides)
        values[0].update(effect.choices)
        share = float(np.clip((size(less) - here) / explained, 1e-6, 1.0))
        records.append(Finding(c.term.name, *values, share, claim.odds, c.term.declared))
    return sorted(records, key=lambda row: -row.share_of_residual)


def between(effect: Effect, rivals: Sequence[Fit], n: int) -> np.ndarray:
    """Rms (P,) by which an effect's values differ in fits that predict as well; without the effect they are neutral.

    Where no law holds in detail, none of these fits tells how much of the power is the effect's and how much another's.
    """
    own, kind = effect.full(n), type(effect)
    shapes = [p.shapes for p, *_ in entries(kind, n, len(own))]
    absent = np.where(shapes, own, kind.neutral(n, **effect.choices, **effect.extents).full(n))
    others = [absent if (e := f.model.get(effect.name)) is None else e.full(n) for f in rivals]
    return np.asarray(np.sqrt(np.mean([(x - own) ** 2 for x in others if len(x) == len(own)], axis=0)))


def _of_links(found: Inference) -> Finding:
    """Finding for link deviations."""
    f, samples = found.accepted, found.accepted.world.samples
    spread = f.link_covariance

    def values(d: np.ndarray) -> np.ndarray:
        return f.world.links.effect(d, samples).full(samples.n)

    steps = np.sqrt(np.diag(spread))
    slope = np.column_stack([(values(f.amounts + s * e) - values(f.amounts - s * e)) / (2 * s)
                             for s, e in zip(steps, np.eye(len(steps)), strict=True)])  # fmt: skip
    deviation = np.sqrt(np.maximum(np.einsum("pi,ij,pj->p", slope, spread, slope), 0.0))
    effect = found.model.get(LinkInertia.name)
    assert effect is not None
    return Finding(LinkInertia.name, *_values(effect, deviation, samples.body.slides), 1.0)


def unit_of_joints(p: Parameter, slides: Sequence[bool]) -> str | list[str]:
    """The unit of a parameter; one for each joint if it has a value per joint and some joint slides."""
    if p.dimensions != ("joint",) or not any(slides):
        return p.unit
    return [sliding(p.unit) if own else p.unit for own in slides]


def _values(
    effect: Effect, deviation: np.ndarray, slides: Sequence[bool]
) -> tuple[dict[str, Any], dict[str, Any], dict[str, str | list[str]]]:
    """Values, 95 % intervals and units by parameter; values are those of the written model."""
    values: dict[str, Any] = {}
    intervals: dict[str, Any] = {}
    units: dict[str, str | list[str]] = {}
    n = len(slides)
    full, at = effect.full(n), 0
    for p in effect.parameters:
        count = p.count(n, effect.extents)
        value, width = full[at : at + count], STUDENT * deviation[at : at + count]
        low, high = np.maximum(value - width, p.lower), np.minimum(value + width, p.upper)
        at += count
        units[p.name] = unit_of_joints(p, slides)
        single = count == 1
        values[p.name] = float(value[0]) if single else value.tolist()
        intervals[p.name] = [float(low[0]), float(high[0])] if single else np.column_stack([low, high]).tolist()
    return values, intervals, units


def nuisance_of(found: Inference) -> list[str]:
    """Names of significant nuisances of the fit that are not reported as causes."""
    f: Fit = found.accepted
    out = [LinkInertia.name] if found.model.get(LinkInertia.name) is not None and not found.links else []
    if np.any(np.abs(f.levels) > 4 * f.level_deviations) and float(np.std(f.levels)) > 0.2 * f.world.whiten.noise.white:
        out.append("run_offset")
    return out


def evidence_records(found: Inference) -> list[dict[str, Any]]:
    """Records of the likeliest fitted hypotheses: their additions, and the logarithm of their odds."""
    base = found.search.score(found.root)
    records = [
        {
            "effects": list(f.names),
            "structures": [g.signal for g in f.free],
            "numbers": f.count,
            "loss_per_sample": float(np.mean(f.world.whiten(f.residual) ** 2)),
            "score": found.search.score(f) - base,
        }
        for f in found.search.fits.values()
    ]
    return sorted(records, key=lambda row: -float(row["score"]))[:SHOWN]  # type: ignore[arg-type]


@dataclass(frozen=True, repr=False, eq=False)
class Result:
    """A diagnosis with its inputs.

    Attributes:
        measured, declared, model: the set, the model handed in, and the calibrated one.
        effects: claimed effects.
        document: returns the content of diagnosis.json.
        samples, train, holdout: all runs, and the indices of those fitted and kept; None and none without a meter.
        inference: result of the search, None without a meter.
        side: fit of the joints' own readings, None if there are none.
    """

    measured: MeasuredSet
    declared: PowerModel
    model: PowerModel
    effects: tuple[Finding, ...]
    document: Document
    side: JointSide | None
    samples: Samples | None = None
    train: tuple[int, ...] = ()
    holdout: tuple[int, ...] = ()
    inference: Inference | None = None
