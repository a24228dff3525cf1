"""Torque limits under several models: of the answer, and of the baselines that it is compared with."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from plane_arm import arm

import energy_opt as eo
from energy_opt.effects import CoulombFriction
from energy_opt.motion import Move, Settings
from energy_opt.motion.plan.efforts import smaller
from energy_opt.motion.plan.robust import RobustPlanner
from energy_opt.motion.plan.robust_models import Rival
from energy_opt.motion.trajectory import Trajectory

LIMIT, FRICTION = 3.0, 0.2  # [N m]


def _most(motion: Trajectory) -> float:
    """Largest torque [N m] of a rod of 1 kg and 0.4 m, with friction, once it moves."""
    q, v, a = motion.sample(np.linspace(motion.time[0], motion.time[-1], 2001))[:3]
    torque = 0.05 * a - 9.81 * 0.2 * np.cos(q) + FRICTION * np.sign(v) * (np.abs(v) > 1e-2)
    return float(np.abs(torque).max())


def test_valid_baselines_hold_the_torque_limits_under_every_model(tmp_path: Path) -> None:
    """An answer that holds them may take more energy than a baseline that does not; that one is not valid."""
    robot = eo.load_robot(arm(tmp_path, 1))
    limits = robot.limits.replace(effort=np.array([LIMIT]), acceleration=np.array([60.0]))
    plain = eo.load_model("source-method-2", robot)
    rivals = [Rival("plain", plain), Rival("rough", plain + CoulombFriction(tau_c=FRICTION))]
    settings = Settings(compile="never", starts=1, controls=12)
    robust = RobustPlanner(dataclasses.replace(robot, limits=limits), rivals, "mean", settings)
    found = robust.solve(Move(np.array([1.2]), np.array([-1.0]), "retime"))

    def mean(motion: Trajectory) -> float:
        return float(np.mean([row["total"] for row in robust.compared(motion, None)]))

    assert _most(found.trajectory) <= LIMIT * (1 + 1e-6)
    for baseline in found.baselines:
        held = _most(baseline.trajectory) <= LIMIT * (1 + 1e-6)
        assert held or not baseline.valid
        assert not baseline.valid or mean(found.trajectory) <= mean(baseline.trajectory) * (1 + 1e-9)
        said = [text for text in found.warnings if text.startswith(f"{baseline.name} is not valid: under 'rough' j0")]
        assert len(said) == (not held)
    assert not found.baseline("toppra").valid


def test_a_joint_without_a_torque_limit_gets_none() -> None:
    """Its shares are 0: 0 / 0 gave a warning of NumPy's."""
    shares = smaller(np.ones(2), np.array([0.0, 1.25]), np.array([0.0, 1.0]))
    assert shares[0] == 1 and 0.75 < shares[1] < 0.8
