"""Text of a diagnosis: the headline, remarks, and the next step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from energy_opt.diagnosis.data.clusters import SLOW
from energy_opt.diagnosis.data.predict import friction_torque, predict
from energy_opt.diagnosis.evidence.residual import other_unit, wave_words
from energy_opt.diagnosis.fit.posterior import Fit
from energy_opt.diagnosis.verdict.inference import NOISE, Inference
from energy_opt.effects import effect_class
from energy_opt.measured import MeasuredSet, coarse
from energy_opt.power import PowerModel
from energy_opt.robot.limits import unit_of

UNKNOWN = 0.4  # posterior over prior standard deviation above which the data hardly determined a number
WANDERS = 0.3  # share of the noise by which runs' levels must differ to be mentioned
SHARE = 0.01  # least explained share that the headline states
MUCH = 0.1  # least share of deviating links beside effects that calls for a check of links and payload
UNRECORDED = "no signal that was recorded"  # the rest depends on it where it depends on none of the log
PLAIN = {
    "coulomb_friction": "dry friction",
    "viscous_friction": "viscous friction",
    "copper_loss": "copper loss",
    "friction_curve": "friction",
}


def plain(name: str) -> str:
    """Readable name of an effect."""
    return PLAIN.get(name, name.replace("_", " "))


def listed(names: Sequence[str]) -> str:
    """Join names as "a, b and c"."""
    words = [plain(name) for name in names]
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]


def headline(document: dict[str, Any]) -> str:
    """One or two sentences that summarise the diagnosis."""
    names = [row["name"] for row in document["effects"]]
    error = document["error"]
    part = "holdout" if error["after"]["holdout"] else "train"
    before, after = error["before"][part], error["after"][part]
    verdict = document["verdict"]
    held = (
        f"{'held out' if part == 'holdout' else 'on the runs fitted'} "
        f"{before['power_rmse']:.1f} → {after['power_rmse']:.1f} W, "
        f"energy {before['energy_percent']:.1f} → {after['energy_percent']:.1f} %"
    )
    if not verdict:
        found = [name for name in document["model_effects"] if name not in document["declared_effects"]]
        said = f"Stopped before a verdict was reached: no cause is claimed; {held}."
        return said + (f" Likeliest so far: {listed(found)}." if found else "")
    one = len(names) == 1 and names != ["link_inertia"]
    total, links = document["explained_share"], document["links_share"]
    share = f"{'explains' if one else 'explain'} {100 * (total - links):.1f} % of the residual above noise"
    if links >= SHARE:
        share += f", deviating links another {100 * links:.1f} %"
    if total < SHARE:
        share = f"{'lowers' if one else 'lower'} an error that was near the noise before"
    if names == ["link_inertia"]:
        said = f"The links differ from the URDF: their deviations {share}; {held}."
    elif names:
        beside = f" (beside {listed(document['fitted'])}, fitted)" if document["fitted"] else ""
        said = f"{listed(names).capitalize()}{beside} {share}; {held}."
    elif verdict == "nothing_missing":
        said = f"Nothing is missing: the error of the declared model is no larger than the noise; {held}."
    else:
        said = f"No cause can be named; {held}."
    if verdict == "ambiguous" and document["alternatives"]:
        said += " Equally well: " + "; ".join(listed(a) if a else "nothing" for a in document["alternatives"][1:]) + "."
    if document["remainder"]:
        first = document["remainder"][0]
        rest = max(after["power_rmse"] ** 2 - document["noise_floor"] ** 2, first["watts"] ** 2) ** 0.5
        share = "; they" if first["signal"] == UNRECORDED else f", of which {first['watts']:.1f} W"
        said += f" {rest:.1f} W are left above the noise{share} go with {_source(first)}."
    return said


def _source(row: dict[str, Any]) -> str:
    """The signal that a part of the residual goes with, and its joint; or the step of its level."""
    if "change" in row:
        return f"a step of {row['change']:+.3g} W at {row['at']:.0f} s"
    return row["signal"] + (f" of {row['joint']}" if row["joint"] else "")


def joints_headline(names: Sequence[str], unit: str) -> str:
    """Headline of a set without a meter; `names`: effects found in the readings, whose unit is "A" or "N m"."""
    what = "currents" if unit == "A" else "torques"
    verb = "shows" if len(names) == 1 else "show"
    said = f"{listed(names).capitalize()} {verb} in the joints' {what}" if names else f"The {what} show no friction"
    return f"{said}; without a meter, standby, heat and supply cannot be diagnosed."


def remarks(found: Inference, measured: MeasuredSet, declared: PowerModel, links: float = 0.0) -> list[str]:
    """Remarks on the verdict, one sentence each; `links`: share of the residual that links explain beside effects."""
    out = list(measured.remarks)
    joints = measured.robot.joints
    if not declared.is_of(measured.robot.name):
        out.append(f"The declared model was written for {declared.robot!r}, the set says {measured.robot.name!r}.")
    if not found.follows:
        out.append(
            "The measured power does not depend on the motion: shifted in time, it fits equally well. "
            "Are power and motion columns of the same recording, in the same order?"
        )
    samples = found.root.world.samples
    if likely := other_unit(samples, predict(declared, samples)):
        unit, ratio = likely
        said = f"The power is {ratio:.2g} times that of the declared model: is it in {unit}?"
        out.append(f"{said} Give its unit in log.toml.")
    if len(found.idle) == len(joints):
        out.append(
            f"No joint reaches {100 * SLOW:.0f} % of its velocity limit: so slow motions show neither friction nor "
            "rotor inertia, regeneration or the meter's lag."
        )
    elif found.idle:
        names = ", ".join(joints[j] for j in found.idle)
        out.append(f"These joints never move: {names}. The set cannot determine their losses in motion.")
    if measured.payload is not None:
        mass, com = measured.payload.mass, ", ".join(f"{x:.3g}" for x in measured.payload.com)
        out.append(f"The recording states a payload of {mass:.3g} kg at ({com}) m: the declared model is used with it.")
    if any(coarse(run) for run in measured.runs):
        out.append("Rows of the joints are too far apart to show accelerations: log them at 10 Hz or more.")
    if not measured.clock:
        out.append("The log does not state every run's start; runs are taken to follow one another without a pause.")
    after = found.after
    if found.verdict and after.ratio >= NOISE:
        out.append(
            f"The remaining residual is {after.motion:.3g} W rms in motion and {after.rest:.3g} W at rest; noise alone "
            f"would leave {after.noise_motion:.3g} and {after.noise_rest:.3g} W."
        )
    if found.links or links >= MUCH:
        out.append(_links(found.accepted, joints))
    model_fit = found.accepted
    white = model_fit.world.whiten.noise.white
    level, apart = float(np.mean(model_fit.levels)), float(np.std(model_fit.levels))
    claimed, standby = found.claims or found.links, found.model.get("standby")
    if claimed and standby is not None and "standby" not in model_fit.names and abs(level) > WANDERS * white:
        out.append(
            f"The model's standby differs by {level:+.2g} W from the declared one, so that the mean power is the "
            "measured one."
        )
    if found.verdict == "nothing_missing" and abs(level) > WANDERS * found.still.white:
        out.append(
            f"The readings are {abs(level):.2g} W {'above' if level > 0 else 'below'} the declared model throughout. "
            "A drift of the meter, another standby and a loss of the supply would look the same here."
        )
    out += _borrowed(model_fit, joints)
    if apart > WANDERS * white and len(model_fit.levels) > 2:
        out.append(
            f"The level of power differs from run to run by {apart:.2g} W (standard deviation), as if the meter or the "
            "standby drifts. The fit includes this; it is not stated as a cause."
        )
    out += wave_words(model_fit.world.samples)
    for f in found.rivals[1:]:
        more = [name for name in f.names if name not in f.world.given]
        out.append(f"This explains the data as well: {listed(more) if more else 'nothing is missing'}.")
    return out


def _links(f: Fit, joints: Sequence[str]) -> str:
    """Sentence on the change of joint torques by link deviations."""
    s = f.world.samples
    off = np.sqrt(np.mean((f.world.links.torques @ f.amounts) ** 2, axis=0))
    whole = np.sqrt(np.mean(f.prediction.tau**2, axis=0))
    worst = np.argsort(-off)[:3]
    each = ", ".join(
        f"{joints[j]} {off[j]:.2g} {unit_of('effort', s.body.slides[j])} ({100 * off[j] / max(whole[j], 1e-9):.0f} %)"
        for j in worst
    )
    links = ", ".join(joints[j] for j in np.argsort(-np.abs(f.world.links.effect(f.amounts, s).values["mass"]))[:2])
    return f"The torque of the URDF's links is off by (rms): {each}; most of it by the links behind {links}."


def _borrowed(f: Fit, joints: Sequence[str]) -> list[str]:
    """Remarks on joints whose numbers the data hardly determined: they are taken from the others."""
    out, after = [], np.sqrt(np.diag(f.covariance))
    for c, z, place in zip(f.charts, f.numbers, f.places, strict=True):
        share = after[place] / np.sqrt(np.diag(np.linalg.inv(c.precision)))
        if (
            c.term.declared
            or c.term.name in f.world.scale.measured
            or len(z) % len(joints)
            or not any(p.per_joint for p in c.term.kind.parameters)
        ):
            continue
        of = np.arange(len(z)) * len(joints) // len(z)
        worst = [j for j in range(len(joints)) if np.median(share[of == j]) > UNKNOWN]
        if worst and len(worst) < len(joints):
            names = ", ".join(joints[j] for j in worst)
            what = plain(c.term.name).capitalize()
            out.append(
                f"{what} of {names}: the data hardly determine it; it is assumed to be like that of other joints."
            )
    return out


def speeds_seen(found: Inference, joints: Sequence[str]) -> list[str]:
    """One sentence per joint on the sum of its friction laws at its usual speed.

    The data determine this sum even if the laws cannot be separated, so it is stated if several sets explain the data.
    """
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
        if not any(sums):  # they depend on the load alone
            continue
        speed, unit = (unit_of(kind, s.body.slides[j]) for kind in ("velocity", "effort"))
        span = f"{min(sums):.2g} to {max(sums):.2g} {unit}"
        out.append(f"Friction of {joint} at {usual:.2g} {speed} is {span} under all these alternatives.")
    return out


def next_step(document: dict[str, Any], follows: bool = True) -> str:
    """The recommended next step; `follows`: False if the power does not depend on the motion."""
    if not document["verdict"]:
        return "Next: run the diagnosis again to its end."
    if not follows:
        return "Next: check that power and motion are of the same recording, and diagnose the set again."
    if document["usable"]:
        links = document["links_share"]
        check = f"; check payload and links: they explain {100 * links:.0f} % of the residual" if links >= MUCH else ""
        return f"Next: good enough to plan with (optimize --model model.toml){check}."
    if document["verdict"] in ("ambiguous", "insufficient"):
        if document["next_motion"] is None:
            return "Next: record more motions, every joint slowly and fast, and diagnose both sets together."
        return "Next: record the proposed motion and diagnose both sets together."
    if document["remainder"]:
        first = document["remainder"][0]
        if first["signal"] == UNRECORDED:
            said = "check the power's unit and what else the meter measures: no recorded signal explains the rest"
            return f"Next: {said}."
        if "change" in first:
            return f"Next: look for a consumer, such as a fan, that caused {_source(first)}."
        return f"Next: look for a cause that depends on {_source(first)}."
    return "Next: record more runs in other parts of the workspace, so that the held-out error is known better."


def summary(d: dict[str, Any]) -> str:
    """The document as some lines of text, for stdout."""
    lines = [d["headline"], f"verdict: {d['verdict'] or 'none, interrupted'}"]
    for row in d["effects"]:
        refit = " (declared value fitted anew)" if row["refit"] else ""
        odds = f", odds e^{row['log_odds']:.0f}" if row["log_odds"] is not None else ""
        percent = 100 * row["share_of_residual"]
        share = f"{percent:.0f} %" if percent >= 1 else "less than 1 %"
        lines.append(f"  {row['name']}{refit}: {share} of the explained part is lost without it{odds}")
        lines += [f"    {line}" for line in _values(row, d["joints"])]
    if d["joint_side"]:
        lines += ["joints' own readings:", *(f"  {line}" for line in side_words(d["joint_side"]))]
    if d["alternatives"]:
        lines.append("  fit equally well: " + " | ".join(" + ".join(names) or "nothing" for names in d["alternatives"]))
    if d["nuisance"]:
        lines.append("  included in the fit, not stated as a cause: " + ", ".join(d["nuisance"]))
    for row in d["remainder"][:3]:
        lines.append(f"  {row['watts']:.2f} W of the rest go with {_source(row)}")
    for part in ("train", "holdout"):
        before, after = d["error"]["before"][part], d["error"]["after"][part]
        if before is not None and after is not None:
            lines.append(
                f"{part}: power RMSE {before['power_rmse']:.2f} -> {after['power_rmse']:.2f} W, energy error "
                f"{before['energy_percent']:.2f} -> {after['energy_percent']:.2f} %"
            )
    if d["noise_floor"] is not None:
        lines.append(f"noise: {d['noise_floor']:.2f} W; {_foreseen(d)}")
    lines.append(f"model.toml holds: {', '.join(d['model_effects'])}")
    lines += [f"note: {remark}" for remark in d["remarks"]]
    return "\n".join([*lines, d["next_step"]])


def _foreseen(d: dict[str, Any]) -> str:
    percent = d["foreseen"]["difference_percent"]
    if percent is None:
        return "no motion, so differences of energy are unknown"
    if percent > 100:
        return "differences of energy between motions are not predicted: the error is larger than they are"
    usable = "good enough to plan with" if d["usable"] else "not shown to be good enough to plan with"
    usable += f", as {d['foreseen']['reason']}" if d["foreseen"]["reason"] else ""
    within = f"{percent:.0f} %" if percent >= 0.5 else "the meter's noise"
    return f"differences of energy between motions are predicted within {within}: {usable}"


def side_words(records: Sequence[dict[str, Any]]) -> list[str]:
    """One line per joint, for stdout."""
    out = []
    for row in records:
        if row["scale"] is None:
            unit = row["units"]["friction"]
            out.append(f"{row['joint']}: its readings do not depend on its torque; no value in {unit} is possible")
            continue
        said = f"{row['joint']}: "
        torque = f"torque {row['scale']:.3g} times the reading"
        said += torque if row["unit"] == "1" else f"Kt {row['scale']:.3g} {row['unit']}"
        if row["own"] is not None:
            speed, unit = row["units"]["speed"], row["units"]["friction"]
            said += f", friction at {row['speed']:.2g} {speed} {_span(row['own'], unit)} by its own readings"
            if row["power"] is not None:
                said += f", {_span(row['power'], unit)} by the power alone, {_span(row['together'], unit)} by both"
        else:
            said += ", hardly moves"
        out.append(said)
    return out


def _span(word: dict[str, Any], unit: str) -> str:
    low, high = word["ci95"]
    return f"{word['friction']:.3g} ± {(high - low) / 2:.2g} {unit}"


def _values(row: dict[str, Any], joints: list[str]) -> list[str]:
    """An effect's values with joints' names and units, one line per parameter."""
    out = []
    for name, value in row["parameters"].items():
        if isinstance(value, str):
            out.append(f"{name} = {value}")
            continue
        unit, interval = row["units"][name], row["ci95"][name]
        if not isinstance(value, list):
            out.append(f"{name} = {value:.4g} [{interval[0]:.4g}, {interval[1]:.4g}] {unit}")
        elif len(value) == len(joints):
            parts = [f"{j} {x:.4g} [{a:.4g}, {b:.4g}]" for j, x, (a, b) in zip(joints, value, interval, strict=True)]
            each = isinstance(unit, list)  # a unit for each joint
            parts = [f"{part} {own}" for part, own in zip(parts, unit, strict=True)] if each else parts
            out.append(f"{name}{'' if each else f' in {unit}'}: " + ", ".join(parts))
        else:
            out.append(f"{name} = " + ", ".join(f"{x:.4g}" for x in value) + f" {unit}")
    return out
