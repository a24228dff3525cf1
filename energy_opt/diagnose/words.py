"""A diagnosis in words: the headline, remarks, and what to do next."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from energy_opt.diagnose.fit import Fit
from energy_opt.diagnose.friction import friction_torque
from energy_opt.diagnose.trace import SLOW, Trace
from energy_opt.effects import effect_class
from energy_opt.measured import MeasuredSet, coarse
from energy_opt.power import PowerModel

UNKNOWN = 0.4  # of what was known before, beyond which the data hardly narrowed a number
WANDERS = 0.3  # of the noise, by which runs' levels must differ to be mentioned
PLAIN = {
    "coulomb_friction": "dry friction",
    "viscous_friction": "viscous friction",
    "copper_loss": "copper loss",
    "friction_curve": "friction",
}


def plain(name: str) -> str:
    """An effect's name as a reader says it."""
    return PLAIN.get(name, name.replace("_", " "))


def listed(names: Sequence[str]) -> str:
    """a, b and c."""
    words = [plain(name) for name in names]
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]


def news(f: Fit) -> list[str]:
    """The effects of a fit that are news: not those that were free from the start."""
    return [name for name in f.names if name not in f.world.given]


def headline(document: dict[str, Any]) -> str:
    """One sentence or two for a person."""
    names = [row["name"] for row in document["effects"]]
    error = document["error"]
    before, after = (error[when]["holdout"] or error[when]["train"] for when in ("before", "after"))
    share, verdict = document["explained_share"], document["verdict"]
    held = (
        f"held out {before['power_rmse']:.1f} → {after['power_rmse']:.1f} W, "
        f"energy {before['energy_percent']:.1f} → {after['energy_percent']:.1f} %"
    )
    if not verdict:
        found = [name for name in document["model_effects"] if name not in document["declared_effects"]]
        said = f"Stopped before there was a verdict: no cause is claimed; {held}."
        return said + (f" Likeliest so far: {listed(found)}." if found else "")
    if names:
        verb = "explains" if len(names) == 1 else "explain"
        beside = f" (beside {listed(document['fitted'])}, fitted)" if document["fitted"] else ""
        said = f"{listed(names).capitalize()}{beside} {verb} {100 * share:.1f} % of what was above the noise; {held}."
    elif verdict == "nothing_missing":
        said = f"Nothing is missing: the declared model is as good as the noise allows; {held}."
    else:
        part = f"{100 * max(share, 0):.1f} %"
        said = f"No cause can be named; the calibrated model takes {part} of what was above the noise; {held}."
    if verdict == "ambiguous" and document["alternatives"]:
        said += " Equally well: " + "; ".join(listed(a) if a else "nothing" for a in document["alternatives"][1:]) + "."
    if document["remainder"]:
        first = document["remainder"][0]
        where = f" of {first['joint']}" if first["joint"] else ""
        said += f" What remains ({first['watts']:.1f} W) goes with {first['signal']}{where}."
    return said


def remarks(found: Trace, measured: MeasuredSet, declared: PowerModel, model_fit: Fit) -> list[str]:
    """What the reader of the verdict should know, one sentence each."""
    out = list(measured.remarks)
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
    if any(coarse(run) for run in measured.runs):
        out.append("Rows of the joints are too far apart to show accelerations: log them at 10 Hz or more.")
    if not measured.clock:
        out.append("The log does not state every run's start; runs are taken to follow one another without a pause.")
    if found.structured and np.isfinite(found.left):
        out.append(f"What is left varies {found.left:.3g} times as much in motion as the meter's noise at standstill.")
    out += _borrowed(model_fit, joints)
    apart = float(np.std(model_fit.levels))
    if apart > WANDERS * model_fit.world.whiten.noise.white and len(model_fit.levels) > 2:
        out.append(
            f"The level differs from run to run by {apart:.2g} W (standard deviation), as where a meter or the standby "
            "drifts: allowed for, not called a cause."
        )
    for f in found.rivals[1:]:
        more = news(f)
        out.append(f"Fits as well: {listed(more) if more else 'nothing missing'}.")
    return out


def _borrowed(f: Fit, joints: Sequence[str]) -> list[str]:
    """Joints whose numbers the data hardly narrowed: they are taken from the others."""
    out, at = [], 0
    after = np.sqrt(np.diag(f.covariance))
    for c, z in zip(f.charts, f.numbers, strict=True):
        before = np.sqrt(np.diag(np.linalg.inv(c.precision)))
        share = after[at : at + len(z)] / before
        at += len(z)
        if (
            c.term.declared
            or c.term.name in f.world.scale.told
            or len(z) % len(joints)
            or not any(p.per_joint for p in c.term.kind.parameters)
        ):
            continue
        of = np.arange(len(z)) * len(joints) // len(z)
        worst = [j for j in range(len(joints)) if np.median(share[of == j]) > UNKNOWN]
        if worst and len(worst) < len(joints):
            names = ", ".join(joints[j] for j in worst)
            what = plain(c.term.name).capitalize()
            out.append(f"{what} of {names} is hardly in the data: taken to be like the others'.")
    return out


def speeds_seen(found: Trace, joints: Sequence[str]) -> list[str]:
    """What the data do fix where laws of friction cannot be told apart: their sum at the usual speed."""
    f = found.accepted
    names = set().union(*(set(r.names) for r in found.rivals))
    if (
        not any(effect_class(name).stage == "torque" and effect_class(name).dissipates for name in names)
        or len(found.rivals) < 2
    ):
        return []
    s, out = f.world.samples, []
    laws = [friction_torque(r.model, s.n) for r in found.rivals]
    for j, joint in enumerate(joints):
        v = np.abs(s.v[:, j])
        v = v[v > 0.03]
        if len(v) < 20:
            continue
        usual = float(np.median(v))
        sums = [float(law(np.array([usual]), j)[0]) for law in laws]
        out.append(
            f"Friction of {joint} at {usual:.2g} rad/s is {min(sums):.2g} to {max(sums):.2g} N m under all of them."
        )
    return out


def next_step(document: dict[str, Any]) -> str:
    """What to do with it."""
    if not document["verdict"]:
        return "Next: let it run to its end."
    if document["usable"]:
        return "Next: good enough to plan with (optimize --model model.toml)."
    if document["verdict"] in ("ambiguous", "insufficient"):
        if document["next_motion"] is None:
            return "Next: record more motions, every joint slowly and fast, and diagnose both sets together."
        return "Next: record the proposed motion and diagnose both sets together."
    if document["remainder"]:
        first = document["remainder"][0]
        return f"Next: look for what goes with {first['signal']}{' of ' + first['joint'] if first['joint'] else ''}."
    return "Next: more runs, in other parts of the workspace, would narrow the held-out error."
