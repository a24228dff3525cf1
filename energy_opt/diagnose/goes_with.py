"""What the remaining residual goes with: signals and joints, by the share of what noise leaves open."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from energy_opt.diagnose.trace import Trace
from energy_opt.diagnose.unlisted import structures

SIGNAL = {
    "position": "position",
    "velocity": "velocity",
    "reversal": "way since reversal",
    "step": "time (step)",
    "wave": "time (cycle)",
}
WEAKEST = 0.05
MOST = 8


def goes_with(found: Trace, joints: Sequence[str]) -> list[dict[str, Any]]:
    """Signals that the accepted hypothesis' residual follows, strongest first; empty where only noise is left."""
    if not found.follows or not (found.left.structured or found.best.extras):
        return []
    f, samples = found.accepted, found.search.samples
    open_part = max(float(f.residual @ f.residual) - len(f.residual) * samples.noise**2, 1e-9)
    rows = []
    for gained, extra in structures(f, samples):
        strength = float(np.clip(gained / open_part, 0.0, 1.0))
        if strength > WEAKEST:
            rows.append(
                {
                    "signal": SIGNAL[extra.family],
                    "joint": joints[extra.joint] if extra.joint >= 0 else None,
                    "strength": strength,
                    "setting": extra.setting,
                }
            )
    for j, joint in enumerate(joints):
        column = samples.temperature[:, j]
        if np.isfinite(column).all() and np.ptp(column) > 0:
            strength = float(np.corrcoef(column, f.residual)[0, 1] ** 2)
            if strength > WEAKEST:
                rows.append({"signal": "temperature", "joint": joint, "strength": strength, "setting": None})
    chosen = {(SIGNAL[e.family], joints[e.joint] if e.joint >= 0 else None) for e in found.best.extras}
    rows.sort(key=lambda row: ((row["signal"], row["joint"]) not in chosen, -float(row["strength"] or 0)))
    return rows[:MOST]
