"""Placeholders and implausible numbers of a URDF: limits, efforts, masses and inertias are named or replaced."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from two_joints import two_joints

from energy_opt.errors import BadInput
from energy_opt.robot import known_robots, load_robot


def test_implausible_and_placeholder_inertias_are_named() -> None:
    assert [w.split(":")[0] for w in load_robot("ur5").warnings] == ["wrist_1_joint", "wrist_2_joint", "wrist_3_joint"]
    for name in ("panda", "ur3e", "ur5e", "ur10e"):
        assert load_robot(name).warnings == ()


def test_placeholder_limits_are_replaced_and_named(tmp_path: Path) -> None:
    robot = load_robot(two_joints(tmp_path, effort="0", velocity="1e9"))
    assert robot.limits.effort[0] == np.inf and robot.limits.velocity[0] == pytest.approx(np.pi)
    np.testing.assert_allclose(robot.limits.acceleration, [5 * np.pi, 5])
    first = [w for w in robot.warnings if w.startswith("first:")]
    assert len(first) == 2 and all("assumed" in w for w in first)
    assert not any(w.startswith("second:") for w in robot.warnings)


def test_doubtful_limits_are_named_and_kept(tmp_path: Path) -> None:
    """A limit far beyond what such an arm could use is said to be doubtful, but nobody's number is overruled."""
    robot = load_robot(two_joints(tmp_path, effort="5000", velocity="1000"))
    assert robot.limits.effort[0] == 5000 and robot.limits.velocity[0] == 1000
    assert [w.startswith("first:") and "as stated" in w for w in robot.warnings] == [True, True]


def test_massless_last_link_is_named(tmp_path: Path) -> None:
    robot = load_robot(two_joints(tmp_path, mass="0", inertia="0"))
    assert any(w.startswith("second:") and "no mass" in w for w in robot.warnings)


def test_effort_limits_of_ten_thousand_newton_metres_are_a_large_arms_own(tmp_path: Path) -> None:
    path = two_joints(tmp_path, effort="17880", mass="900", inertia="30")
    robot = load_robot(path)
    assert robot.limits.effort[0] == 17880 and not any("effort limit 17880" in w for w in robot.warnings)


def test_the_same_effort_on_all_joints_and_far_above_gravity_is_a_placeholder(tmp_path: Path) -> None:
    text = Path(two_joints(tmp_path, effort="2000")).read_text()
    path = tmp_path / "same.urdf"
    path.write_text(re.sub(r'effort="[0-9.]+"', 'effort="2000"', text))
    robot = load_robot(path)
    assert np.isinf(robot.limits.effort).all()
    said = [w for w in robot.warnings if "the same on all joints and" in w]
    assert len(said) == 2 and all("limits with max_effort" in w for w in said)


def chain(path: Path, *efforts: str) -> str:
    """A URDF of links of 0.3 kg and 0.2 m in a row; each hinge is level, with the given effort limit [N m]."""
    parts = ['<robot name="chain"><link name="l0"/>']
    for k, effort in enumerate(efforts):
        limit = f'<limit lower="-1" upper="1" velocity="3" {effort}/>'
        parts.append(
            f'<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
            f'<origin xyz="{0.2 if k else 0} 0 0"/><axis xyz="0 1 0"/>{limit}</joint><link name="l{k + 1}"><inertial>'
            '<mass value="0.3"/><origin xyz="0.1 0 0"/>'
            '<inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial></link>'
        )
    path.write_text("".join(parts) + "</robot>")
    return str(path)


def test_one_effort_for_a_whole_arm_and_far_above_gravity_is_a_placeholder(tmp_path: Path) -> None:
    """Out straight this arm takes 0.3 * 9.81 * (0.1 + 0.3 + 0.5 + 0.7) = 4.7 N m; a Piper as shipped has 11 times."""
    equal = load_robot(chain(tmp_path / "equal.urdf", *4 * ['effort="52"']))
    assert np.isinf(equal.limits.effort).all()
    assert equal.rated.effort.max() < 20, "friction and electrical values follow the arm's own weight"
    with_wheel = load_robot(chain(tmp_path / "wheel.urdf", *4 * ['effort="75"'], 'effort="0"'))
    assert np.isinf(with_wheel.limits.effort).all(), "a joint without a limit does not make the others' credible"
    for name, efforts in {"strong": 4 * ['effort="25"'], "own": [*3 * ['effort="52"'], 'effort="20"']}.items():
        assert np.isfinite(load_robot(chain(tmp_path / f"{name}.urdf", *efforts)).limits.effort).all()


def test_an_effort_that_cannot_hold_the_arm_is_a_placeholder_unless_a_limits_file_says_so(tmp_path: Path) -> None:
    path = two_joints(tmp_path, effort="0.1")
    Path(path).write_text(Path(path).read_text().replace('axis xyz="0 0 1"', 'axis xyz="0 1 0"'))
    robot = load_robot(path)
    assert np.isinf(robot.limits.effort[0])
    (said,) = [w for w in robot.warnings if "does not hold the arm" in w]
    assert said.startswith("first: effort limit 0.1 N m") and "limits with max_effort" in said
    limits = tmp_path / "joint_limits.yaml"
    limits.write_text("joint_limits: {first: {max_effort: 0.2}}\n")
    assert load_robot(path, limits=limits).limits.effort[0] == 0.2


def test_one_effort_for_all_joints_that_is_too_little_for_some_is_a_placeholder(tmp_path: Path) -> None:
    """A Denso as shipped has 1 N m on all joints: what turns about the vertical needs nothing to be held."""
    text = Path(two_joints(tmp_path)).read_text().replace('axis xyz="0 0 1"', 'axis xyz="0 1 0"')
    assert "0 1 0" in text
    path = tmp_path / "same.urdf"
    path.write_text(re.sub(r'effort="[0-9.]+"', 'effort="1"', text))
    found = load_robot(path)
    gravity = found.body.torque(*(np.zeros((1, 2)) + k for k in (0.7, 0, 0)))[0]
    assert (np.abs(gravity) > 1).tolist() == [True, False], "one joint is held, one is not"
    assert np.isinf(found.limits.effort).all()
    assert any(w.startswith("second:") and "too little for some" in w for w in found.warnings)


def test_one_effort_for_slides_and_hinges_that_is_too_little_for_a_slide_is_a_placeholder(tmp_path: Path) -> None:
    """A SCARA as shipped has 1 on all joints: the vertical hinges need nothing to be held, its slide carries 20 N."""
    text = re.sub(r'effort="[0-9.]+"', 'effort="1"', Path(two_joints(tmp_path)).read_text())
    upright = re.sub(r'<axis xyz="[^"]*"/>', '<axis xyz="0 0 1"/>', text)
    path = tmp_path / "scara.urdf"
    path.write_text(upright.replace('name="second" type="revolute"', 'name="second" type="prismatic"'))
    robot = load_robot(path)
    assert robot.slides == (False, True) and np.isinf(robot.limits.effort).all()
    assert any(w.startswith("first: effort limit 1 N m, the same") for w in robot.warnings)


def test_an_arm_that_is_too_heavy_for_its_size_or_drives_is_named(tmp_path: Path) -> None:
    heavy = load_robot(two_joints(tmp_path, effort="50", mass="3300", inertia="100"))
    assert any("more than every effort limit" in w for w in heavy.warnings)
    assert any("several times the mass of such arms" in w for w in heavy.warnings)
    assert not any("kg move" in w for name in known_robots() for w in load_robot(name).warnings)


def test_the_travel_of_a_gantry_counts_as_its_size(tmp_path: Path) -> None:
    """All origins of its joints may coincide; 35 kg on "an arm of 0 m" is no doubtful mass then."""
    text = Path(two_joints(tmp_path, effort="900", mass="17")).read_text()
    together = re.sub(r'<origin xyz="[^"]*"', '<origin xyz="0 0 0"', text)
    path = tmp_path / "gantry.urdf"
    path.write_text(together.replace('type="revolute"', 'type="prismatic"'))
    assert not any("several times the mass" in w for w in load_robot(path).warnings)
    path.write_text(together)
    assert any("several times the mass" in w for w in load_robot(path).warnings)


def test_an_arm_that_is_too_light_for_its_size_is_named(tmp_path: Path) -> None:
    """A public description of an arm for 120 kg of load and 2.5 m long has 12 kg of moving links in all."""
    said = {}
    for mass in ("5", "200"):
        path = Path(two_joints(tmp_path, effort="5000", mass=mass, inertia="1"))
        path.write_text(path.read_text().replace('origin xyz="0.3 0 0"', 'origin xyz="2.5 0 0"'))
        said[mass] = [w for w in load_robot(path).warnings if "kg move" in w]
    assert said["5"] == [
        "6 kg move on an arm of 2.5 m: a fraction of the mass of such arms; energies are too low; used unchanged"
    ]
    assert said["200"] == []
    branch = path.read_text().replace("2.5 0 0", "0.9 0 0").replace('mass value="200"', 'mass value="5"')
    limit = re.search(r"<limit[^>]*>", branch)
    mass = re.search(r"<inertial>.*?</inertial>", branch, re.DOTALL)
    assert limit and mass
    for k in range(3):  # arms side by side are not one long arm
        branch = branch.replace(
            "</robot>",
            f"""<link name="o{k}">{mass[0]}</link><joint name="p{k}" type="revolute">
            <parent link="one"/><child link="o{k}"/><origin xyz="0 0.9 0"/><axis xyz="0 0 1"/>{limit[0]}</joint>
            </robot>""",
        )
    (tmp_path / "branches.urdf").write_text(branch)
    assert not [w for w in load_robot(tmp_path / "branches.urdf").warnings if "kg move" in w]
    path.write_text(re.sub(r'mass value="[0-9.]+"', 'mass value="0.001"', path.read_text()))
    assert (
        "all that moves weighs 2 g; are the masses in kg?" in load_robot(path).warnings
    )  # without the robot's name, which is printed before


def test_an_arm_in_millimetres_is_refused(tmp_path: Path) -> None:
    path = Path(two_joints(tmp_path))
    path.write_text(path.read_text().replace('origin xyz="0.3 0 0"', 'origin xyz="300 0 0"'))
    with pytest.raises(
        BadInput, match=r"two\.urdf: from joint to joint the arm is 300 m long; is the unit mm\? Expected m"
    ):
        load_robot(path)


def test_a_long_link_without_mass_is_named_also_inside_the_arm(tmp_path: Path) -> None:
    limit = '<limit lower="-3" upper="3" velocity="2" effort="80"/>'
    body = '<inertial><mass value="2"/><inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.005"/></inertial>'
    for offset, named in (
        ("0.3", ["j2"]),
        ("0", []),
    ):  # links between intersecting axes often have no body of their own
        joints = "".join(
            f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="0 0 {z}"/><axis xyz="{axis}"/>{limit}</joint>'
            for name, parent, child, z, axis in (
                ("j1", "base", "a", "0", "0 0 1"), ("j2", "a", "b", "0.3", "0 1 0"), ("j3", "b", "c", offset, "1 0 0"),
            )
        )  # fmt: skip
        links = f'<link name="base"/><link name="a">{body}</link><link name="b"/><link name="c">{body}</link>'
        path = tmp_path / f"arm{offset}.urdf"
        path.write_text(f'<robot name="arm">{links}{joints}</robot>')
        assert [w.split(":")[0] for w in load_robot(path).warnings if "no mass" in w] == named


def test_an_absurd_limit_is_named_in_a_short_line(tmp_path: Path) -> None:
    robot = load_robot(two_joints(tmp_path, effort="1e300"))
    assert any("effort limit 1e+300 N m" in line for line in robot.warnings)
    assert all(len(line) < 200 for line in robot.warnings)


def test_the_end_that_counts_is_named_where_an_arm_branches(tmp_path: Path) -> None:
    """Two arms on one column: a payload is at one of them only, so the description says which."""

    def described(arms: dict[str, int]) -> Path:
        parts = ['<robot name="branched"><link name="base"/>']
        for side, joints in arms.items():
            for k in range(joints):
                parent = "base" if k == 0 else f"{side}_link{k - 1}"
                parts.append(
                    f"""<link name="{side}_link{k}"><inertial><mass value="2"/><origin xyz="0.1 0 0"/>
                    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
                    <joint name="{side}{k}" type="revolute"><parent link="{parent}"/><child link="{side}_link{k}"/>
                    <origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>
                    <limit lower="-2" upper="2" velocity="2" effort="80"/></joint>"""
                )
        path = tmp_path / "branched.urdf"
        path.write_text("".join(parts) + "</robot>")
        return path

    def said(path: Path, lock: dict[str, float] | None = None) -> list[str]:
        return [w for w in load_robot(path, lock=lock).warnings if "branches end" in w]

    both = described({"left": 4, "right": 4})
    line = "branches end at {}, {}: payload and default --tool are at {}; --lock the joints of this branch"
    (found,) = said(both)
    used, other = ("left", "right") if "are at left3" in found else ("right", "left")
    assert found.startswith(line.format(f"{used}3", f"{other}3", f"{used}3"))
    assert said(both, {f"{used}{k}": 0.0 for k in range(4)}) == []
    assert said(described({"arm": 6, "finger": 1})) == []
    assert said(described({"arm": 6})) == []
