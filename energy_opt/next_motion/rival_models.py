"""Rival models that a motion should distinguish, the uncertainty of each, and the differences of their readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.linalg import null_space

from energy_opt.diagnosis.data.predict import predict
from energy_opt.diagnosis.data.samples import Samples
from energy_opt.diagnosis.evidence.odds import SPREADS
from energy_opt.diagnosis.fit.posterior import Fit, Nuisance
from energy_opt.diagnosis.hypothesis.links import deviations_of
from energy_opt.diagnosis.verdict.inference import Inference
from energy_opt.effects import Armature, CoulombFriction, ViscousFriction
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel
from energy_opt.robot import RigidBody

# effects that a joint that never moved may have, with usual sizes
IDLE = ((CoulombFriction, 0.5), (ViscousFriction, 0.5), (Armature, 0.2))


@dataclass(frozen=True)
class Slack:
    """Uncertainty of a rival after the data so far: unknowns u ~ N(0, 1), and the meter's noise.

    Attributes:
        values: (P, g) change of the model's values by u.
        push: (10 n,) inertial parameters by which links deviate from their URDF. links: (10 n, g) their change by u.
        level: standard deviation of a run's level, W. density: of slow noise, W^2 s, over a recording's length.
    """

    values: np.ndarray
    push: np.ndarray
    links: np.ndarray
    level: float
    density: float


@dataclass(frozen=True)
class Rival:
    """A model that may be true; `slack` is None if it is known exactly and the meter has no noise."""

    model: PowerModel
    slack: Slack | None = None


def rivals_of(found: Inference, n: int) -> list[Rival]:
    """The models to tell apart: those that fit equally well, or the accepted one with more in each idle joint.

    Every idle joint has rivals of its own, so that the smallest difference is zero until all of them move. Only links
    and level of these rivals are uncertain, as the numbers of the idle joints are in question.
    """
    if len(found.rivals) > 1:
        return [Rival(f.model, _slack(f, f.model, n)) for f in found.rivals]
    model = found.accepted.model
    for kind, _ in IDLE:  # all rivals get the same structure
        if model.get(kind.name) is None:
            model = model.replaced(kind.neutral(n))
    held = {e.name: e.full(n) for e in model.effects}
    more = [(kind, size * np.eye(n)[joint]) for joint in (*found.idle, *found.unseen) for kind, size in IDLE]
    models = [model, *(model.replaced(kind.from_full(held[kind.name] + added, n)) for kind, added in more)]
    return [Rival(m, _slack(found.accepted, m, n, numbers=False)) for m in models]


def _slack(f: Fit, model: PowerModel, n: int, numbers: bool = True) -> Slack:
    """Uncertainty of a model from a fit with the same effects: of links and level, with `numbers` also of effects.

    Links have the widest prior that evidence weighs, also those that the fit takes for exact, as the fit after the next
    recording may have them deviate.
    """
    return slack_under(f, model, n, replace(f.nuisance, spread=max(SPREADS)), numbers)


def slack_under(f: Fit, model: PowerModel, n: int, nuisance: Nuisance, numbers: bool = True) -> Slack:
    """Uncertainty of a model under the prior widths `nuisance`; a link also deviates where no reading so far shows it.

    Args:
        f: a fit with the model's effects. model: the rival. n: number of joints. numbers: also of the effects' numbers.
    """
    charted, amounts = f.count, len(f.amounts)
    first = charted + len(f.weights)
    records = np.r_[np.arange(charted if numbers else 0), first : first + amounts]
    wider = f.hessian.copy()
    wider[first : first + amounts, first : first + amounts] += np.eye(amounts) * (
        nuisance.spread**-2 - f.nuisance.spread**-2
    )
    covariance = f.covariance + np.linalg.inv(wider) - np.linalg.inv(f.hessian)
    sizes, axes = np.linalg.eigh(covariance[np.ix_(records, records)])
    root = axes * np.sqrt(np.maximum(sizes, 0.0))
    basis, noise = f.world.links.basis, f.world.whiten.noise
    every = deviations_of(f.world.samples.body)
    unseen = every @ null_space(np.linalg.lstsq(every, basis, rcond=None)[0].T) * nuisance.spread
    values, where = np.zeros((len(model.values(n)), len(records) + unseen.shape[1])), model.places(n)
    if numbers:
        for c, z, place in zip(f.charts, f.numbers, f.places, strict=True):
            values[where[c.term.name], : len(records)] = c.slope(z) @ root[place]
    links = np.column_stack([basis @ root[len(records) - amounts :], unseen])
    density = noise.white**2 * f.world.samples.step + 2 * noise.wave**2 * noise.memory
    level = float(np.hypot(nuisance.offset, nuisance.drift))
    return Slack(values, basis @ f.amounts, links, level, density)


def separations(rivals: Sequence[Rival], body: RigidBody, trajectory: Trajectory, step: float) -> np.ndarray:
    """Rms difference [W] of the readings that every two rivals expect, (pairs,) in the order of `combinations`.

    The part that a rival's uncertain parameters, the links and the run's level can explain is left out: with d the
    difference, u ~ N(0, 1) these unknowns, G the readings' derivatives by them and s the noise of a reading, its square
    is the minimum of |d - G u|^2 + s^2 |u|^2 over the number of readings. Either rival may be the true one: the smaller
    difference counts.

    Args:
        step: [s] between the readings that are compared.
    """
    count = int(trajectory.duration / step) + 1
    return np.sqrt([left / count for left, _, _ in _unexplained_parts(rivals, body, trajectory, step)])


def nearest(
    rivals: Sequence[Rival], body: RigidBody, trajectory: Trajectory, step: float, pair: int
) -> list[PowerModel]:
    """The rivals' models, one of a pair with the numbers by which it resembles the other most on a motion.

    If a motion is changed to increase the difference of these models, the difference beyond their parameters'
    uncertainty also increases (Danskin's theorem).

    Args:
        rivals: all of them. body: the arm's. trajectory: the motion. step: [s] between readings. pair: its index.
    """
    _, k, u = _unexplained_parts(rivals, body, trajectory, step)[pair]
    models, slack = [rival.model for rival in rivals], rivals[k].slack
    if slack is not None:
        parameters = [(p, e.extents) for e in models[k].effects for p in e.parameters]
        bounds = [(p.lower, p.upper) for p, extents in parameters for _ in range(p.count(body.n, extents))]
        low, high = np.array(bounds).T
        models[k] = models[k].with_values(np.clip(models[k].values(body.n) + slack.values @ u[:-1], low, high), body.n)
    return models


def _unexplained_parts(
    rivals: Sequence[Rival], body: RigidBody, trajectory: Trajectory, step: float
) -> list[tuple[float, int, np.ndarray]]:
    """Of every two rivals: the squares [W^2] of `separations`, the rival that explains more, and its unknowns."""
    samples = samples_of(body, trajectory, step)
    shown = [expected_readings(rival, samples) for rival in rivals]
    out = []
    for a, b in combinations(range(len(rivals)), 2):
        d = shown[a][0] - shown[b][0]
        both = ((k, *_unexplained(x, rivals[k].slack, shown[k][1], step)) for k, x in ((a, -d), (b, d)))
        k, left, u = min(both, key=lambda row: row[1])
        out.append((left, k, u))
    return out


def expected_readings(rival: Rival, samples: Samples) -> tuple[np.ndarray, np.ndarray]:
    """The readings (M,) that a rival expects, and their derivatives (M, g + 1) by its unknowns and the run's level."""
    slack = rival.slack
    if slack is None:
        return predict(rival.model, samples).reading, np.zeros((len(samples.power), 0))
    by_amount = samples.deviating(np.column_stack([slack.push, slack.links]))
    p = predict(rival.model, samples, by_amount[:, :, 0], by_amount[:, :, 1:])
    return p.reading, np.column_stack([p.jacobian @ slack.values + p.external, np.full(len(p.reading), slack.level)])


def _unexplained(d: np.ndarray, slack: Slack | None, by: np.ndarray, step: float) -> tuple[float, np.ndarray]:
    """Sum of squares [W^2] of a difference that the unknowns cannot explain, and the unknowns that explain the rest."""
    if slack is None:
        return float(d @ d), np.zeros(0)
    noise = slack.density / step
    taken = by.T @ d
    u = np.linalg.solve(by.T @ by + noise * np.eye(by.shape[1]), taken)
    return max(float(d @ d - taken @ u), 0.0), u


def samples_of(body: RigidBody, trajectory: Trajectory, step: float) -> Samples:
    """A motion as samples without a measured power.

    Args:
        body: the arm's. trajectory: the motion. step: [s] between samples.
    """
    time = np.arange(int(trajectory.duration / step) + 1) * step
    q, v, a, _ = trajectory.sample(trajectory.time[0] + time)
    count = len(time)
    whole = (slice(0, count),)
    nothing = np.full_like(q, np.nan)
    return Samples(
        body, q, v, a, time, whole, nothing, time, np.zeros(count), whole, (None,), (1,), np.ones(count), 1.0,
        1.0, ("",), ("motion",), ((time, np.zeros(count)),),
    )  # fmt: skip
