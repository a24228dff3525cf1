"""Logged torques in another unit or with another sign: `check` names the joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from logs import UR, lines, log, put

from energy_opt.measured import inspect_set

LIFT = 1


@pytest.mark.parametrize("factor", [1.0, -1.0, 1000.0, 1 / 12])
def test_torques_that_are_multiples_of_gravitys_are_named(tmp_path: Path, factor: float) -> None:
    t = np.arange(800) * 0.01
    rates = 0.5 + 0.2 * np.arange(UR.n)
    q, v = np.sin(np.outer(t, rates)), rates * np.cos(np.outer(t, rates))
    model = pin.buildModelFromUrdf(str(UR.urdf))
    data = model.createData()
    torque = np.array([pin.computeGeneralizedGravity(model, data, x) for x in q]) + 0.5 * np.sign(v)
    torque[:, LIFT] *= factor
    names = [f"{joint}.{signal}" for signal in ("position", "effort") for joint in UR.joints]
    put(tmp_path / "a.csv", lines(",".join(["time", *names, "power"]), [t, q, torque, 90 + np.abs(v).sum(axis=1)]))
    faults, remarks = inspect_set(log(tmp_path, "ur5e", '[[run]]\nfile = "a.csv"\n'))
    said = [remark for remark in remarks if "torque of gravity" in remark]
    assert faults == []
    if factor == 1:
        assert said == []
    else:
        (one,) = said
        assert UR.joints[LIFT] in one and f"{factor:.2g}"[:2] in one and UR.joints[2] not in one
