"""Diagnosis of a measured set: from the set and a declared model to verdict, effects, calibrated model and errors.

This module joins the rooms: the set is prepared and split, the joints' own readings give priors and show external
contact, the inference judges effects, and the result becomes diagnosis.json and a model file. A set without a meter
still gives friction, rotor inertia and drive constants, from the joints' readings alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from energy_opt.diagnosis.data.clipped import unclipped
from energy_opt.diagnosis.data.clusters import excited, parted, split
from energy_opt.diagnosis.data.recordings import on_time, prepared, take_samples
from energy_opt.diagnosis.data.samples import Samples
from energy_opt.diagnosis.evidence.errors import errors
from energy_opt.diagnosis.evidence.odds import SPREADS
from energy_opt.diagnosis.evidence.residual import Attribution, goes_with, mode_words, modes_of
from energy_opt.diagnosis.fit.posterior import Fit, fit
from energy_opt.diagnosis.joint_side import free_runs, joint_side, push_words, pushes
from energy_opt.diagnosis.report.joint_report import (
    friction_findings,
    prior_of,
    side_records,
    side_remarks,
    wrong_units,
)
from energy_opt.diagnosis.report.remarks import remarks, speeds_seen
from energy_opt.diagnosis.report.words import UNRECORDED, WARMS, headline, joints_headline, next_step, summary
from energy_opt.diagnosis.verdict.claims import written
from energy_opt.diagnosis.verdict.findings import Finding, Result, evidence_records, findings_of, nuisance_of
from energy_opt.diagnosis.verdict.inference import Inference, infer, plain_fit
from energy_opt.diagnosis.verdict.predictor import predictor_of
from energy_opt.diagnosis.verdict.usable import foreseen_by
from energy_opt.effects import LinkInertia, Payload, effect_class
from energy_opt.errors import BadInput
from energy_opt.files import write_json
from energy_opt.measured import MeasuredSet
from energy_opt.power import PowerModel
from energy_opt.power.model import Uncertainty
from energy_opt.power.warm import warmed
from energy_opt.results import Document

LEAST = 0.1  # share of the rms residual that a signal must explain to be named
FEWEST = 20  # least readings for a diagnosis
MOSTLY = 0.5  # least share of the mean square error above the noise that effects without a claim must remove
TOLERANCE = 3.0  # [%] energy error up to which a model is good enough to plan with


@dataclass(frozen=True, repr=False, eq=False)
class Diagnosis(Result):
    """A diagnosis with its inputs, see `Result`; it can be printed and saved."""

    @property
    def verdict(self) -> str:
        """As in diagnosis.json; "" where the search was stopped."""
        return self.document()["verdict"] or ""

    def save(self, out: str | PathLike[str]) -> Path:
        """Write diagnosis.json, model.toml, model_warm.toml if the model warms, and report.html into a folder."""
        from energy_opt.diagnosis.report.page import page  # plots are slow to import

        out = Path(out)
        out.mkdir(parents=True, exist_ok=True)
        write_json(out / "diagnosis.json", self.document())
        self.model.save(out / "model.toml")
        if (warm := warmed(self.model)) is not None:
            warm.save(out / "model_warm.toml")
        page(self).write(out / "report.html")
        return out

    def __repr__(self) -> str:
        names = ", ".join(x.name for x in self.effects)
        return f"Diagnosis({self.verdict or 'stopped'!r}, {self.document()['robot']!r}, effects=[{names}])"

    def __str__(self) -> str:
        return summary(self.document())


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
        measured: the set. Without any reading of a meter, the joints' currents or torques alone are used.
        declared: the owner's model of the same robot; a payload that the recorder states is added where it has none.
        seed: of the split into training and holdout. tolerance: [%] energy error for `usable`.
        given: declared effects whose values are fitted but not reported as findings.
        stopped: called during the search; True ends it: the result is "interrupted", and has a verdict only
            if nothing but a second search, which supposes that the power settles after stops, was left.

    Raises:
        BadInput: the model does not fit the robot, or the set has too few readings for a diagnosis.
    """
    declared.check(measured.robot.n)
    if measured.payload is not None and declared.get(Payload.name) is None:
        declared = declared.for_move(Payload(mass=measured.payload.mass, com=measured.payload.com))
    if not any(len(run.power) for run in measured.runs):
        return _of_joints(measured, declared)
    readings = np.concatenate([run.power for run in measured.runs])
    if len(readings) >= FEWEST and np.ptp(readings) == 0:
        raise BadInput(f"{measured.path}: the power is {readings[0]:g} W throughout; is the meter connected?")
    measured = parted(prepared(measured))
    # the joints' readings: priors for friction, and runs with external contact, whose losses are not the arm's
    side = joint_side(measured, declared)
    if side is not None and (wrong := wrong_units(side)):
        side, measured = None, replace(measured, remarks=(*measured.remarks, wrong))
    found_pushes = pushes(side, measured) if side is not None else []
    measured, enough = free_runs(measured, found_pushes)
    if found_pushes and enough:
        side = joint_side(measured, declared)
    prior = prior_of(side) if enough else {}
    limits, joints = measured.robot.limits, measured.robot.joints
    samples = take_samples(measured)
    if (kept := unclipped(measured, samples, declared)) is not measured:
        measured, samples = kept, take_samples(kept)

    def inferred(samples: Samples, clock: bool) -> tuple[Samples, list[int], list[int], Inference]:
        if len(samples.power) < FEWEST:
            raise BadInput(
                f"{measured.path}: {len(samples.power)} readings in all; a diagnosis needs at least {FEWEST}"
            )
        train, holdout = split(samples, seed)
        held, moving = samples.part(holdout) if holdout else None, excited(samples, limits)
        return samples, train, holdout, infer(
            samples.part(train), declared, limits, moving, held, given, stopped, prior, blind=not enough, clock=clock
        )  # fmt: skip

    # an error of the clocks must not be claimed as a property of the meter: it is removed, and the set judged anew
    samples, train, holdout, found = inferred(samples, True)
    if found.late:
        measured = on_time(measured, found.late)
        samples, train, holdout, found = inferred(take_samples(measured), False)
    model = replace(found.model, uncertainty=_covariance(found))

    def judged(model: PowerModel) -> dict[str, Any]:
        return {"train": errors(model, samples, train), "holdout": errors(model, samples, holdout)}

    before, after = judged(declared), judged(model)
    # a fit without a claim is not written if it predicts held-out motions worse than the declared model
    unclaimed, one, other = not found.claims and not found.links, after["holdout"], before["holdout"]
    rejected = unclaimed and one is not None and other is not None and one["power_rmse"] > other["power_rmse"]
    if rejected:
        found, model, after = replace(found, model=declared, after=found.before), declared, before
    floor = found.after.floor(found.verdict in ("partly", "unexplained"))
    # effects that together imitate an unknown law are no causes, but the best predictor
    if after["holdout"] is not None and (predictor := predictor_of(found)) is not None:
        likelier = judged(predictor)
        less = likelier["holdout"]["energy_percent"] < after["holdout"]["energy_percent"]
        if less and explained_share(before, likelier, floor) > MOSTLY:
            model, after = predictor, likelier
    effects, left = findings_of(found), _attributions(found, joints, samples)
    ahead = foreseen_by(found, model, samples, joints)
    if ahead.reason and left and left[0].change is not None:
        ahead = replace(ahead, reason="the level of the power changed once")
    if found.unit or not found.verdict:
        reason = (
            f"the power may be in {found.unit[0]}" if found.unit else "the search was stopped before it had a verdict"
        )
        ahead = replace(ahead, reason=reason)
    share, links = explained_share(before, after, floor), 0.0
    if found.claims and model.get(LinkInertia.name) is not None:
        links = max(share - explained_share(before, judged(_on_urdf(found.accepted)), floor), 0.0)
    records = side_records(side, found.accepted if enough else None)
    modes = modes_of(model, samples)
    document: dict[str, Any] = {
        "verdict": found.verdict or None,
        "interrupted": stopped(),
        "headline": "",
        **_entries(measured, model, effects, records),
        # without effects that were free from the start; a fit without others explains the data by its links
        "alternatives": [[x for x in f.names if x not in given] or [LinkInertia.name] for f in found.rivals]
        if len(found.rivals) > 1
        else [],
        "nuisance": nuisance_of(found),
        "explained_share": share,
        "links_share": links,
        "usable": ahead.usable(after["holdout"] or after["train"], tolerance),
        "tolerance": tolerance,
        "foreseen": ahead.document(),
        "residual_goes_with": [{"signal": r.signal, "joint": r.joint, "strength": r.strength} for r in left],
        "remainder": [r.document() for r in left],
        "error": {"before": before, "after": after, "noise_floor": floor, "beside_noise": found.beside_noise},
        "noise_floor": floor,
        "noise": vars(found.noise),
        "split": {"train": [samples.files[r] for r in train], "holdout": [samples.files[r] for r in holdout]},
        "declared_effects": [e.name for e in declared.effects],
        "fitted": list(given),
        "modes": [vars(mode) for mode in modes],
        "remarks": [*remarks(found, measured, declared, links), *mode_words(modes)],
        "evidence": evidence_records(found),
    }
    if samples.group > 1:
        document["remarks"].append(
            f"Long set: each {samples.group} neighbouring readings are averaged to one, {len(samples.power)} in all."
        )
    if rejected:
        document["remarks"].append(
            "The fitted model predicts held-out motions worse than the declared one: model.toml holds the declared one."
        )
    document["remarks"] += push_words(found_pushes, enough) + side_remarks(side, records)
    document["remarks"] += speeds_seen(found, joints)
    document["remarks"] += [WARMS] if warmed(model) is not None else []
    document["headline"] = headline(document, [joints[j] for j in found.idle] if len(found.idle) < len(joints) else [])
    document["next_step"] = next_step(document, found.follows)
    if found.unit:
        document["headline"] = f"The power seems to be in {found.unit[0]}, not in W; {document['headline']}"
        document["next_step"] = "Next: give the power's unit in log.toml, and diagnose the set again."
    return Diagnosis(
        measured, declared, model, tuple(effects), Document(document), side, samples, tuple(train), tuple(holdout),
        found,
    )  # fmt: skip


def _entries(
    measured: MeasuredSet, model: PowerModel, effects: Sequence[Finding], records: list[dict[str, Any]]
) -> dict[str, Any]:
    """Entries of diagnosis.json that sets with and without a meter have in common."""
    return {
        "effects": [x.document() for x in effects],
        "model_effects": [e.name for e in model.effects],
        "joint_side": records,
        "next_motion": None,
        "worth": None,
        "robot": measured.robot.name,
        "joints": list(measured.robot.joints),
    }


def explained_share(before: dict[str, Any], after: dict[str, Any], floor: float) -> float:
    """Share of the mean square above the noise floor that the calibrated model removes, on held-out runs if any.

    It is 0 if hardly anything (2 % of the floor's square) was above the floor.

    Args:
        before, after: `errors` of the declared and the calibrated model, of "train" and of "holdout" (None without).
        floor: [W] rms error that noise alone causes.
    """
    part = "holdout" if before["holdout"] is not None else "train"
    was = before[part]["power_rmse"] ** 2 - floor**2
    now = after[part]["power_rmse"] ** 2 - floor**2
    return float(np.clip(1 - now / was, 0.0, 1.0)) if was > 0.02 * floor**2 else 0.0


def _on_urdf(f: Fit) -> PowerModel:
    """Model of the effects of a fit, fitted again without deviating links."""
    return written(fit(f.world, replace(f.nuisance, spread=min(SPREADS)), f.charts, f.numbers), links=False)


def _attributions(found: Inference, joints: tuple[str, ...], samples: Samples) -> list[Attribution]:
    """Signals that the residual correlates with, if more than noise is left."""
    if not found.follows or found.blind or found.verdict not in ("partly", "unexplained"):
        return []
    left = max(found.after.rmse**2 - found.after.noise**2, 0.0) ** 0.5
    records = goes_with(plain_fit(found.search, found.accepted), found.best.free, joints, found.model, samples)
    accepted = {g.signal for g in found.best.free}
    kept = [row for row in records if row.watts > LEAST * left or row.signal in accepted]
    return kept or [Attribution(UNRECORDED, None, 1.0, (found.fitted or found.after).excess)]


def _covariance(found: Inference) -> Uncertainty | None:
    """Parameter covariance of the written model, and the other models that explain the data equally well.

    Values that the fit leaves as declared keep their covariance, and a model without a new cause keeps its rivals. A
    standby that takes the mean level of the runs (see `written`) has the variance of this mean.
    """
    f, model, last = found.accepted, found.model, found.search.world.declared.uncertainty
    names: list[str] = []
    slopes, size = [], len(f.theta)
    for c, z, place in zip(f.charts, f.numbers, f.places, strict=True):
        effect = model.get(c.term.name)
        assert effect is not None
        names += [f"{effect.name}.{p.name}.{k}" for p in effect.parameters for k in range(effect.values[p.name].size)]
        block = np.zeros((c.values(z).size, size))
        block[:, place] = c.slope(z)
        slopes.append(block)
    known = set(f.names)
    if "standby" not in known and model.get("standby") != found.search.world.declared.get("standby"):
        known.add("standby")
        names.append("standby.power.0")
        slopes.append(np.where(np.arange(size) < size - len(f.levels), 0.0, 1 / len(f.levels))[None])
    slope = np.vstack(slopes) if slopes else np.zeros((0, size))
    matrix = slope @ f.covariance @ slope.T
    others = tuple(r.full_model(links=False) for r in found.rivals[1:])
    if last is not None:
        left = {e.name for e in model.effects} - known
        kept = [k for k, name in enumerate(last.names) if name.partition(".")[0] in left]
        names += [last.names[k] for k in kept]
        matrix = block_diag(matrix, last.matrix[np.ix_(kept, kept)])
        others = others if f.charts or others else last.rivals
    return Uncertainty(tuple(names), (matrix + matrix.T) / 2, others) if names or others else None


def _of_joints(measured: MeasuredSet, declared: PowerModel) -> Diagnosis:
    """Diagnosis from the joints' currents or torques alone: friction, rotor inertia and drive constants.

    Raises:
        BadInput: the set has neither, or its torques clearly have another sign or unit.
    """
    side = joint_side(measured, declared)
    if side is None:
        raise BadInput(
            f"{measured.path}: no readings of power, energy, currents or torques; a diagnosis is not possible"
        )
    if wrong := wrong_units(side):
        raise BadInput(f"{measured.path}: {wrong}")
    found = pushes(side, measured)
    kept, enough = free_runs(measured, found)
    if found and enough:
        side = joint_side(kept, declared) or side
    effects, said = friction_findings(side) if enough else ([], [])
    model = declared
    for x in effects:
        model = model.replaced(effect_class(x.name)(**x.parameters))
    records = side_records(side, None)
    nothing = {"train": None, "holdout": None}
    document: dict[str, Any] = {
        "verdict": "insufficient",
        "headline": joints_headline([x.name for x in effects], side.unit),
        **_entries(measured, model, effects, records),
        "alternatives": [],
        "nuisance": ["link_inertia"],
        "explained_share": None,
        "links_share": None,
        "usable": False,
        "residual_goes_with": [],
        "remainder": [],
        "error": {"before": nothing, "after": nothing, "noise_floor": None},
        "noise_floor": None,
        "split": {"train": [r.file for r in kept.runs], "holdout": []},
        "remarks": [
            *measured.remarks, *push_words(found, enough), *side_remarks(side, records), *said,
            "No meter: the model's other effects are as declared or borrowed, not measured.",
        ],
        "next_step": "Next: record the power (a meter's file, or supply voltage and current) beside such motions.",
    }  # fmt: skip
    return Diagnosis(measured, declared, model, tuple(effects), Document(document), side)
