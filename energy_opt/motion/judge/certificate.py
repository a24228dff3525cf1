"""The judge: a trajectory's limits on a dense grid, from its rows, Pinocchio's torque and the exact laws alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from energy_opt.motion.judge.energy import DENSER, Dense, Scorer
from energy_opt.motion.trajectory import Trajectory
from energy_opt.robot import Limits

ALLOWED = 1e-6  # a violation beyond this share of the bound is one

KINDS = ("position", "velocity", "acceleration", "jerk", "effort")


@dataclass(frozen=True)
class Certificate:
    """How far a trajectory stays inside its limits.

    `max_violation` per kind is a fraction of the bound (of the range for position): <= 0 is inside, -1 unlimited or
    unused. `worst` names limit, joint, time [s], value and bound.
    """

    samples: int
    max_violation: dict[str, float]
    worst: dict[str, object]

    @property
    def valid(self) -> bool:
        """No limit is violated by more than 1e-6 of its bound."""
        return max(self.max_violation.values()) <= ALLOWED

    @property
    def violation(self) -> float:
        """The largest of all."""
        return max(self.max_violation.values())

    def document(self) -> dict[str, object]:
        """As it stands in result.json."""
        return {"samples": self.samples, "max_violation": self.max_violation, "worst": self.worst}


def certify(
    trajectory: Trajectory, scorer: Scorer, limits: Limits, samples: int | None = None, rows_only: bool = False
) -> Certificate:
    """Check `trajectory` against `limits` on a grid at least ten times denser than its rows, or of `samples` points."""
    factor = DENSER if samples is None else max(DENSER, -(-samples // (len(trajectory.time) - 1)))
    return certificate_of(scorer.dense(trajectory, 1 if rows_only else factor), limits)


def certificate_of(dense: Dense, limits: Limits) -> Certificate:
    """The certificate of a trajectory that lies on a dense grid already."""
    trajectory, time, q, v, a, jerk, tau = (
        dense.trajectory, dense.time, dense.q, dense.v, dense.a, dense.jerk, dense.effort,
    )  # fmt: skip
    span = limits.upper - limits.lower
    with np.errstate(invalid="ignore"):
        outside = np.maximum(q - limits.upper, limits.lower - q) / np.where(np.isfinite(span), span, 1.0)
    excess = {"position": np.where(np.isfinite(outside), outside, -1.0)}
    values = {"position": q, "velocity": v, "acceleration": a, "jerk": jerk, "effort": tau}
    bounds = {kind: getattr(limits, kind) for kind in KINDS[1:]}
    for kind, bound in bounds.items():
        excess[kind] = np.abs(values[kind]) / bound - 1
    worst_kind = max(KINDS, key=lambda kind: float(excess[kind].max()))
    k, j = np.unravel_index(int(np.argmax(excess[worst_kind])), excess[worst_kind].shape)
    value = float(values[worst_kind][k, j])
    if worst_kind == "position":
        bound = float(limits.upper[j] if limits.upper[j] - value < value - limits.lower[j] else limits.lower[j])
    else:
        bound = float(bounds[worst_kind][j])
    worst = {
        "limit": worst_kind,
        "joint": trajectory.joints[j],
        "time": float(time[k]),
        "value": value,
        "bound": bound,
    }
    return Certificate(len(time), {kind: float(excess[kind].max()) for kind in KINDS}, worst)
