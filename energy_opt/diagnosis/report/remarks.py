"""Remarks on a verdict: what is left, links, values that are borrowed from other joints, alternatives."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from energy_opt.diagnosis.data.clusters import SLOW
from energy_opt.diagnosis.data.predict import friction_torque
from energy_opt.diagnosis.evidence.residual import wave_words
from energy_opt.diagnosis.fit.posterior import Fit
from energy_opt.diagnosis.hypothesis.terms import entries
from energy_opt.diagnosis.report.words import MUCH, listed, plain
from energy_opt.diagnosis.verdict.inference import NOISE, Inference
from energy_opt.diagnosis.verdict.plausible import times_most
from energy_opt.effects import effect_class
from energy_opt.measured import MeasuredSet, coarse
from energy_opt.power import PowerModel
from energy_opt.robot.limits import unit_of

UNKNOWN = 0.4  # posterior over prior standard deviation above which the data hardly determined a number
WANDERS = 0.3  # share of the noise by which runs' levels must differ to be mentioned


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
    if found.unit:
        unit, ratio = found.unit
        said = f"The power is {ratio:.2g} times that of the declared model: is it in {unit}?"
        out.append(f"{said} Give its unit in log.toml.")
    if not any(run.kind == "motion" for run in measured.runs):
        out.append("No motion was recorded: the set shows no losses in motion.")
    elif len(found.idle) == len(joints):
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
        under = "With the claimed effects" if found.claims or found.links else "Under the declared model"
        out.append(
            f"{under}, the residual is {after.whole[0]:.3g} W rms in motion and {after.whole[1]:.3g} W at rest; noise "
            f"alone would leave {after.noise_motion:.3g} and {after.noise_rest:.3g} W."
        )
    if found.fitted is not None:
        said = "The declared model fits the held-out motions, but not the others: the error of the runs fitted is "
        said += "{:.3g} W; noise alone would leave {:.3g} W.".format(*found.fitted.worst)
        if found.unseen:
            names = ", ".join(joints[j] for j in found.unseen)
            said += f" No held-out motion moves these joints: {names}. Record more motions of them."
        out.append(said)
    if found.verdict in ("partly", "unexplained"):
        out += _implausible(found, joints)
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


def _implausible(found: Inference, joints: Sequence[str]) -> list[str]:
    """Sentences on new values of declared effects that are not claimed, as they are too far from the declared ones."""
    out, f, claimed = [], found.best, [claim.name for claim in found.claims]
    for k, c in enumerate(f.charts):
        over = times_most(f, k)
        if c.term.name not in claimed and over.max(initial=0.0) > 1:
            i = int(np.argmax(over))
            joint = joints[entries(c.term.kind, c.n, len(c.base))[c.kept[i]][1]]
            times = f"{f.numbers[k][i] / c.origin[i]:.2g} times the declared value"
            out.append(
                f"What is left looks like {plain(c.term.name)} of {joint} at {times}. That is not plausible: look for "
                "another cause."
            )
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
        if not np.ptp(sums):  # the alternatives differ in other effects alone
            continue
        speed, unit = (unit_of(kind, s.body.slides[j]) for kind in ("velocity", "effort"))
        span = " to ".join(dict.fromkeys(f"{x:.2g}" for x in (min(sums), max(sums))))
        out.append(f"Friction of {joint} at {usual:.2g} {speed} is {span} {unit} under all these alternatives.")
    return out
