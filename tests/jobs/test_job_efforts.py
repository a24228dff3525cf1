"""Torque limits of a job under several models: held under each, or a warning says under which not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import energy_opt as eo
from energy_opt.files import to_json
from energy_opt.robot import Robot, load_robot


def weak(folder: Path, share: float) -> Robot:
    """A Z1 whose drives have a share of their torque."""
    strong = load_robot("z1")
    rows = {
        joint: {"has_effort_limits": True, "max_effort": share * effort}
        for joint, effort in zip(strong.joints, strong.limits.effort.tolist(), strict=True)
    }
    (folder / "limits.yaml").write_text(to_json({"joint_limits": rows}))
    return load_robot("z1", limits=folder / "limits.yaml")


def planned(robot: Robot, friction: float, cycle_time: float) -> tuple[Any, list[float]]:
    """A job under two models, one with dry friction of a share of the limits; and the largest shares that both need."""
    models = [eo.source_model(robot)]
    models.append(models[0] + eo.effects.CoulombFriction(tau_c=(friction * robot.limits.effort).tolist()))
    steps = [{"name": "there", "to": [1.5, 1.8, -1.6, 0.5, 0.5, 0]}, {"name": "back", "to": "home"}]
    job = {
        "format": "energy-opt/job/1", "robot": "z1", "cycle_time": cycle_time, "home": [0, 1, -1, 0, 0, 0],
        "step": [{**step, "mode": "retime"} for step in steps],
    }  # fmt: skip
    found = eo.job(job, robot=robot, model=models, self_collision=False).result
    used = []
    for model in models:
        law = eo.PowerModel(model.robot, model.effects)
        moves = (answer.trajectory for answer in found.plan.answers)
        effort = np.vstack([effort_of(robot, law, move) for move in moves])
        used.append(float((effort / robot.limits.effort).max()))
    return found, used


def effort_of(robot: Robot, model: Any, move: Any) -> np.ndarray:
    """Motors' torque (N, n) [N m] by Pinocchio, and dry friction in the direction of motion."""
    import pinocchio as pin

    tree = pin.buildModelFromUrdf(str(robot.urdf))
    tree = pin.buildReducedModel(tree, [tree.getJointId(name) for name in robot.locked], pin.neutral(tree))
    data, rows = tree.createData(), []
    q, v, a, _ = move.sample(np.linspace(*move.time[[0, -1]], 2001))
    dry = next(
        (effect.values["tau_c"] for effect in model.effects if effect.name == "coulomb_friction"), np.zeros(robot.n)
    )
    for each in zip(q, v, a, strict=True):
        rows.append(pin.rnea(tree, data, *each) + np.where(np.abs(each[1]) > 1e-3, np.sign(each[1]) * dry, 0.0))
    return np.abs(np.array(rows))


def test_the_limits_hold_under_every_model(tmp_path: Path) -> None:
    found, used = planned(weak(tmp_path, 0.3), 0.07, 1.6)  # 1.014 of a limit before
    assert found.solved and used[0] < 0.95 < used[1] < 1
    assert not [text for text in found.warnings if "torque" in text]


def test_a_limit_that_no_plan_holds_is_named(tmp_path: Path) -> None:
    found, used = planned(weak(tmp_path, 0.28), 0.05, 1.8)  # holding the arm takes 0.96, friction 0.05
    assert used[0] < 1 < used[1]
    (said,) = [text for text in found.warnings if "torque" in text]
    assert said.startswith("under another model than 'model 1' joint3 takes ")
    assert float(said.split()[-6]) == pytest.approx(100 * used[1], abs=0.1)
