"""A diagnosis: a measured set and a declared model in; verdict, effects, calibrated model and errors out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from energy_opt.diagnose.claims import RATE, family_wise, left_out_gain
from energy_opt.diagnose.errors import errors
from energy_opt.diagnose.fit import Fit
from energy_opt.diagnose.goes_with import goes_with
from energy_opt.diagnose.samples import Samples, take_samples
from energy_opt.diagnose.split import split
from energy_opt.diagnose.trace import SLOW, Trace, excited, trace
from energy_opt.effects import Payload
from energy_opt.errors import BadInput
from energy_opt.measured import MeasuredSet, Smoothing
from energy_opt.power import PowerModel

STUDENT = 1.96
WIDER = 1.25  # of intervals, for errors of smoothing and clocks that repeat; calibrated on virtual sets


@dataclass(frozen=True)
class Diagnosis:
    """A diagnosis with what it was made from.

    Attributes:
        samples, train, holdout: all runs, and the indices of those fitted and kept.
        declared, model: the model handed in, and the calibrated one.
        trace: what the search found. document: the content of diagnosis.json.
    """

    measured: MeasuredSet
    samples: Samples
    smoothing: Smoothing
    train: tuple[int, ...]
    holdout: tuple[int, ...]
    declared: PowerModel
    model: PowerModel
    trace: Trace
    document: dict[str, Any]


def diagnose(measured: MeasuredSet, declared: PowerModel, seed: int = 0) -> Diagnosis:
    """Find what the declared model lacks.

    Args:
        measured: the set.
        declared: the owner's model of the same robot; a payload that the recorder states is added where it has none.
        seed: of the split into training and holdout.

    Raises:
        BadInput: the model does not fit the robot, or the set is too small to say anything.
    """
    declared.check(measured.robot.n)
    if measured.payload is not None and declared.get(Payload.name) is None:
        declared = declared.replaced(Payload(mass=measured.payload.mass, com=measured.payload.com))
    samples, smoothing = take_samples(measured)
    if len(samples.power) < 50:
        raise BadInput(f"{measured.path}: {len(samples.power)} samples in all; a diagnosis needs at least 50")
    train, holdout = split(samples, seed)
    moving = excited(samples, measured.robot.limits)
    fitted = samples.part(train)
    found = trace(fitted, declared, moving)
    model = found.accepted.model
    document: dict[str, Any] = {
        "verdict": found.verdict,
        "effects": effect_rows(found),
        "alternatives": alternatives(found),
        "residual_goes_with": goes_with(found, measured.robot.joints),
        "error": {
            "before": {"train": errors(declared, samples, train), "holdout": errors(declared, samples, holdout)},
            "after": {"train": errors(model, samples, train), "holdout": errors(model, samples, holdout)},
            "noise_floor": samples.floor,
        },
        "split": {"train": [samples.files[r] for r in train], "holdout": [samples.files[r] for r in holdout]},
        "next_motion": None,
        "remarks": remarks(found, measured, declared),
        "evidence": evidence_rows(found),
        "candidates": candidate_rows(found),
        "false_positive_rate": RATE,
        "robot": measured.robot.name,
        "joints": list(measured.robot.joints),
    }
    return Diagnosis(measured, samples, smoothing, tuple(train), tuple(holdout), declared, model, found, document)


def covariance(f: Fit, inflation: float, noise: float) -> np.ndarray:
    """Covariance of a fit's free numbers (K, K), with the residual's own level where that exceeds the meter's noise."""
    size = np.maximum(np.linalg.norm(f.jacobian, axis=0), 1e-12)
    scaled = f.jacobian / size
    level = max(1.0, f.loss / max(len(f.residual) - f.count, 1)) * inflation * noise**2
    inverse = np.linalg.inv(scaled.T @ scaled + 1e-9 * np.eye(len(size)))
    return inverse * level / np.outer(size, size)


def effect_rows(found: Trace) -> list[dict[str, Any]]:
    """The accepted effects, largest first, with values, intervals, share of the residual explained, and evidence."""
    f, samples = found.accepted, found.search.samples
    if not f.terms:
        return []
    spread = covariance(f, found.search.inflation, samples.noise)
    explained = max(found.root.loss - f.loss, 1e-9)
    rows, at = [], 0
    for k, (term, chart, z) in enumerate(zip(f.terms, f.charts, f.numbers, strict=True)):
        part = slice(at, at + len(z))
        at += len(z)
        slope = chart.slope(z)
        deviation = np.sqrt(np.maximum(np.einsum("pi,ij,pj->p", slope, spread[part, part], slope), 0.0))
        effect = f.model.get(term.name)
        assert effect is not None
        values = effect.full(samples.n)
        less = found.search.without(f, k)
        left_out = left_out_gain(found.search, found.rivals[0], k)
        rows.append(
            {
                "name": term.name,
                **_parameters(term.kind, term.mode, values, deviation, samples.n),
                "share_of_residual": float(np.clip((less.loss - f.loss) / explained, 0.0, 1.0)),
                "p_value": family_wise(found.search, found.rivals[0], k),
                "refit": term.declared,
                "left_out_gain": float(left_out.sum()),
                "runs_improved": [int((left_out > 0).sum()), len(left_out)],
            }
        )
        rows[-1]["parameters"].update(effect.choices)
    return sorted(rows, key=lambda row: -row["share_of_residual"])


def _parameters(kind: Any, mode: str, values: np.ndarray, deviation: np.ndarray, n: int) -> dict[str, Any]:
    """Values and 95 % intervals by parameter; one number where the fit shares it over the joints."""
    out: dict[str, Any] = {"parameters": {}, "ci95": {}}
    at = 0
    for p in kind.parameters:
        count = p.count(n)
        value, width = values[at : at + count], WIDER * STUDENT * deviation[at : at + count]
        low, high = np.maximum(value - width, p.lower), np.minimum(value + width, p.upper)
        at += count
        if count == 1 or (mode == "shared" and p.size == "joint"):
            out["parameters"][p.name] = float(value[0])
            out["ci95"][p.name] = [float(low[0]), float(high[0])]
        else:
            out["parameters"][p.name] = value.tolist()
            out["ci95"][p.name] = np.column_stack([low, high]).tolist()
    return out


def alternatives(found: Trace) -> list[list[str]]:
    """Sets of effects that fit equally well, the accepted one first; empty where there is only one."""
    sets = [list(f.names) for f in found.rivals]
    return sets if found.verdict == "ambiguous" or len(sets) > 1 else []


def evidence_rows(found: Trace, most: int = 15) -> list[dict[str, Any]]:
    """The hypotheses that were fitted, best first: what they add, their loss per sample and their score."""
    rows = []
    for f in found.search.ranked()[:most]:
        score = found.search.score(f)
        if np.isfinite(score):
            rows.append(
                {
                    "effects": list(f.names),
                    "structures": [f"{e.family} {e.setting:.3g}" for e in f.extras],
                    "numbers": f.count,
                    "loss_per_sample": f.loss / len(f.residual),
                    "score": score - found.search.score(found.root),
                }
            )
    return rows


def candidate_rows(found: Trace) -> list[dict[str, Any]]:
    """Every effect that might be added: its linearised gain less its price, alone and beside the accepted ones.

    Positive is worth more than it costs; the strongest alone come first. None where the effect is accepted already.
    """
    if not found.follows:
        return []
    alone: dict[str, float] = {}
    beside: dict[str, float] = {}
    for base, best in ((found.root, alone), (found.accepted, beside)):
        for value, candidate, _ in found.search.proposals(base):
            best.setdefault(candidate.term.name, value)
    rows = [{"name": name, "alone": value, "beside_accepted": beside.get(name)} for name, value in alone.items()]
    return sorted(rows, key=lambda row: -row["alone"])


def remarks(found: Trace, measured: MeasuredSet, declared: PowerModel) -> list[str]:
    """What the reader of the verdict should know, one sentence each."""
    out = []
    joints = measured.robot.joints
    if declared.robot and declared.robot != measured.robot.name:
        out.append(f"The declared model was written for {declared.robot!r}, the set says {measured.robot.name!r}.")
    if not found.follows:
        out.append(
            "The measured power does not follow the motion: shifted against each other they fit as well. "
            "Are power and motion columns of the same recording, in the same order?"
        )
    if len(found.idle) == len(joints):
        out.append(
            f"No joint reaches {100 * SLOW:.0f} % of its velocity limit: poses and crawling show neither friction nor "
            "rotor inertia, regeneration or the meter's lag."
        )
    elif found.idle:
        names = ", ".join(joints[j] for j in found.idle)
        out.append(f"Never moving: {names}; what these joints lose in motion cannot be known from this set.")
    if measured.payload is not None:
        mass, com = measured.payload.mass, ", ".join(f"{x:.3g}" for x in measured.payload.com)
        out.append(
            f"The recording states a payload of {mass:.3g} kg at ({com}) m, declared or not; it counts as declared."
        )
    if not measured.clock:
        out.append("The log does not state every run's start; runs are taken to follow one another without a pause.")
    if found.left.structured:
        out.append(
            f"What is left varies {found.left.ratio:.3g} times as much as noise, over blocks of a quarter second."
        )
    if found.verdict == "unexplained" and found.accepted.terms:
        out.append(
            "The effects named hold most of the residual; what is left beside them goes with the signals listed."
        )
    for f in found.rivals[1:]:
        out.append(f"Fits as well: {', '.join(f.names) or 'nothing missing'}.")
    return out
