"""The joints' own readings besides the power: priors for the fit, records for diagnosis.json, sets without a meter.

Friction is seen twice: by the joints' currents or torques, and by the power. The former gives priors for the fit of the
power; where the two disagree, a remark says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from energy_opt.diagnosis.data.predict import friction_torque
from energy_opt.diagnosis.fit.posterior import Fit, fit
from energy_opt.diagnosis.hypothesis.terms import ROTOR, USUAL, Chart, Measured, Scale, chart
from energy_opt.diagnosis.joint_side import STRANGE, TIMES, JointSide
from energy_opt.diagnosis.verdict.findings import STUDENT, Finding, unit_of_joints
from energy_opt.effects import TorqueEffect, effect_class

LAWS = ("coulomb_friction", "viscous_friction", "armature")  # in the order of `JointSide.values`
WIDER = 1.5  # factor on standard deviations of the readings, as real friction is more complex than the laws
APART = 0.1  # relative difference allowed between joint readings and power: gear losses under load, drive constants
LEAST = 0.03  # least uncertainty as a share of a usual size
SHOWN = 0.05  # share of usual dry friction above which readings count as containing friction
MOST_CURRENT = 300.0  # [A] no drive of a joint takes more at its effort limit
SURE = 4.0  # standard deviations from which one joint's number claims a law, or shows that a unit is wrong
DISAGREE = 3.0  # standard deviations between both estimates from which a remark reports it


def shows_friction(side: JointSide) -> bool:
    """False if the readings contain no friction, as torques measured behind the gears."""
    known, effort = np.flatnonzero(side.known), side.robot.limits.effort
    seen = [side.friction(int(j), float(side.usual[j])) for j in known]
    above = [f - 4 * d > SHOWN * USUAL * effort[j] for j, (f, d) in zip(known, seen, strict=True)]
    return bool(len(above) and np.mean(above) >= 0.5)


def prior_of(side: JointSide | None) -> dict[str, Measured]:
    """Priors from the joints' readings for the fit of the power; empty if the readings contain no friction."""
    if side is None or not shows_friction(side):
        return {}
    known, limits = np.flatnonzero(side.known), side.robot.limits
    cruise = Scale.of(limits, np.zeros(1)).usual_speed
    usual = (USUAL * limits.effort, USUAL * limits.effort / cruise, ROTOR * limits.effort)
    out = {}
    for k, name in enumerate(LAWS):
        values = np.maximum(side.values[k][known], 0.0)
        share = APART if k < 2 else 0.5  # links and smoothed accelerations hide the inertia of rotors
        own = WIDER**2 * side.covariance[k][np.ix_(known, known)]
        least = LEAST * usual[k][known]
        out[name] = Measured(known, values, own + np.diag((share * values) ** 2 + least**2))
    return out


def by_power_alone(f: Fit) -> Fit:
    """Refit the same hypothesis without the joints' readings."""
    w = f.world
    bare = replace(w.scale, measured={})
    charts = [c if c.term.name not in w.scale.measured else chart(c.term, w.declared, bare, c.n) for c in f.charts]
    return fit(w, f.nuisance, charts, list(f.numbers), f.free, f.amounts)


def friction_of(f: Fit, joint: int, speed: float) -> tuple[float, float] | None:
    """Friction [N m] of a fit at a joint's speed [rad/s], and its standard deviation; None if it has no friction."""
    n = f.world.samples.n
    value = float(friction_torque(f.model, n)(np.array([speed]), joint)[0])
    slope = np.zeros(len(f.theta))
    found = False
    for c, z, place in zip(f.charts, f.numbers, f.places, strict=True):
        if issubclass(c.term.kind, TorqueEffect) and c.term.kind.dissipates:
            found = True
            slope[place] = [_slope(f, c, z, k, joint, speed, value) for k in range(len(z))]
    if not found:
        return None
    return value, float(np.sqrt(max(slope @ f.covariance @ slope, 0.0)))


def _slope(f: Fit, c: Chart, z: np.ndarray, k: int, joint: int, speed: float, value: float) -> float:
    """d friction / d z_k by a finite difference."""
    step = 1e-4 * max(abs(z[k]), float(c.precision[k, k]) ** -0.5)
    moved = z.copy()
    moved[k] += step
    model = c.into(f.model, moved)
    return (float(friction_torque(model, f.world.samples.n)(np.array([speed]), joint)[0]) - value) / step


def side_records(side: JointSide | None, chosen: Fit | None) -> list[dict[str, Any]]:
    """Per joint: drive constant, friction and inertia by its own readings, and its friction by the power.

    Args:
        side: fit of the readings; None gives no records.
        chosen: fit of the power, from which friction by the power follows; None for none.

    Returns:
        Records as in diagnosis.json under `joint_side`; numbers that are unknown are None.
    """
    if side is None:
        return []
    alone = by_power_alone(chosen) if chosen is not None else None
    records = []
    for j, joint in enumerate(side.robot.joints):
        speed, effort = (side.robot.unit(kind, joint) for kind in ("velocity", "effort"))
        row: dict[str, Any] = {"joint": joint, "unit": f"{effort}/A" if side.unit == "A" else "1"}
        row["units"] = {"speed": speed, "friction": effort}
        row["scale"], row["scale_ci95"] = _number(side.scale[j], side.scale_deviation[j])
        for k, name in enumerate(("coulomb", "viscous", "inertia")):
            deviation = float(np.sqrt(side.covariance[k, j, j]))
            row[name], row[f"{name}_ci95"] = _number(side.values[k, j], deviation, least=0.0)
        row.update(speed=None, own=None, power=None, together=None, disagreement=None)
        if side.known[j]:
            usual = float(side.usual[j])
            own = side.friction(j, usual)
            row.update(speed=usual, own=_word(own))
            power = friction_of(alone, j, usual) if alone is not None else None
            if power is not None and chosen is not None:
                row["power"], row["together"] = _word(power), _word(friction_of(chosen, j, usual) or power)
                least = LEAST * USUAL * side.robot.limits.effort[j]
                apart = np.linalg.norm([WIDER * own[1], power[1], APART * own[0], least])
                row["disagreement"] = float(abs(own[0] - power[0]) / apart)
        records.append(row)
    return records


def _number(value: float, deviation: float, least: float = -np.inf) -> tuple[float | None, list[float] | None]:
    if not np.isfinite(value):
        return None, None
    wide = STUDENT * WIDER * deviation
    return float(value), [float(max(value - wide, least)), float(max(value + wide, least))]


def _word(seen: tuple[float, float]) -> dict[str, Any]:
    value, ci = _number(*seen)
    return {"friction": value, "ci95": ci}


def side_remarks(side: JointSide | None, records: Sequence[dict[str, Any]]) -> list[str]:
    """Remarks on the joints' readings and on how they agree with the power, by `side_records`."""
    if side is None:
        return []
    out = []
    seen = any(row["power"] is not None and row["power"]["ci95"][0] > row["own"]["ci95"][1] for row in records)
    if side.known.any() and not shows_friction(side) and seen:
        what = "torques" if side.unit == "N m" else "currents"
        out.append(
            f"The logged {what} contain no friction (measured behind the gears, or computed): not used for friction."
        )
    off = [row["joint"] for row in records if row["unit"] == "1" and row["scale"] and abs(row["scale"] - 1) > STRANGE]
    if off:
        out.append(f"The logged torques of {', '.join(off)} are not torques in N m; by their size, they are currents.")
    if side.unit == "A" and (side.multiple < 0).any():
        names = ", ".join(joint for joint, k in zip(side.robot.joints, side.multiple, strict=True) if k < 0)
        out.append(f"The logged currents of {names} have the opposite sign of the torque: used with the other sign.")
    for row in records:
        if row["disagreement"] is not None and row["disagreement"] > DISAGREE:
            speed, effort = row["units"]["speed"], row["units"]["friction"]
            out.append(
                f"{row['joint']}: friction at {row['speed']:.2g} {speed} is {row['own']['friction']:.3g} {effort} by "
                f"its own readings and {row['power']['friction']:.3g} {effort} by the power: the two sides disagree."
            )
    return out


NEAR = 0.3  # relative deviation up to which a multiple of the torque identifies a unit


def wrong_units(side: JointSide) -> str:
    """Remark on logged torques or currents that clearly have another sign or unit; "" if there are none."""
    joints, limits = side.robot.joints, side.robot.limits
    if side.unit == "A":
        most = np.abs(side.scale) + SURE * side.scale_deviation  # N m/A
        known = np.flatnonzero(np.isfinite(most))
        if not len(known) or (limits.effort[known] < MOST_CURRENT * most[known]).any():
            return ""
        said = f"those of {', '.join(joints[int(j)] for j in known)} look like mA"
        return f"The logged currents are not used: {said}. Correct them, or name their unit in log.toml."
    found: dict[str, list[str]] = {}
    for joint, times, effort in zip(joints, side.multiple, limits.effort, strict=True):
        units = {"N m with the opposite sign": -1.0, "mN m": 1e3, "% of the effort limit": 100 / effort}
        unit = next((u for u, x in units.items() if abs(times / x - 1) < NEAR), f"{times:.3g} times the torque in N m")
        if times < -1 / TIMES or times > TIMES:
            found.setdefault(unit, []).append(joint)
    if not found:
        return ""
    said = "; ".join(f"those of {', '.join(names)} look like {unit}" for unit, names in found.items())
    return f"The logged torques are not used: {said}. Correct them, or name their unit in log.toml."


GUESS = 3.0  # upper bound for a joint without information, over the median share of the effort limit


def friction_findings(side: JointSide) -> tuple[list[Finding], list[str]]:
    """Dry and viscous friction if some joint certainly has it, and remarks on the other joints.

    A joint without information gets the others' median share of the effort limit, with a wide interval, but at most the
    largest torque that was read there.
    """
    if not shows_friction(side):
        return [], []
    joints, limits = side.robot.joints, side.robot.limits
    known = np.flatnonzero(side.known)
    unknown = np.flatnonzero(~side.known)
    left = float(np.nansum(side.left[:, known] ** 2))
    largest = np.full(len(limits.effort), np.inf)
    if side.unit == "N m":
        largest = np.nan_to_num(np.nanmax(np.abs(side.samples.reading), axis=0), nan=np.inf)
    out, said = [], []
    for k, name in enumerate(LAWS[:2]):
        values, spread = side.values[k][known], WIDER**2 * side.covariance[k][np.ix_(known, known)]
        deviation = np.sqrt(np.diag(spread))
        if not (values > SURE * deviation).any():
            continue
        shares = np.maximum(values, 0.0) / limits.effort[known]
        most = largest if k == 0 else largest / np.maximum(np.abs(side.samples.v).max(axis=0), 1e-3)
        full = np.minimum(float(np.median(shares)) * limits.effort, most)
        low, high = np.zeros_like(full), np.minimum(max(GUESS * float(np.median(shares)), float(shares.max()))
                                                    * limits.effort, most)  # fmt: skip
        full[known] = np.maximum(values, 0.0)
        low[known] = np.maximum(full[known] - STUDENT * deviation, 0.0)
        high[known] = full[known] + STUDENT * deviation
        direction = np.sign(side.samples.v[:, known]) if k == 0 else side.samples.v[:, known]
        own = float(np.nansum((direction * full[known]) ** 2))
        parameter = effect_class(name).parameters[0]
        out.append(
            Finding(
                name, {parameter.name: full.tolist()}, {parameter.name: np.column_stack([low, high]).tolist()},
                {parameter.name: unit_of_joints(parameter, side.robot.slides)}, own / (own + left),
            )
        )  # fmt: skip
    if out and unknown.size:
        names = ", ".join(joints[int(j)] for j in unknown)
        said.append(
            f"Friction of {names} is not in the readings: guessed as the others' median share of the effort limit."
        )
    return sorted(out, key=lambda row: -row.share_of_residual), said
