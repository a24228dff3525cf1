"""Text of a diagnosis: the headline, the next step, and the summary."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from energy_opt.diagnosis.verdict.inference import NOISE

SHARE = 0.01  # least explained share that the headline states
MUCH = 0.1  # least share of deviating links beside effects that calls for a check of links and payload
UNRECORDED = "no signal that was recorded"  # the rest depends on it where it depends on none of the log
WARMS = (
    "The model changes as the arm warms. Under model.toml, plans take the arm as cold as at the set's first sample; "
    "model_warm.toml describes an arm that has worked for long."
)
PLAIN = {
    "coulomb_friction": "dry friction",
    "viscous_friction": "viscous friction",
    "copper_loss": "copper loss",
    "friction_curve": "friction",
    "link_inertia": "links that differ from the URDF",
}


def plain(name: str) -> str:
    """Readable name of an effect."""
    return PLAIN.get(name, name.replace("_", " "))


def listed(names: Sequence[str]) -> str:
    """Join names as "a, b and c"."""
    words = [plain(name) for name in names]
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]


def headline(document: dict[str, Any], idle: Sequence[str] = ()) -> str:
    """One or two sentences that summarise the diagnosis; `idle`: joints that hardly moved, while others did."""
    names = [row["name"] for row in document["effects"]]
    error = document["error"]
    part = "holdout" if error["after"]["holdout"] else "train"
    before, after = error["before"][part], error["after"][part]
    verdict, of = document["verdict"], "held out" if part == "holdout" else "on the runs fitted"
    imitated = verdict == "unexplained" and after["power_rmse"] < before["power_rmse"]
    held = (
        f"{of} {before['power_rmse']:.1f} → {after['power_rmse']:.1f} W, "
        f"energy {before['energy_percent']:.1f} → {after['energy_percent']:.1f} %"
    )
    if not verdict:
        found = [name for name in document["model_effects"] if name not in document["declared_effects"]]
        said = f"Stopped before a verdict was reached: no cause is claimed; {held}."
        return said + (f" Likeliest so far: {listed(found)}." if found else "")
    apart = [listed(a) if a else "nothing" for a in document["alternatives"]] if verdict == "ambiguous" else []
    one = bool(apart) or (len(names) == 1 and names != ["link_inertia"])
    total, links = document["explained_share"], document["links_share"]
    share = f"{'explains' if one else 'explain'} {100 * (total - links):.1f} % of the residual above noise"
    if links >= SHARE:
        share += f", deviating links another {100 * links:.1f} %"
    if total < SHARE:
        share = f"{'lowers' if one else 'lower'} an error that was near the noise before"
    beside = f" (beside {listed(document['fitted'])}, fitted)" if names and document["fitted"] else ""
    if apart:
        said = f"The data cannot tell these causes apart: {'; '.join(apart)}. The first{beside} {share}; {held}."
    elif names == ["link_inertia"]:
        said = f"The links differ from the URDF: their deviations {share}; {held}."
    elif names:
        said = f"{listed(names).capitalize()}{beside} {share}; {held}."
    elif verdict == "nothing_missing":
        said = f"Nothing is missing: the error of the declared model is no larger than the noise; {held}."
    elif imitated:
        said = f"No cause can be named; {of} {before['power_rmse']:.1f} W, energy {before['energy_percent']:.1f} %."
    elif verdict == "insufficient" and _poses_agree(document):
        said = f"The poses agree with the model; no motion was recorded, so losses in motion are not tested; {held}."
    else:
        said = f"No cause can be named; {held}."
    said += f" These joints hardly moved, so their losses are not tested: {', '.join(idle)}." if idle else ""
    said += _left(document, before if imitated else after)
    if imitated:
        said += (
            f" model.toml predicts better ({after['power_rmse']:.1f} W, energy {after['energy_percent']:.1f} %), by "
            "effects that imitate the cause and are not stated as causes."
        )
    return said


def _poses_agree(document: dict[str, Any]) -> bool:
    """True if no motion was recorded, and the error at rest is no larger than the noise."""
    ratio = document["error"]["beside_noise"]["rest"]["ratio"]  # None if no reading is at rest
    return document["foreseen"]["motions"] == 0 and ratio is not None and ratio < NOISE


def _left(document: dict[str, Any], errors: dict[str, Any]) -> str:
    """What is left above the noise, and the signal that it goes with; `errors` are those of the claimed model."""
    beside = document["error"].get("beside_noise", {})
    if document["remainder"]:
        first, where = document["remainder"][0], ""
        rest = max(errors["power_rmse"] ** 2 - document["noise_floor"] ** 2, 0.0) ** 0.5
        if rest < first["watts"] and first["signal"] == UNRECORDED:
            return f"{_above(beside)}; it goes with {UNRECORDED}."
        if rest < first["watts"]:  # of the runs fitted, or of all
            rest, where = first["watts"], " in the runs fitted"
        share = "; they" if first["signal"] == UNRECORDED else f", of which {first['watts']:.1f} W"
        return f" {rest:.1f} W are left above the noise{where}{share} go with {_source(first)}."
    return f"{_above(beside)}." if not document["effects"] and "fitted" in beside else ""


def _above(errors: dict[str, Any]) -> str:
    """The error that is farthest above the noise, and where it is; `errors` are those `beside_noise`."""
    where = {"motion": "In motion", "rest": "At rest", "fitted": "In the runs fitted"}
    at = max(errors, key=lambda key: errors[key]["ratio"] or 0.0)
    row = errors[at]
    return f" {where[at]}, the error of a reading is {row['power_rmse']:.2g} W, {row['ratio']:.2g} times the noise"


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
            after = document["error"]["after"]
            level = (after["holdout"] or after["train"])["energy_percent"] <= document["tolerance"]
            unit = "" if level else "the power's unit and "
            return f"Next: check {unit}what else the meter measures: no recorded signal explains the rest."
        if "change" in first:
            return f"Next: look for a consumer, such as a fan, that caused {_source(first)}."
        said = f"Next: look for a cause that depends on {_source(first)}"
        bent = next(
            (row["joint"] for row in document["remainder"] if row["signal"] == "position" and row["joint"]), None
        )
        if bent is None:
            return f"{said}."
        such = ", such as a spring, a balancer or a hose" if first["signal"] == "position" else ""
        return f"{said}{such}; check zero, sign, order and scale of the data of {bent}."
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
