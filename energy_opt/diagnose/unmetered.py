"""A set without a meter: what the joints' currents or torques alone say, and a model that has it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from energy_opt.diagnose.joints import JointSide, joint_side
from energy_opt.diagnose.pushed import free_runs, push_words, pushes
from energy_opt.diagnose.sides import LAWS, STUDENT, WIDER, shows_friction, side_remarks, side_rows
from energy_opt.diagnose.words import listed
from energy_opt.effects import Payload, effect_class
from energy_opt.errors import BadInput
from energy_opt.measured import MeasuredSet
from energy_opt.power import PowerModel

SURE = 4.0  # standard deviations of some joint's number from 0, from which the law is claimed
UNITS = {"coulomb_friction": "N m", "viscous_friction": "N m s/rad"}


@dataclass(frozen=True)
class JointDiagnosis:
    """What a set without a meter says: the model with the friction found, and the content of diagnosis.json."""

    measured: MeasuredSet
    side: JointSide
    model: PowerModel
    document: dict[str, Any]


def diagnose_joints(measured: MeasuredSet, declared: PowerModel) -> JointDiagnosis:
    """Friction, rotor inertia and drive constants from currents or torques alone.

    Raises:
        BadInput: the set has neither.
    """
    declared.check(measured.robot.n)
    if measured.payload is not None and declared.get(Payload.name) is None:
        declared = declared.replaced(Payload(mass=measured.payload.mass, com=measured.payload.com))
    side = joint_side(measured, declared)
    if side is None:
        raise BadInput(f"{measured.path}: no readings of power, energy, currents or torques; nothing can be said")
    found = pushes(side, measured)
    kept, enough = free_runs(measured, found)
    if found and enough:
        side = joint_side(kept, declared) or side
    limits, joints = measured.robot.limits, measured.robot.joints
    effects = effect_rows(side) if enough and shows_friction(side, limits) else []
    model = declared
    for row in effects:
        name, value = row["name"], row["parameters"]
        model = model.replaced(effect_class(name)(**value))
    rows = side_rows(side, joints, limits, None)
    nothing = {"train": None, "holdout": None}
    what = "currents" if side.unit == "A" else "torques"
    names = [row["name"] for row in effects]
    verb = "shows" if len(names) == 1 else "show"
    said = f"{listed(names).capitalize()} {verb} in the joints' {what}" if names else f"The {what} show no friction"
    document: dict[str, Any] = {
        "verdict": "insufficient",
        "headline": f"{said}; without a meter nothing is said of standby, heat and supply.",
        "effects": effects,
        "alternatives": [],
        "nuisance": ["link_inertia"],
        "explained_share": None,
        "usable": False,
        "residual_goes_with": [],
        "remainder": [],
        "error": {"before": nothing, "after": nothing, "noise_floor": None},
        "noise_floor": None,
        "split": {"train": [r.file for r in kept.runs], "holdout": []},
        "model_effects": [e.name for e in model.effects],
        "joint_side": rows,
        "next_motion": None,
        "remarks": [
            *measured.remarks, *push_words(found, enough), *side_remarks(side, limits, rows),
            "No meter: the model's other effects are as declared or borrowed, not measured.",
        ],
        "robot": measured.robot.name,
        "joints": list(joints),
        "next_step": "Next: record the power (a meter's file, or supply voltage and current) beside such motions.",
    }  # fmt: skip
    return JointDiagnosis(measured, side, model, document)


def effect_rows(side: JointSide) -> list[dict[str, Any]]:
    """Dry and viscous friction where some joint surely has it; joints of which nothing is known are like the others."""
    from scipy.stats import chi2

    known = np.flatnonzero(side.known)
    left = float(np.nansum(side.left[:, known] ** 2))
    out = []
    for k, name in enumerate(LAWS[:2]):
        values, spread = side.values[k][known], WIDER**2 * side.covariance[k][np.ix_(known, known)]
        deviation = np.sqrt(np.diag(spread))
        if not (values > SURE * deviation).any():
            continue
        share = float(np.median(np.maximum(values, 0.0)))
        full, wide = np.full(len(side.usual), share), np.full(len(side.usual), share)
        full[known], wide[known] = np.maximum(values, 0.0), STUDENT * deviation
        way = np.sign(side.rows.v[:, known]) if k == 0 else side.rows.v[:, known]
        own = float(np.nansum((way * full[known]) ** 2))
        ci = np.column_stack([np.maximum(full - wide, 0.0), full + wide])
        parameter = effect_class(name).parameters[0].name
        statistic = float(values @ np.linalg.solve(spread, values))
        out.append(
            {
                "name": name,
                "parameters": {parameter: full.tolist()},
                "ci95": {parameter: ci.tolist()},
                "units": {parameter: UNITS[name]},
                "share_of_residual": own / (own + left),
                "p_value": float(chi2.sf(statistic, len(known))),
                "refit": False,
            }
        )
    return sorted(out, key=lambda row: -row["share_of_residual"])
