"""The joints of a gripper: payload and tool are before them, and assumptions on the arm leave them out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import energy_opt
from energy_opt.power import source_method_2
from energy_opt.robot import Robot, load_robot, tool_of
from energy_opt.robot.kinematics import Coupling, Link, idle

ARM = [(f"a{k}", "revolute", k - 1, "") for k in range(4)]
SLIDE, LEAD = ("f1", "prismatic", 3, ""), '<mimic joint="f1" multiplier="-1"/>'
HANDS = {
    "two slides": [SLIDE, ("f2", "prismatic", 3, "")],
    "a follower": [SLIDE, ("f2", "prismatic", 3, LEAD)],
    "knuckles": [("f1", "revolute", 3, ""), ("g1", "revolute", 4, LEAD), ("f2", "revolute", 3, LEAD),
                 ("g2", "revolute", 6, LEAD), ("h", "revolute", 3, LEAD)],
}  # fmt: skip
NO_HANDS = {
    "a slide": ([SLIDE], "f1"),
    "a wrist beside a rod": ([("w", "revolute", 3, ""), ("r", "revolute", 3, '<mimic joint="a2"/>')], "w"),
    "a wrist with a turning tool beside a lamp": (
        [("w", "revolute", 3, ""), ("t", "revolute", 4, ""), ("lamp", "revolute", 3, "")], "t",
    ),
}  # fmt: skip


def arm(folder: Path, hand: list[tuple[str, str, int, str]], effort: float = 50, of_hand: float = 20) -> Robot:
    """Level hinges in a row, and a hand behind them; joints as name, kind, parent and mimic."""
    joints = [*ARM, *hand]
    parts = ['<robot name="arm"><link name="base"/>']
    for k, (name, kind, parent, mimic) in enumerate(joints):
        parts.append(
            f'<link name="l{k}"><inertial><mass value="{1 if k < len(ARM) else 0.05}"/><origin xyz="0.1 0 0"/>'
            '<inertia ixx="1e-2" ixy="0" ixz="0" iyy="1e-2" iyz="0" izz="1e-2"/></inertial></link>'
            f'<joint name="{name}" type="{kind}"><parent link="{"base" if parent < 0 else f"l{parent}"}"/>'
            f'<child link="l{k}"/><origin xyz="0.2 0 0"/><axis xyz="0 1 0"/>{mimic}'
            f'<limit lower="-1" upper="1" velocity="2" effort="{effort if k < len(ARM) else of_hand}"/></joint>'
        )
    path = folder / "arm.urdf"
    path.write_text("".join(parts) + "</robot>")
    return load_robot(path)


@pytest.mark.parametrize("hand", HANDS)
def test_payload_and_tool_are_before_the_fingers(tmp_path: Path, hand: str) -> None:
    robot = arm(tmp_path, HANDS[hand])
    assert tool_of(robot.body).name == robot.body.tree()[robot.body.last].name == "a3"
    fingers = ", ".join(robot.joints[4:])
    assert f"payload and default --tool are at a3, before the fingers {fingers}" in robot.warnings


@pytest.mark.parametrize("end", NO_HANDS)
def test_other_ends_are_no_fingers(tmp_path: Path, end: str) -> None:
    joints, last = NO_HANDS[end]
    robot = arm(tmp_path, joints)
    assert tool_of(robot.body).name == last and not any(robot.body.fingers)
    assert any(f"default --tool are at {last}" in w for w in robot.warnings) == (last != robot.joints[-1])


def test_a_gripper_does_not_measure_the_arm(tmp_path: Path) -> None:
    """The slides of a Piper as shipped have 100 N as its hinges have 100 N m, and more than doubled its standby."""
    hand = HANDS["two slides"]
    alone, with_hand = (arm(tmp_path, joints, effort=70, of_hand=30) for joints in ([], hand))
    assert with_hand.rated.power == pytest.approx(alone.rated.power) and with_hand.rated.strongest == 70
    placeholder = arm(tmp_path, hand, effort=500, of_hand=500)
    said = [w for w in placeholder.warnings if "the same on all joints" in w]
    assert [w.split(":")[0] for w in said] == list(placeholder.joints) and "500 N," in said[-1]
    assert not any(map(np.isfinite, placeholder.limits.effort))


@pytest.mark.parametrize("grip", [0.3, 0.4])
def test_fingers_hold_their_part_on_the_way(tmp_path: Path, grip: float) -> None:
    """Without friction a swing of the finger by 0.6 rad and back saved 0.05 J."""
    robot, start, goal = arm(tmp_path, HANDS["knuckles"]), [0, 0.2, 0.3, 0, 0.3], [0.8, -0.2, -0.3, 0.5, grip]
    held = energy_opt.optimize(robot, source_method_2(robot), start=start, goal=goal, duration=1.0, seed=1)
    travel = float(np.ptp(held.trajectory.position[:, 4]))
    assert travel >= 0.1 if grip > 0.3 else travel <= 1e-4
    assert held.saving is not None and held.saving.joules > 0


def test_a_branch_without_a_task_stays() -> None:
    """Two arms on a torso: each plans alone, and the joints of the other one stay."""
    parents = {"torso": -1, "l1": 0, "l2": 1, "l3": 2, "r1": 0, "r2": 4, "r3": 5, "r4": 6}
    links = [
        Link(name, False, False, parent, np.eye(4), np.eye(3)[0], 1.0, np.zeros(3), np.eye(3), 0.0)
        for name, parent in parents.items()
    ]
    names = np.array(list(parents))

    def staying(*moving: str) -> set[str]:
        return set(names[idle(links, Coupling.of(links), np.isin(names, moving))])

    assert staying("l1") == {"r1", "r2", "r3", "r4"} and staying("l1", "r4") == set()
    assert staying("r2", "torso") == staying("torso") == staying() == {"l1", "l2", "l3"}
