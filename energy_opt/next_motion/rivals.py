"""Which models a motion is to tell apart, and how far apart it holds them at the meter."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from energy_opt.diagnose.fit import Fit
from energy_opt.diagnose.predict import predict
from energy_opt.diagnose.samples import Samples
from energy_opt.diagnose.trace import Trace
from energy_opt.effects import (
    Armature,
    CoulombFriction,
    GearEfficiency,
    LoadFriction,
    StribeckFriction,
    ViscousFriction,
)
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel
from energy_opt.robot import RigidBody

IDLE = ((CoulombFriction, 0.5), (ViscousFriction, 0.5), (Armature, 0.2))  # what a joint that never moved may hide
SHOWN_BY_MOTION = (CoulombFriction, ViscousFriction, StribeckFriction, LoadFriction, GearEfficiency, Armature)


def rivals_of(found: Trace, n: int) -> list[PowerModel]:
    """The models to tell apart: those that fit equally well, or the accepted one with more in each idle joint.

    Every idle joint makes rivals of its own, so that the smallest difference stays nought until all of them move.
    """
    idle = np.isin(np.arange(n), found.idle)
    if len(found.rivals) > 1:
        return [_likely(f, idle) for f in found.rivals]
    model = _likely(found.accepted, idle)
    for kind, _ in IDLE:  # all rivals of one structure
        if model.get(kind.name) is None:
            model = model.replaced(kind.neutral(n))
    held = {e.name: e.full(n) for e in model.effects}
    more = [(kind, size * np.eye(n)[joint]) for joint in found.idle for kind, size in IDLE]
    return [model, *(model.replaced(kind.from_full(held[kind.name] + added, n)) for kind, added in more)]


def _likely(f: Fit, idle: np.ndarray) -> PowerModel:
    """The model of a fit; where only motion shows a value, an idle joint is taken to be like the others' median."""
    model = f.model
    if idle.all() or not idle.any():
        return model
    for effect in model.effects:
        if effect.name in f.names and isinstance(effect, SHOWN_BY_MOTION):
            values = {p.name: effect.values[p.name].copy() for p in effect.parameters}
            for value in values.values():
                if value.size == len(idle):
                    value[idle] = np.median(value[~idle])
            model = model.replaced(type(effect)(**values, **effect.choices))
    return model


def separations(models: Sequence[PowerModel], body: RigidBody, trajectory: Trajectory, step: float) -> np.ndarray:
    """Rms difference [W] of the readings that every two models expect, (pairs,) in the order of `combinations`.

    Args:
        step: between the readings that are compared, s.
    """
    samples = samples_of(body, trajectory, step)
    readings = [predict(model, samples).reading for model in models]
    return np.array([np.sqrt(np.mean((x - y) ** 2)) for x, y in combinations(readings, 2)])


def samples_of(body: RigidBody, trajectory: Trajectory, step: float) -> Samples:
    """A motion as samples `step` s apart, without a measured power."""
    time = np.arange(int(trajectory.duration / step) + 1) * step
    q, v, a, _ = trajectory.sample(trajectory.time[0] + time)
    count = len(time)
    return Samples(
        body, q, v, a, time, np.zeros(count), np.zeros(count, dtype=int), (slice(0, count),), ("",), ("motion",), (1,),
        np.full_like(q, np.nan), np.ones(count), 1.0, 1.0, True, ((time, np.zeros(count)),),
    )  # fmt: skip
