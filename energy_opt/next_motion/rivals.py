"""Which models a motion is to tell apart, and how far apart it holds them at the meter."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from energy_opt.diagnose.predict import predict
from energy_opt.diagnose.samples import Samples
from energy_opt.diagnose.trace import Trace
from energy_opt.effects import Armature, CoulombFriction, ViscousFriction
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel
from energy_opt.robot import RigidBody

IDLE = ((CoulombFriction, 0.5), (ViscousFriction, 0.5), (Armature, 0.2))  # what a joint that never moved may hide


def rivals_of(found: Trace, n: int) -> list[PowerModel]:
    """The models to tell apart: those that fit equally well, or the accepted one with more in each idle joint.

    Every idle joint makes rivals of its own, so that the smallest difference stays nought until all of them move.
    """
    if len(found.rivals) > 1:
        return [f.model for f in found.rivals]
    model = found.accepted.model
    for kind, _ in IDLE:  # all rivals of one structure
        if model.get(kind.name) is None:
            model = model.replaced(kind.neutral(n))
    held = {e.name: e.full(n) for e in model.effects}
    more = [(kind, size * np.eye(n)[joint]) for joint in found.idle for kind, size in IDLE]
    return [model, *(model.replaced(kind.from_full(held[kind.name] + added, n)) for kind, added in more)]


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
    whole = (slice(0, count),)
    nothing = np.full_like(q, np.nan)
    return Samples(
        body, q, v, a, time, whole, nothing, nothing, time, np.zeros(count), whole, (None,), (1,), np.ones(count), 1.0,
        1.0, True, ("",), ("motion",), ((time, np.zeros(count)),),
    )  # fmt: skip
