"""A diagnosis: a measured set and a declared model in; verdict, effects, calibrated model and errors out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from energy_opt.diagnose.candidates import Candidate
from energy_opt.diagnose.cross import left_out
from energy_opt.diagnose.errors import energy_errors, errors, usable
from energy_opt.diagnose.fit import Fit
from energy_opt.diagnose.joints import JointSide, joint_side
from energy_opt.diagnose.long_sets import shortened
from energy_opt.diagnose.predict import predict
from energy_opt.diagnose.predictor import calibrated, predictor
from energy_opt.diagnose.pushed import free_runs, push_words, pushes
from energy_opt.diagnose.remainder import goes_with
from energy_opt.diagnose.samples import Samples, take_samples
from energy_opt.diagnose.sides import side_remarks, side_rows, told_by
from energy_opt.diagnose.split import split
from energy_opt.diagnose.trace import Trace, excited, trace
from energy_opt.diagnose.words import headline, news, next_step, remarks, speeds_seen
from energy_opt.effects import Effect, Payload
from energy_opt.errors import BadInput
from energy_opt.measured import MeasuredSet, Smoothing
from energy_opt.power import PowerModel

STUDENT = 1.96
WIDER = 1.1  # of intervals, for errors of smoothing and clocks that repeat; from misfit sets, seeds 61 and 62
FEWEST = 20  # readings without which nothing can be said
TOLERANCE = 3.0  # [%] of energy, within which a model is good enough to plan with
RATE = 0.01  # stated rate of false claims per set


@dataclass(frozen=True)
class Diagnosis:
    """A diagnosis with what it was made from.

    Attributes:
        samples, train, holdout: all runs, and the indices of those fitted and kept.
        declared, model: the model handed in, and the calibrated one; `fit` is where its numbers come from.
        trace: what the search found. document: the content of diagnosis.json.
        side: what the joints' own readings say, None where there are none.
    """

    measured: MeasuredSet
    samples: Samples
    smoothing: Smoothing
    train: tuple[int, ...]
    holdout: tuple[int, ...]
    declared: PowerModel
    model: PowerModel
    fit: Fit
    trace: Trace
    document: dict[str, Any]
    side: JointSide | None


def diagnose(
    measured: MeasuredSet,
    declared: PowerModel,
    seed: int = 0,
    tolerance: float = TOLERANCE,
    given: tuple[str, ...] = (),
    stopped: Callable[[], bool] = lambda: False,
) -> Diagnosis:
    """Find what the declared model lacks.

    Args:
        measured: the set.
        declared: the owner's model of the same robot; a payload that the recorder states is added where it has none.
        seed: of the split into training and holdout. tolerance: of energy, %, for `usable`.
        given: declared effects whose values are free without being news.
        stopped: asked on the way; True ends the search with what is known: "interrupted", and no verdict.

    Raises:
        BadInput: the model does not fit the robot, or the set is too small to say anything.
    """
    declared.check(measured.robot.n)
    if measured.payload is not None and declared.get(Payload.name) is None:
        declared = declared.replaced(Payload(mass=measured.payload.mass, com=measured.payload.com))
    measured = shortened(_metered(measured))
    side = joint_side(measured, declared)
    found_pushes = pushes(side, measured) if side is not None else []
    measured, enough = free_runs(measured, found_pushes)
    if found_pushes and enough:
        side = joint_side(measured, declared)
    told = told_by(side, measured.robot.limits) if enough else {}
    samples, smoothing = take_samples(measured)
    if len(samples.power) < FEWEST:
        raise BadInput(f"{measured.path}: {len(samples.power)} readings in all; a diagnosis needs at least {FEWEST}")
    train, holdout = split(samples, seed)
    moving = excited(samples, measured.robot.limits)
    fitted = samples.part(train)
    found = trace(fitted, declared, measured.robot.limits, moving, given, stopped, told, blind=not enough)
    chosen = predictor(found)
    model = calibrated(found, chosen, found.rivals, WIDER)
    before = {"train": errors(declared, samples, train), "holdout": errors(declared, samples, holdout)}
    after = {"train": errors(model, samples, train), "holdout": errors(model, samples, holdout)}
    left = goes_with(found, measured.robot.joints)
    rows = side_rows(side, measured.robot.joints, measured.robot.limits, chosen if enough else None)
    document: dict[str, Any] = {
        "verdict": found.verdict or None,
        "interrupted": stopped(),
        "headline": "",
        "effects": effect_rows(found),
        "alternatives": [news(f) for f in found.rivals] if len(found.rivals) > 1 else [],
        "nuisance": _nuisance(chosen, model),
        "explained_share": explained_share(before, after, samples.floor),
        "usable": bool(holdout) and usable(energy_errors(model, samples.part(holdout)), tolerance / 100),
        "tolerance": tolerance,
        "residual_goes_with": [{k: row[k] for k in ("signal", "joint", "strength", "setting")} for row in left],
        "remainder": [{k: row[k] for k in ("signal", "joint", "watts")} for row in left],
        "error": {"before": before, "after": after, "noise_floor": samples.floor},
        "noise_floor": samples.floor,
        "noise": {"white": found.noise.white, "wave": found.noise.wave, "memory": found.noise.memory},
        "split": {"train": [samples.files[r] for r in train], "holdout": [samples.files[r] for r in holdout]},
        "declared_effects": [e.name for e in declared.effects],
        "model_effects": [e.name for e in model.effects],
        "fitted": list(given),
        "joint_side": rows,
        "next_motion": None,
        "remarks": remarks(found, measured, declared, chosen),
        "evidence": evidence_rows(found),
        "candidates": candidate_rows(found),
        "false_positive_rate": RATE,
        "robot": measured.robot.name,
        "joints": list(measured.robot.joints),
    }
    if samples.group > 1:
        document["remarks"].append(
            f"Long set: each {samples.group} neighbouring readings are averaged to one, {len(samples.power)} in all."
        )
    document["remarks"] += push_words(found_pushes, enough) + side_remarks(side, measured.robot.limits, rows)
    document["remarks"] += speeds_seen(found, measured.robot.joints)
    document["headline"] = headline(document)
    document["next_step"] = next_step(document)
    return Diagnosis(
        measured,
        samples,
        smoothing,
        tuple(train),
        tuple(holdout),
        declared,
        model,
        chosen,
        found,
        document,
        side,
    )


def _metered(measured: MeasuredSet) -> MeasuredSet:
    """The set less the runs without any reading of the meter."""
    runs = tuple(run for run in measured.runs if len(run.power))
    less = len(measured.runs) - len(runs)
    if not less:
        return measured
    remark = f"{less} run(s) without a reading of the meter left out"
    return replace(measured, runs=runs, remarks=(*measured.remarks, remark))


def explained_share(before: dict[str, Any], after: dict[str, Any], floor: float) -> float:
    """Share of the mean square above the noise floor that the calibrated model takes away, on runs held out."""
    part = "holdout" if before["holdout"] is not None else "train"
    was = before[part]["power_rmse"] ** 2 - floor**2
    now = after[part]["power_rmse"] ** 2 - floor**2
    return float(np.clip(1 - now / was, -1.0, 1.0)) if was > 0.02 * floor**2 else 0.0


def _nuisance(f: Fit, model: PowerModel) -> list[str]:
    """What was allowed for, where it shows, without being called a cause."""
    out = [name for name in ("link_inertia",) if model.get(name) is not None]
    own = np.sqrt(np.maximum(np.diag(f.covariance)[len(f.theta) - len(f.levels) :], 0.0))
    if np.any(np.abs(f.levels) > 4 * own) and float(np.std(f.levels)) > 0.2 * f.world.whiten.noise.white:
        out.append("run_offset")
    return out


def effect_rows(found: Trace) -> list[dict[str, Any]]:
    """The claimed effects, largest first, with values, intervals, share of the residual explained, and evidence."""
    f, n = found.accepted, found.accepted.world.samples.n
    if not found.claims:
        return []
    samples, declared = f.world.samples, f.world.declared
    rest = f.residual - (samples.power - f.prediction.reading)  # levels of runs, with the other sign

    def size(model: PowerModel) -> float:
        push = f.world.links.ways @ f.amounts
        own = samples.power - predict(model, samples, push).reading + rest
        return float(np.sum((own * samples.weight) ** 2))

    here = size(f.model)
    explained = max(size(declared) - here, 1e-9)
    spread, held = f.covariance, left_out(f)
    named = {c.without.names: c for c in found.claims}
    rows, at = [], 0
    for c, z in zip(f.charts, f.numbers, strict=True):
        part = slice(at, at + len(z))
        at += len(z)
        if c.term.name in f.world.given:
            continue
        claim = next(x for key, x in named.items() if c.term.name not in key)
        slope = c.slope(z)
        deviation = np.sqrt(np.maximum(np.einsum("pi,ij,pj->p", slope, spread[part, part], slope), 0.0))
        effect = f.model.get(c.term.name)
        assert effect is not None
        gained = left_out(claim.without) - held
        before = declared.get(c.term.name)
        less = f.model.without(c.term.name) if before is None else f.model.replaced(before)
        rows.append(
            {
                "name": c.term.name,
                **_parameters(effect, deviation, n),
                "share_of_residual": float(np.clip((size(less) - here) / explained, 0.0, 1.0)),
                "p_value": float(1 / (1 + np.exp(min(claim.odds, 500.0)))),
                "log_odds": float(claim.odds),
                "refit": c.term.declared,
                "left_out_gain": float(gained.sum()),
                "runs_improved": [int((gained > 0).sum()), len(gained)],
            }
        )
        rows[-1]["parameters"].update(effect.choices)
    return sorted(rows, key=lambda row: -row["share_of_residual"])


def _parameters(effect: Effect, deviation: np.ndarray, n: int) -> dict[str, Any]:
    """Values and 95 % intervals by parameter."""
    out: dict[str, Any] = {"parameters": {}, "ci95": {}, "units": {}}
    at, values = 0, effect.full(n)
    for p in effect.parameters:
        count = p.count(n, effect.extents)
        value, width = values[at : at + count], WIDER * STUDENT * deviation[at : at + count]
        low, high = np.maximum(value - width, p.lower), np.minimum(value + width, p.upper)
        at += count
        out["units"][p.name] = p.unit
        if count == 1:
            out["parameters"][p.name] = float(value[0])
            out["ci95"][p.name] = [float(low[0]), float(high[0])]
        else:
            out["parameters"][p.name] = value.tolist()
            out["ci95"][p.name] = np.column_stack([low, high]).tolist()
    return out


def evidence_rows(found: Trace, most: int = 15) -> list[dict[str, Any]]:
    """The hypotheses that were fitted, likeliest first: what they add, and the logarithm of their odds."""
    base = found.search.score(found.root)
    rows = [
        {
            "effects": list(f.names),
            "structures": [g.signal for g in f.free],
            "numbers": f.count,
            "loss_per_sample": float(np.mean(f.world.whiten(f.residual) ** 2)),
            "score": found.search.score(f) - base,
        }
        for f in found.search.fits.values()
    ]
    return sorted(rows, key=lambda row: -float(row["score"]))[:most]  # type: ignore[arg-type]


def candidate_rows(found: Trace) -> list[dict[str, Any]]:
    """Every effect that might be added: logarithm of the odds for it, alone and beside the accepted ones.

    The strongest alone come first. None where the effect is accepted already.
    """
    if not found.follows or not found.verdict:
        return []
    alone: dict[str, float] = {}
    beside: dict[str, float] = {}
    for base, best in ((found.root, alone), (found.accepted, beside)):
        bank = found.search.bank(base)
        here = found.search.whole(bank)
        value = bank.weigh(here).value
        for k, b in enumerate(bank.blocks):
            if isinstance(b.source, Candidate):
                best[b.name] = max(best.get(b.name, -np.inf), bank.weigh(here | {k}).value - value)
    rows = [{"name": name, "alone": value, "beside_accepted": beside.get(name)} for name, value in alone.items()]
    return sorted(rows, key=lambda row: -alone[str(row["name"])])
