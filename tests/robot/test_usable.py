"""`check URDF`: the robot is loaded as a plan loads it, meshes and all, and held under gravity."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from test_description import ball, chain
from two_joints import two_joints

from energy_opt.cli.main import main
from energy_opt.errors import BadInput
from energy_opt.robot import load_robot


def checked(path: Path, capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, list[str], list[str]]:
    code = main(["check", str(path), "--json", "--quiet", *words])
    (file,) = json.loads(capsys.readouterr().out)["files"]
    return code, file["faults"], file["remarks"]


def test_a_posture_is_held(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two links of 1.5 kg that end at their joints, 0.3 m apart: the first joint holds the second's weight."""
    path = chain(tmp_path, ball("0.05"), ball("0.05"), ball("0.05"))
    code, faults, remarks = checked(path, capsys)
    assert code == 0 and not faults and remarks[0] == "2 joints; 3 kg move; 3 collision bodies, 1 pairs kept apart"
    assert remarks[1] == "held under gravity at 0,0: j1 is loaded most, by 4.41 N m (2.2 % of its limit)"
    assert f"by {1.5 * 9.81 * 0.3:.3g} N m" in remarks[1]


def test_what_a_plan_would_stumble_over_is_found_before(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = '<collision><geometry><mesh filename="package://arm/meshes/a.stl"/></geometry></collision>'
    path = chain(tmp_path, ball("0.05"), mesh)
    assert checked(path, capsys)[0] == 2
    assert checked(path, capsys, "--self-collision", "off")[0] == 0
    path = chain(tmp_path, ball("0.05"), ball("0.05"), ball("0.35"), ball("0.05"))
    code, faults, _ = checked(path, capsys)
    assert code == 0, faults  # balls of l0 and l2 always touch, and are not kept apart
    heavy = chain(tmp_path, ball("0.05"), ball("0.05"), ball("0.05"))
    limits = tmp_path / "joint_limits.yaml"
    limits.write_text("joint_limits: {j1: {max_effort: 1.0e-3}}\n")
    heavy.write_text(heavy.read_text().replace('lower="-2.5" upper="2.5"', 'lower="-0.2" upper="0.2"'))
    code, faults, _ = checked(heavy, capsys, "--limits", str(limits))
    assert code == 2 and "no posture of 100 is held under gravity" in faults[0] and "j1 needs 4." in faults[0]


def test_an_arm_without_bodies_is_usable_with_a_warning(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    code, faults, remarks = checked(chain(tmp_path, "", "", ""), capsys)
    assert code == 0, faults
    assert "0 collision bodies" in remarks[0] and any("no collision geometry" in line for line in remarks)


def test_ranges_that_no_plan_holds_are_named(tmp_path: Path) -> None:
    path = Path(two_joints(tmp_path))
    command = (
        '<command_interface name="{}"><param name="min">{}</param><param name="max">{}</param></command_interface>'
    )
    control = '<ros2_control name="a" type="system"><joint name="{}">{}</joint></ros2_control></robot>'
    ranges = command.format("position", -0.5, 2) + command.format("velocity", -1, 1)
    text = path.read_text().replace('"second" type="revolute"', '"second" type="continuous"')
    path.write_text(text.replace("</robot>", control.format("first", ranges)))
    said = [line.removesuffix(" are narrower than the limits and are not held; give --limits")
            for line in load_robot(path).warnings if line.endswith("are not held; give --limits")]  # fmt: skip
    assert said == [
        "first [-0.5, 2]: positions of <ros2_control>",
        "first [-1, 1]: velocities of <ros2_control>",
        "second [-1, 1]: lower and upper in <limit> of a continuous joint",
    ]
    path.write_text(path.read_text().replace('lower="-1" upper="1"', 'lower="-1e16" upper="1e16"'))
    assert not any("of a continuous joint" in line for line in load_robot(path).warnings)
    wide = command.format("position", -2, 3) + command.format("effort", -1, 1) + command.format("velocity", -2, "fast")
    path.write_text(path.read_text().replace(ranges, wide).replace("continuous", "revolute"))
    assert not any("are not held" in line for line in load_robot(path).warnings)


def test_links_that_are_only_seen_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A Doosan arm touched a floor with its flange, and the clearance was proven without a word."""
    seen = '<visual><geometry><sphere radius="0.05"/></geometry></visual>'
    path = chain(tmp_path, seen + ball("0.05"), seen, ball("0.05"), "", seen)
    said = "chain: links with a visual shape but no collision geometry are not checked: l1, l4; give them <collision>"
    assert any(remark.startswith(said) for remark in checked(path, capsys)[2])
    assert not any("visual" in remark for remark in checked(path, capsys, "--self-collision", "off")[2])


def test_an_arm_without_mass_is_refused_with_its_links(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = chain(tmp_path, ball("0.05"), ball("0.05"), ball("0.05"))
    path.write_text(path.read_text().replace('mass value="1.5"', 'mass value="0"'))
    code, faults, _ = checked(path, capsys)
    assert code == 2 and "none of the moving links has a mass: l1, l2;" in faults[0] and "<inertial>" in faults[0]
    path.write_text(path.read_text().replace('mass value="0"', 'mass value="0.02"'))
    code, _, remarks = checked(path, capsys)
    assert code == 0 and any("weighs 40 g" in remark for remark in remarks)


@pytest.mark.parametrize(
    ("before", "after", "refused"),
    [
        ('izz="0.02"', 'izz="0.041"', False),  # by 2.5 %
        ('izz="0.02"', 'izz="0.0465"', False),  # by 16 %, as on an xArm6
        ('izz="0.02"', 'izz="0.05"', True),
        ('izz="0.02"', 'izz="-0.02"', True),
        ('<mass value="1.5"/><inertia ixx="0.02"', '<mass value="0.16"/><inertia ixx="0.2"', False),  # it weighs grams
    ],
)
def test_inertias_of_no_body_are_refused_where_they_matter(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], before: str, after: str, refused: bool
) -> None:
    path = chain(tmp_path, ball("0.05"), ball("0.05"), ball("0.05"))
    head, _, tail = path.read_text().rpartition('<link name="l2">')
    path.write_text(head + '<link name="l2">' + tail.replace(before, after, 1))
    code, faults, remarks = checked(path, capsys)
    assert (code == 2) == refused, (faults, remarks)
    assert any("l2" in line and "inertia" in line for line in (faults or remarks))
    if refused:  # on a link that does not move against the one before it does not matter: both together are a body
        path.write_text(path.read_text().replace('"j2" type="revolute"', '"j2" type="fixed"'))
        assert checked(path, capsys)[0] == 0


def test_values_of_the_urdf_that_no_plan_uses_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = Path(two_joints(tmp_path))
    plain = path.read_text()
    soft = '<safety_controller soft_lower_limit="{}" soft_upper_limit="{}"/>'
    zero = '<dynamics damping="0.0" friction="0"/>' + soft.format(-1, 2) + "</joint>"
    path.write_text(plain.replace("</joint>", zero, 1))
    assert not any("<" in remark for remark in checked(path, capsys)[2])
    unused = '<dynamics damping="0.5"/>' + soft.format("${-eps}", 1.5) + "</joint>"
    path.write_text(plain.replace("</joint>", unused, 1))
    with_xacro = checked(path, capsys)
    assert with_xacro[0] == 2 and "xacro" in with_xacro[1][0]
    path.write_text(plain.replace("</joint>", unused.replace("${-eps}", "half"), 1))
    rubbing, narrower = (remark for remark in checked(path, capsys)[2] if "<" in remark)
    assert rubbing == "first: damping and friction of <dynamics> are not used; give --model with friction"
    assert narrower.startswith("first [-inf, 1.5]: soft limits") and narrower.endswith("give --limits")
    limits = tmp_path / "limits.yaml"
    limits.write_text("joint_limits: {first: {max_position: 1.5}}")
    assert len([remark for remark in checked(path, capsys, "--limits", str(limits))[2] if "<" in remark]) == 1


def test_friction_in_a_second_dynamics_element_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = Path(two_joints(tmp_path))
    twice = '<dynamics damping="0"/><dynamics friction="3"/></joint>'
    path.write_text(path.read_text().replace("</joint>", twice, 1))
    assert (
        "first: damping and friction of <dynamics> are not used; give --model with friction" in checked(path, capsys)[2]
    )


@pytest.mark.parametrize(
    ("motor", "named"),
    [
        ("<mechanicalReduction>100</mechanicalReduction>", True),
        ("<mechanicalReduction>1</mechanicalReduction>", False),
        ("<mechanical_reduction>-101</mechanical_reduction>", True),
        ("<motorInertia>1e-4</motorInertia>", True),
        ('<d:rotor_inertia xmlns:d="https://drake.mit.edu" value="2e-5"/>', True),
        ("<mechanicalReduction></mechanicalReduction>", False),
    ],
)
def test_a_transmission_that_no_plan_uses_is_named(tmp_path, capsys, motor: str, named: bool) -> None:
    path = Path(two_joints(tmp_path))
    text = f'<transmission name="t"><joint name="first"/><actuator name="m">{motor}</actuator></transmission></robot>'
    path.write_text(path.read_text().replace("</robot>", text))
    said = "first: reduction and rotor inertia of <transmission> are not used; give --model with armature"
    assert (said in checked(path, capsys)[2]) == named


def test_a_solid_link_without_mass_between_others_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = Path(two_joints(tmp_path)).read_text()
    first, _, rest = text.partition('<link name="one">')
    solid = '<collision><geometry><sphere radius="0.05"/></geometry></collision></link>'
    path = tmp_path / "massless.urdf"
    path.write_text(f'{first}<link name="one">{solid}{rest.partition("</link>")[2]}')
    assert "first: its link has no mass; assumed: massless" in checked(path, capsys)[2]


@pytest.mark.parametrize(
    ("kind", "bounds", "says"),
    [
        (
            "revolute",
            ("-143", "143"),
            "first: position limits [-143, 143] rad (are these degrees?); assumed: as stated",
        ),
        ("prismatic", ("-300", "0"), "first: position limits [-300, 0] m (are these mm?); assumed: as stated"),
        ("revolute", ("-6.4", "6.4"), None),
    ],
)
def test_limits_of_position_in_another_unit_are_named(tmp_path, capsys, kind, bounds, says) -> None:
    path = Path(two_joints(tmp_path))
    text = path.read_text().replace('type="revolute"', f'type="{kind}"', 1)
    path.write_text(text.replace('lower="-1" upper="2"', 'lower="{}" upper="{}"'.format(*bounds)))
    said = [remark for remark in checked(path, capsys)[2] if "position limits" in remark]
    assert said == ([] if says is None else [says])


def test_acceleration_and_jerk_of_a_newer_urdf_are_limits(tmp_path: Path) -> None:
    path = Path(two_joints(tmp_path))
    text = path.read_text().replace('velocity="2"', 'velocity="2" acceleration="3" deceleration="2.5" jerk="40"')
    path.write_text(text)
    robot = load_robot(path)
    assert (robot.limits.acceleration[0], robot.limits.jerk[0]) == (2.5, 40)
    assert (robot.sources["acceleration"], robot.sources["jerk"]) == (("urdf", "assumed"),) * 2
    path.write_text(text.replace('jerk="40"', 'jerk="-40"'))
    with pytest.raises(BadInput, match="jerk=-40 is negative"):
        load_robot(path)
