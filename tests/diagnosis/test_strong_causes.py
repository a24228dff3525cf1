"""An effect that is stronger than usual: the prior must not divide it between two effects."""

from __future__ import annotations

import numpy as np
import pinocchio
import pytest
from logs import UR, lines, log, put

from energy_opt.diagnosis import diagnose
from energy_opt.effects import CopperLoss, Standby
from energy_opt.measured import read_set
from energy_opt.power import PowerModel

COPPER, STANDBY, VISCOUS = 0.01, 60.0, 6.0  # [W / (N m)^2], [W], [N m s/rad]: of a wrist a third of its torque


@pytest.mark.slow
def test_strong_viscous_friction_is_one_cause(tmp_path):
    """A part of it was claimed as viscous friction that falls with time."""
    body, rng = pinocchio.buildModelFromUrdf(str(UR.urdf)), np.random.default_rng(5)
    middle = np.array([0, -1.57, 1.57, -1.57, -1.57, 0])
    runs, data, start = "", body.createData(), 0.0
    for k in range(8):
        lasts = rng.uniform(0.8, 1.3)
        t = np.arange(0, lasts + 0.6, 0.008)
        x = np.clip((t - 0.3) / lasts, 0, 1)[:, None]
        s, s1, s2 = 10 * x**3 - 15 * x**4 + 6 * x**5, 30 * x**2 * (1 - x) ** 2, 60 * x * (1 - x) * (1 - 2 * x)
        begin, way = middle + rng.uniform(-0.5, 0.5, UR.n), rng.uniform(-1.2, 1.2, UR.n)
        q, v, a = begin + way * s, way * s1 / lasts, way * s2 / lasts**2
        tau = np.array([pinocchio.rnea(body, data, *row) for row in zip(q, v, a, strict=True)]) + VISCOUS * v
        power = STANDBY + (tau * v + COPPER * tau**2).sum(1) + 0.6 * rng.normal(size=len(t))
        header = ",".join(["time", *(f"{joint}.position" for joint in UR.joints), "power"])
        put(tmp_path / f"{k}.csv", lines(header, [t, *q.T, power]))
        runs += f'[[run]]\nfile = "{k}.csv"\nkind = "motion"\nstart = {start}\n'
        start += lasts + 2
    declared = PowerModel("ur5e", (Standby(power=STANDBY), CopperLoss(r_over_kt2=COPPER)))
    found = diagnose(read_set(log(tmp_path, "ur5e", runs)), declared).document
    assert [e["name"] for e in found["effects"]] == ["viscous_friction"]
