"""Jobs of format 2 under several models: stated under the first, with the torque limits held under each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import energy_opt as eo
from energy_opt.files import to_json
from energy_opt.formats import read_trajectory
from energy_opt.robot import Robot, load_robot

THERE, HOME = [1.5, 1.8, -1.6, 0.5, 0.5, 0], [0, 1, -1, 0, 0, 0]


def cell(cycle_time: float, **further: Any) -> dict[str, Any]:
    """A job of one arm in the format of several."""
    steps = [{"name": "there", "to": THERE, "mode": "retime"}, {"name": "back", "to": "home", "mode": "retime"}]
    arm = {"name": "a", "robot": "z1", "poses": {"home": HOME}, "home": "home", "step": steps}
    return {"format": "energy-opt/job/2", "cycle_time": cycle_time, "robot": [arm], **further}


def torques(robot: Robot, file: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time (N,), velocity and torque (N, n) of a written cycle on a dense grid, by Pinocchio."""
    motion = read_trajectory(file, robot.joints)
    tree = pin.buildModelFromUrdf(str(robot.urdf))
    tree = pin.buildReducedModel(tree, [tree.getJointId(name) for name in robot.locked], pin.neutral(tree))
    data, time = tree.createData(), np.linspace(0, motion.duration, 12001)
    q, v, a = motion.sample(motion.time[0] + time)[:3]
    return time, v, np.array([pin.rnea(tree, data, *at) for at in zip(q, v, a, strict=True)])


@pytest.mark.parametrize("further", [{}, {"supply": {"shared": True, "capacity": 5.0}}])
def test_energies_are_those_of_the_first_model(tmp_path: Path, further: dict[str, Any]) -> None:
    """They were the mean of all models."""
    robot = load_robot("z1")
    model = eo.source_model(robot)
    rough = model + eo.effects.CoulombFriction(tau_c=1.0)
    answer = eo.job(cell(4.0, **further), model=[model, rough], self_collision=False)
    answer.save(tmp_path)
    found = answer.document()
    time, v, tau = torques(robot, tmp_path / "cycle_a.csv")
    copper = np.asarray(model.get("copper_loss").full(robot.n))
    drawn = (tau * v).sum(axis=1) + tau**2 @ copper
    standby = float(model.get("standby").values["power"][0])
    if further:  # braking charges the link, and what that holds is used first
        link, used, step = 0.0, 0.0, np.diff(time)
        for _ in range(2):
            used = 0.0
            for joules in (drawn[:-1] * step).tolist():
                used += max(joules - link, 0.0)
                link = min(max(link - joules, 0.0), 5.0)
        assert found["energy_total"] == pytest.approx(used + standby * time[-1], rel=1e-4)
    else:
        assert found["energy_total"] == pytest.approx(np.trapezoid(drawn + standby, time), rel=1e-5)
        assert found["bound"] <= found["energy_total"] * (1 + 1e-9)
        # no supply is stated: the power is what the meter shows, what returns included
        assert found["supply"]["energy_own"] == pytest.approx(found["energy_total"], rel=1e-4)
        assert found["peak_power"] == pytest.approx((drawn + standby).max(), rel=0.02)
    assert sum(row["energy_total"] for row in found["robots"][0]["steps"]) == pytest.approx(found["energy_total"])
    assert found["levers"][-1]["energy_total"] == found["energy_total"]
    assert found["robust"]["total"] > found["energy_total"] + 1.0  # friction
    means = {lever["name"]: lever["energy_total"] for lever in found["robust"]["levers"]}
    assert list(means) == [lever["name"] for lever in found["levers"]]
    assert means["as_is"] >= means["speeds"] >= means["modes"] and list(means.values())[-1] == found["robust"]["total"]
    assert "mean [J]" in str(answer) and f"{means['as_is']:.1f}" in str(answer)
    assert found["robust"]["lower_bound"] <= found["robust"]["total"]


def test_torque_limits_hold_under_every_model_or_a_warning_says_not(tmp_path: Path) -> None:
    strong = load_robot("z1")
    rows = {
        joint: {"has_effort_limits": True, "max_effort": 0.3 * effort}
        for joint, effort in zip(strong.joints, strong.limits.effort.tolist(), strict=True)
    }
    (tmp_path / "limits.yaml").write_text(to_json({"joint_limits": rows}))
    robot = load_robot("z1", limits=tmp_path / "limits.yaml")
    model = eo.source_model(robot)
    for share, held in ((0.07, True), (0.15, False)):
        dry = share * robot.limits.effort
        models = [model, model + eo.effects.CoulombFriction(tau_c=dry.tolist())]
        answer = eo.job(cell(1.7), model=models, limits=tmp_path / "limits.yaml", self_collision=False)
        answer.save(tmp_path / str(share))
        _, v, tau = torques(robot, tmp_path / str(share) / "cycle_a.csv")
        most = float((np.abs(tau + np.where(np.abs(v) > 1e-3, np.sign(v), 0.0) * dry) / robot.limits.effort).max())
        said = [text for text in answer.document()["warnings"] if "torque limit" in text]
        assert (most <= 1, not said) == (held, held)
        assert held or said[0].startswith("a: under another model than the first joint")


def test_a_models_payload_is_carried_unless_the_robot_states_one() -> None:
    """It was left out, as if the arm carried nothing."""
    model = eo.source_model(load_robot("z1"))
    held = model + eo.effects.Payload(mass=1.0, com=[0.0, 0.0, 0.05])
    stated = cell(4.0)
    stated["robot"][0]["payload"] = 0.0
    totals = [
        eo.job(job, model=[law], self_collision=False).document()["energy_total"]
        for job, law in ((cell(4.0), model), (cell(4.0), held), (stated, held))
    ]
    assert totals[1] > totals[0] + 0.5 and totals[2] == pytest.approx(totals[0], rel=1e-6)


def test_a_supply_that_is_exceeded_under_the_first_model_is_named() -> None:
    """max_power is held for the mean; here the first model draws more than the second."""
    model = eo.source_model(load_robot("z1"))
    thirsty = model + eo.effects.CoulombFriction(tau_c=2.0)
    free = {"supply": {"shared": True, "capacity": 5.0}}
    asked = {"model": [thirsty, model], "self_collision": False}
    peak = eo.job(cell(4.0, **free), **asked).document()["peak_power"]
    free["supply"]["max_power"] = peak - 3.0
    found = eo.job(cell(4.0, **free), **asked).document()
    said = found["warnings"][-1]
    assert found["peak_power"] > peak - 3.0 and "under the first model power reaches" in said


@pytest.mark.slow
def test_the_bound_of_a_wait_is_that_of_the_first_model() -> None:
    """The power of an explicit wait was the mean of the models, so the bound exceeded what the first one needs."""
    job = cell(5.0)
    job["robot"][0]["step"].insert(1, {"name": "hold", "wait": 1.5})
    model = eo.source_model(load_robot("z1"))
    copper = eo.effects.CopperLoss(r_over_kt2=10 * model.get("copper_loss").values["r_over_kt2"])
    heavy = model.replaced(copper) + eo.effects.ViscousFriction(b=3.0)  # the mean moves slowly, the first model waits
    alone, several = (eo.job(job, model=models, self_collision=False).document() for models in (model, [model, heavy]))
    assert alone["energy_total"] - 1e-6 <= several["bound"] < several["energy_total"] - 0.1


def test_a_link_that_stores_all_braking_energy_plans_as_full_regeneration() -> None:
    """Moves were planned as if all of it were lost, and steps and levers stated so."""
    asked: dict[str, Any] = {"model": [eo.source_model(load_robot("z1"))], "self_collision": False}
    free, linked = (eo.job(cell(4.0, **f), **asked).document() for f in ({}, {"supply": {"capacity": 500.0}}))
    totals = [[lever["energy_total"] for lever in found["levers"]] for found in (free, linked)]
    assert totals[1] == pytest.approx([*totals[0], totals[0][-1]], rel=1e-6)
    assert linked["levers"][-2]["energy_total"] == pytest.approx(linked["supply"]["energy_own"], rel=1e-12)
