"""Torque limits of a job under several models: held under each, or a warning says under which not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
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


def test_a_front_of_a_job_holds_torque_limits_under_every_model_and_carries_the_models_payload(tmp_path: Path) -> None:
    """As `job` does: the limits were exceeded without a word, and a model's payload was left out."""
    weak_robot = weak(tmp_path, 0.3)
    model = eo.source_model(weak_robot)
    rough = model + eo.effects.CoulombFriction(tau_c=(0.07 * weak_robot.limits.effort).tolist())
    steps = [{"name": "there", "to": [1.5, 1.8, -1.6, 0.5, 0.5, 0]}, {"name": "back", "to": "home"}]
    job = {
        "format": "energy-opt/job/1", "robot": "z1", "cycle_time": 1.6, "home": [0, 1, -1, 0, 0, 0],
        "step": [{**step, "mode": "retime"} for step in steps],
    }  # fmt: skip
    asked = {"robot": weak_robot, "self_collision": False}
    alone = eo.job(job, model=[model, rough], **asked).document()
    front = eo.tradeoff(job=job, model=[model, rough], durations=[1.6], **asked).document()
    assert front["points"][0]["energy_total"] == pytest.approx(alone["energy_total"], rel=1e-6)
    assert front["points"][0]["status"] == "solved"
    assert not [text for text in front["warnings"] if "torque" in text]

    rougher = model + eo.effects.CoulombFriction(tau_c=(0.15 * weak_robot.limits.effort).tolist())
    said = eo.tradeoff(job=job, model=[model, rougher], durations=[1.6], **asked).document()["warnings"]
    assert any(text.startswith("cycle of 1.6 s: under another model than 'model 1' joint") for text in said)

    carried = [model + eo.effects.Payload(mass=0.2, com=[0.0, 0.0, 0.05])]
    alone = eo.job(job, model=carried, **asked).document()
    front = eo.tradeoff(job=job, model=carried, durations=[1.6], **asked).document()
    assert alone["steps"][0]["payload"] == 0.2
    assert front["points"][0]["energy_total"] == pytest.approx(alone["energy_total"], rel=1e-5)  # room for files
    empty = eo.tradeoff(job=job, model=[model], durations=[1.6], **asked).document()
    assert front["points"][0]["energy_total"] > 1.001 * empty["points"][0]["energy_total"]


def test_a_placement_holds_torque_limits_under_every_model(tmp_path: Path) -> None:
    """The job at the answer exceeded them under the second model."""
    robot = weak(tmp_path, 0.3)
    ends = {"there": [1.5, 1.8, -1.6, 0.5, 0.5, 0.0], "back": [0.0, 1.0, -1.0, 0.0, 0.0, 0.0]}
    steps = []
    for name, q in ends.items():
        pose, _, _ = robot.body.frame_motion(
            robot.body.last, np.eye(4), np.array([q]), np.zeros((1, 6)), np.zeros((1, 6))
        )
        x, y, z, w = pin.Quaternion(pose[0, :3, :3]).coeffs()
        steps.append({"name": name, "pose": [*pose[0, :3, 3].tolist(), *map(float, (x, y, z, w))], "mode": "retime"})
    job = {"format": "energy-opt/job/1", "robot": "z1", "cycle_time": 1.6, "step": steps}
    model = eo.source_model(robot)
    rough = model + eo.effects.CoulombFriction(tau_c=(0.07 * robot.limits.effort).tolist())
    asked = {"looked_at": 2, "seeds": 1, "steps": 0, "robot": robot, "self_collision": False}
    answer = eo.place(job, "-0.001,0.001,0,0,0,0", model=[model, rough], **asked)
    found = answer.placement
    assert repr(answer).startswith("PlaceAnswer('z1', base at [") and len(repr(answer)) < 120
    shares = [
        effort_of(robot, eo.PowerModel("z1", rough.effects), answer.trajectory) / robot.limits.effort
        for answer in found.result.plan.answers
    ]
    said = [text for text in found.warnings if "torque" in text]
    assert said or max(float(share.max()) for share in shares) <= 1
