"""Robots: names, joints, limits and what is said about doubtful ones."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml
from two_joints import two_joints

from energy_opt.errors import BadInput
from energy_opt.power.assumptions import default_assumptions
from energy_opt.robot import known_robots, load_robot

UR_JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
SHARED = Path(__file__).resolve().parents[3] / "shared/data/ur_e_series"


@pytest.mark.parametrize("name", known_robots())
def test_every_named_robot_loads_with_usable_limits(name: str) -> None:
    robot = load_robot(name)
    limits = robot.limits
    assert robot.name == name and robot.n == len(robot.joints) in (6, 7)
    assert (limits.lower < limits.upper).all()
    assert (limits.velocity > 0).all() and np.isfinite(limits.velocity).all()
    assert (limits.effort > 0).all() and np.isfinite(limits.effort).all()
    assert not any("finger" in joint.lower() or "gripper" in joint.lower() for joint in robot.joints)
    assert (np.isfinite(limits.lower) != robot.body.continuous).all()


def test_names() -> None:
    assert set(known_robots()) == {"panda", "ur3", "ur5", "ur10", "kinova", "xarm7", "z1", "ur3e", "ur5e", "ur10e"}


def test_panda_has_the_published_limits() -> None:
    limits = load_robot("panda").limits
    np.testing.assert_array_equal(limits.velocity, [2.175] * 4 + [2.61] * 3)
    np.testing.assert_array_equal(limits.acceleration, [15, 7.5, 10, 12.5, 15, 20, 20])
    np.testing.assert_array_equal(limits.jerk, [7500, 3750, 5000, 6250, 7500, 10000, 10000])
    np.testing.assert_array_equal(limits.effort, [87] * 4 + [12] * 3)
    assert limits.upper[3] == pytest.approx(-0.0698)


@pytest.mark.parametrize(
    ("name", "effort"),
    [
        ("ur3", [56, 56, 28, 12, 12, 12]),
        ("ur5", [150, 150, 150, 28, 28, 28]),
        ("ur10", [330, 330, 150, 56, 56, 56]),
        ("ur3e", [54, 54, 28, 9, 9, 9]),
        ("ur5e", [150, 150, 150, 28, 28, 28]),
        ("ur10e", [330, 330, 150, 54, 54, 54]),
    ],
)
def test_universal_robots_efforts(name: str, effort: list[float]) -> None:
    robot = load_robot(name)
    assert robot.joints == UR_JOINTS
    np.testing.assert_array_equal(robot.limits.effort, effort)


# Masses, and the tool with all joints at 0 by Denavit-Hartenberg parameters: (a2 + a3, d4 + d6, d1 - d5) in base_link.
@pytest.mark.parametrize(
    ("name", "mass", "tool"),
    [
        (
            "ur3e",
            1.98 + 3.4445 + 1.437 + 0.871 + 0.805 + 0.261,
            (0.24355 + 0.2132, 0.13105 + 0.0921, 0.15185 - 0.08535),
        ),
        ("ur5e", 3.761 + 8.058 + 2.846 + 1.37 + 1.3 + 0.365, (0.425 + 0.3922, 0.1333 + 0.0996, 0.1625 - 0.0997)),
        ("ur10e", 7.369 + 13.051 + 3.989 + 2.1 + 1.98 + 0.615, (0.6127 + 0.57155, 0.17415 + 0.11655, 0.1807 - 0.11985)),
    ],
)
def test_e_series_mass_and_geometry(name: str, mass: float, tool: tuple[float, float, float]) -> None:
    robot = load_robot(name)
    assert sum(link.mass for link in robot.body.tree()) == pytest.approx(mass, rel=1e-12)
    model = pin.buildModelFromUrdf(str(robot.urdf))
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    np.testing.assert_allclose(data.oMf[model.getFrameId("tool0")].translation, tool, atol=1e-12)
    rest = np.zeros(robot.n)
    tau = robot.body.torque(np.array([0.4, -1.1, 0.7, 0.2, 1.3, -0.6]), rest, rest)[0]
    assert abs(tau[0]) < 1e-9 < abs(tau[1])  # gravity never loads the upright axis


@pytest.mark.skipif(not SHARED.is_dir(), reason="the published parameter files are not here")
@pytest.mark.parametrize("name", ["ur3e", "ur5e", "ur10e"])
def test_e_series_urdf_holds_the_published_numbers(name: str) -> None:
    class Loader(yaml.SafeLoader):
        """YAML with the tag !degrees."""

    Loader.add_constructor("!degrees", lambda loader, node: math.radians(float(loader.construct_scalar(node))))
    folder = SHARED / name
    kinematics = yaml.load((folder / "default_kinematics.yaml").read_text(), Loader)["kinematics"]
    physical = yaml.load((folder / "physical_parameters.yaml").read_text(), Loader)["inertia_parameters"]
    limits = yaml.load((folder / "joint_limits.yaml").read_text(), Loader)["joint_limits"]
    root = ET.parse(load_robot(name).urdf).getroot()
    joints = {joint.get("name"): joint for joint in root.iter("joint")}
    links = {link.get("name"): link for link in root.iter("link")}

    def numbers(element: ET.Element, key: str) -> list[float]:
        return [float(x) for x in (element.get(key) or "").split()]

    parts = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
    for joint_name, part in zip(UR_JOINTS, parts, strict=True):
        joint, stated = joints[joint_name], limits[joint_name]
        origin, limit = joint.find("origin"), joint.find("limit")
        assert numbers(origin, "xyz") == pytest.approx([kinematics[part][k] for k in "xyz"], abs=1e-9)
        assert numbers(origin, "rpy") == pytest.approx(
            [kinematics[part][k] for k in ("roll", "pitch", "yaw")], abs=1e-6
        )
        assert float(limit.get("effort")) == stated["max_effort"]
        assert float(limit.get("velocity")) == pytest.approx(stated["max_velocity"], rel=1e-15)
        assert joint.get("type") == ("revolute" if stated["has_position_limits"] else "continuous")
        if stated["has_position_limits"]:
            assert float(limit.get("upper")) == pytest.approx(stated["max_position"], rel=1e-15)
        inertial = links[f"{part}_link"].find("inertial")
        assert float(inertial.find("mass").get("value")) == physical[f"{part}_mass"]
        centre, turn = physical["center_of_mass"][f"{part}_cog"], physical["rotation"][part]
        assert numbers(inertial.find("origin"), "xyz") == [centre[k] for k in "xyz"]
        assert numbers(inertial.find("origin"), "rpy") == pytest.approx([turn[k] for k in ("roll", "pitch", "yaw")])
        assert {k: float(v) for k, v in inertial.find("inertia").attrib.items()} == physical["tensor"][part]


def test_limits_file_overrides_by_name(tmp_path: Path) -> None:
    path = tmp_path / "joint_limits.yaml"
    path.write_text(
        "joint_limits:\n"
        "  second:\n    has_velocity_limits: true\n    max_velocity: 0.25\n    max_jerk: 40\n"
        "  first:\n    has_effort_limits: false\n    has_position_limits: true\n"
        "    min_position: !degrees -30\n    max_position: 0.5\n"
        "  elsewhere:\n    max_velocity: 9\n"
    )
    robot = load_robot(two_joints(tmp_path), limits=path)
    np.testing.assert_array_equal(robot.limits.velocity, [2, 0.25])
    np.testing.assert_allclose(robot.limits.jerk, [100 * 5 * 2, 40])  # the first as assumed
    assert robot.limits.effort[0] == np.inf
    np.testing.assert_allclose(robot.limits.lower, [-math.pi / 6, -1])
    np.testing.assert_allclose(robot.limits.upper, [0.5, 1])


def test_every_key_of_a_limits_file_counts(tmp_path: Path) -> None:
    """Factors, sizes for both directions, braking, soft ranges; where ROS parameters have the table; under a prefix."""
    path = tmp_path / "joint_limits.yaml"
    path.write_text(
        "/**:\n  ros__parameters:\n    robot_description_planning:\n"
        "      default_velocity_scaling_factor: 0.5\n      default_acceleration_scaling_factor: 0.1\n"
        "      cartesian_limits: {max_trans_vel: 1.0}\n      joint_limits:\n"
        "        l_first: {max_velocity: 1.5, min_velocity: -1.0, max_acceleration: 20, max_deceleration: -8,\n"
        "          angle_wraparound: false, has_soft_limits: true, soft_lower_limit: -0.5, soft_upper_limit: 4,\n"
        "          k_position: 10.0, k_velocity: 3.0}\n"
        "        l_second: {has_velocity_limits: false, max_velocity: 0, has_acceleration_limits: true,\n"
        "          max_acceleration: 30, has_jerk_limits: false, max_jerk: 3}\n"
    )
    robot = load_robot(two_joints(tmp_path), limits=path, prefix="l_")
    stated = load_robot(two_joints(tmp_path)).limits
    np.testing.assert_allclose(robot.limits.velocity, [0.5, np.pi / 2])  # no limit at all: the assumed one, scaled
    np.testing.assert_allclose(robot.limits.acceleration, [0.8, 3.0])
    np.testing.assert_allclose(robot.limits.lower, [-0.5, stated.lower[1]])
    np.testing.assert_allclose(robot.limits.upper, stated.upper)
    np.testing.assert_allclose(robot.limits.jerk, [80, 300])  # none is given
    assert sum("scaling_factor" in w for w in robot.warnings) == 2


def test_a_limit_that_a_file_removes_is_assumed_with_a_warning(tmp_path: Path) -> None:
    """An acceleration above the published one came without a word; a velocity was called `limit inf rad/s`."""
    path = tmp_path / "limits.yaml"
    path.write_text("joint_limits: {panda_joint1: {has_velocity_limits: false, has_acceleration_limits: false}}\n")
    said = load_robot("panda", limits=path).warnings
    assert "panda_joint1: no velocity limit; assumed: 3.142 rad/s" in said
    assert "panda_joint1: limits.yaml removes the limit on acceleration; an assumed one replaces it" in said


def test_factors_of_a_limits_file_also_scale_assumed_limits(tmp_path: Path) -> None:
    """A URDF has no accelerations: a factor that leaves the assumed ones as they are would slow nothing."""
    path, urdf = tmp_path / "joint_limits.yaml", two_joints(tmp_path, velocity="1e4")  # a placeholder stays one
    path.write_text("joint_limits: {second: {max_velocity: 0.8}}\n")
    whole = load_robot(urdf, limits=path)
    factors = "default_velocity_scaling_factor: 0.5\ndefault_acceleration_scaling_factor: 0.1\n"
    path.write_text(path.read_text() + factors)
    slowed = load_robot(urdf, limits=path)
    np.testing.assert_allclose(slowed.limits.velocity, 0.5 * whole.limits.velocity)
    np.testing.assert_allclose(slowed.limits.acceleration, 0.1 * whole.limits.acceleration)
    np.testing.assert_allclose(slowed.limits.jerk, 0.1 * whole.limits.jerk)
    assert slowed.sources == whole.sources
    np.testing.assert_array_equal(slowed.rated.velocity, whole.rated.velocity)  # a slowed arm has the same motors


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("velocity: 3\n", "no joint_limits table"),
        ("joint_limits:\n  other: {max_velocity: 1}\n", "the robot's joints are first, second"),
        ("joint_limits:\n  first: {max_velocity: -1}\n", "max_velocity = -1; expected 1e-06 or more"),
        ("joint_limits:\n  first: {max_velocity: fast}\n", "max_velocity = 'fast'; expected a number"),
        ("joint_limits:\n  first: {has_velocity_limits: true}\n", "max_velocity is missing"),
        ("joint_limits:\n  first: {min_position: 1, max_position: 0}\n", "not below"),
        ("joint_limits:\n  first: {max_velocty: 1}\n", "unknown key 'max_velocty'; did you mean 'max_velocity'"),
        (
            "joint_limits:\n  first: {has_velocity_limits: 'false', max_velocity: 1}\n",
            "expected true or false, without quotes",
        ),
        ("joint_limits:\n  first: {has_jerk_limits: 0}\n", "= 0; expected true or false"),
        ("joint_limits:\n  frist: {max_velocity: 1}\n  second: {max_velocity: 1}\n", "did you mean 'first'"),
        ("joint_limits:\n  l_first: {max_velocity: 1}\n", "they fit with .* 'l_'"),
        (
            "default_velocity_scaling_factor: 1.5\njoint_limits:\n  first: {max_velocity: 1}\n",
            "= 1.5; expected 1 or less",
        ),
        ("default_velocity_scaling: 1\njoint_limits:\n  first: {max_velocity: 1}\n", "unknown key 'default_vel"),
        ("joint_limits:\n  first: {max_velocity: " + "9" * 400 + "}\n", "expected a number"),
        ("joint_limits:\n  first: {min_velocity: 1, max_velocity: 1}\n", "min_velocity = 1; expected -1e-06 or less"),
        ("joint_limits:\n  first: {has_deceleration_limits: true}\n", "max_deceleration is missing"),
        ("joint_limits: [\n", "not valid YAML"),
    ],
)
def test_faulty_limits_files(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "joint_limits.yaml"
    path.write_text(text)
    with pytest.raises(BadInput, match=says):
        load_robot(two_joints(tmp_path), limits=path)


def test_locked_joints_take_no_part(tmp_path: Path) -> None:
    """A locked joint leaves the arm of the remaining ones, at the locked angle."""
    path = two_joints(tmp_path)
    whole, part = load_robot(path).body, load_robot(path, lock={"second": 0.4})
    assert part.joints == ("first",) and part.locked == {"second": 0.4}
    q, v, a = np.array([0.3]), np.array([-0.7]), np.array([1.1])
    expected = whole.torque(np.array([0.3, 0.4]), np.array([-0.7, 0]), np.array([1.1, 0]))[0, 0]
    assert part.body.torque(q, v, a)[0, 0] == pytest.approx(expected, rel=1e-12)


def test_bad_robots_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="nor the name of a robot"):
        load_robot("r2d2")
    with pytest.raises(BadInput, match="cannot lock 'third'"):
        load_robot(two_joints(tmp_path), lock={"third": 0.0})
    with pytest.raises(BadInput, match=r"lock second=1.5: outside its limits \[-1, 1\] rad"):
        load_robot(two_joints(tmp_path), lock={"second": 1.5})
    with pytest.raises(BadInput, match="no joint is left"):
        load_robot(two_joints(tmp_path), lock={"first": 0.0, "second": 0.0})
    broken = tmp_path / "broken.urdf"
    broken.write_text("<robot name='x'><link")
    with pytest.raises(BadInput, match="not XML; expected a URDF"):
        load_robot(str(broken))


def test_energy_is_the_integral_of_power() -> None:
    """d/dt (kinetic + potential) = tau . v along a motion, so stored energy and torque tell the same story."""
    body = load_robot("xarm7").body
    rng = np.random.default_rng(5)
    amplitude, rate = rng.normal(size=(2, body.n))
    t = np.linspace(0.0, 1.0, 2001)[:, None]
    q, v, a = amplitude * np.sin(rate * t), amplitude * rate * np.cos(rate * t), -amplitude * rate**2 * np.sin(rate * t)
    power = np.sum(body.torque(q, v, a) * v, axis=1)
    work = np.sum((power[1:] + power[:-1]) / 2 * np.diff(t[:, 0]))
    stored = body.energy(q[[0, -1]], v[[0, -1]])
    assert work == pytest.approx(stored[1] - stored[0], rel=1e-5)


GRIPPER = """
<robot name="gripper">
  <link name="base"/>
  <link name="hand"><inertial><mass value="1"/><origin xyz="0.1 0 0"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="left"><inertial><mass value="0.2"/>
    <inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="right"><inertial><mass value="0.2"/>
    <inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="lift" type="prismatic"><parent link="base"/><child link="hand"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0.8" velocity="0.5" effort="100"/></joint>
  <joint name="finger" type="prismatic"><parent link="hand"/><child link="left"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.04" velocity="0.5" effort="20"/></joint>
  <joint name="other" type="prismatic"><parent link="hand"/><child link="right"/><axis xyz="0 1 0"/>
    <limit lower="-0.1" upper="0.1" velocity="0.5" effort="20"/>
    <mimic joint="finger" multiplier="-2" offset="0.01"/></joint>
</robot>
"""


def test_mimic_joints_follow_and_sliding_ones_show_metres(tmp_path: Path) -> None:
    path = tmp_path / "gripper.urdf"
    path.write_text(GRIPPER)
    robot = load_robot(path, lock={"finger": 0.03})
    assert robot.joints == ("lift",) and robot.locked == {"finger": 0.03, "other": pytest.approx(-0.05)}
    assert robot.units == ("m",) and load_robot("panda").units == ("rad",) * 7
    assert load_robot(path).joints == ("lift", "finger")
    path.write_text(GRIPPER.replace('joint="finger" ', ""))
    with pytest.raises(BadInput, match="expected the name of another joint"):
        load_robot(path, lock={"finger": 0.03})


def test_joints_that_slide_show_metres_and_newtons(tmp_path, capsys):
    """On stdout, in warnings and on the page; and a long way along a rail is not taken for degrees."""
    from energy_opt.cli.main import main

    urdf = tmp_path / "rail.urdf"
    link = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    urdf.write_text(
        f"""<robot name="rail"><link name="base"/><link name="a">{link}</link><link name="b">{link}</link>
        <joint name="turn" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/>
        <limit lower="-3" upper="3" velocity="1" effort="1000"/></joint>
        <joint name="rail" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="1 0 0"/>
        <limit lower="0" upper="60" velocity="0" effort="0"/></joint></robot>"""
    )
    robot = load_robot(str(urdf))
    assert (
        robot.units == ("rad", "m") and robot.unit("effort", "rail") == "N" and robot.unit("jerk", "turn") == "rad/s^3"
    )
    assert "rail: no velocity limit; assumed: 3.142 m/s" in robot.warnings
    notes = {row.joint: row.note for row in default_assumptions(robot) if row.what == "acceleration"}
    assert notes["rail"].endswith("50 m/s²") and notes["turn"].endswith("50 rad/s²")
    assert "rail: no effort limit; assumed: none" in robot.warnings
    words = ["optimize", "--robot", str(urdf), "--start", "0,30", "--goal", "0,58", "--mode", "retime", "--compile",
             "never", "--out", str(tmp_path / "out")]  # fmt: skip
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "all limits kept; tightest: rail " in said and "rad" not in said
