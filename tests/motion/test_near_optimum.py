"""Searches that once found nothing: near the least time, and beside bodies that lie within the hull of another."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import energy_opt as eo
from energy_opt.robot.catalog import CATALOG, urdf_of

QUICK = {"starts": 2, "compile": "never"}
PENDULUM = urdf_of(CATALOG["panda"]).parents[2] / "double_pendulum_description/urdf/double_pendulum_simple.urdf"


def test_a_free_duration_near_the_least_time_saves_against_the_fastest_timing() -> None:
    """Standby power asks for haste; the joint that is not the slowest still has time to spare."""
    answer = eo.optimize(str(PENDULUM), start=[0.0, 0.0], goal=[1.5, 0.4], **QUICK)
    slowed = answer.baseline("scaled")
    assert answer.status == "solved" and slowed.valid
    assert answer.trajectory.duration < 1.02 * answer.baseline("toppra").duration
    assert answer.saving["loss_percent"] > 3


# An arm of 0.8 m with the masses of a public description, several times those of the arm itself: mass [kg], its centre
# [m], moments [kg m^2]; origin [m], turn about x [rad] and effort limit [N m] of the joint before it.
HEAVY = [
    (15.1, "0 0.003 -0.002", "0.044 0.043 0.031", "0 0 0.12", 0.0, 2000),
    (42.9, "0.18 0 -0.143", "0.10 1.11 1.08", "0 0 0", 1.5708, 1500),
    (16.6, "0.155 0 -0.013", "0.021 0.28 0.28", "0.36 0 0", 0.0, 1500),
    (5.6, "0 -0.006 0.003", "0.009 0.005 0.009", "0.304 0 -0.115", 0.0, 1000),
    (6.3, "0 -0.003 -0.002", "0.013 0.006 0.013", "0 -0.1135 0", 1.5708, 1000),
    (1.4, "0 0 -0.021", "0.0007 0.0007 0.0011", "0 0.107 0", -1.5708, 1000),
]


def heavy_arm(folder: Path) -> eo.Robot:
    """Six joints; no accelerations are stated."""
    parts = ['<link name="l0"/>']
    for k, (mass, centre, moments, origin, turn, effort) in enumerate(HEAVY, start=1):
        xx, yy, zz = moments.split()
        inertia = f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/>'
        inertial = f'<inertial><origin xyz="{centre}"/><mass value="{mass}"/>{inertia}</inertial>'
        parts.append(f'<link name="l{k}">{inertial}</link><joint name="j{k}" type="revolute"><parent link="l{k - 1}"/>')
        parts.append(f'<child link="l{k}"/><origin xyz="{origin}" rpy="{turn} 0 0"/><axis xyz="0 0 1"/>')
        parts.append(f'<limit lower="-3" upper="4.6" velocity="3.14" effort="{effort}"/></joint>')
    (folder / "heavy.urdf").write_text("<robot name='heavy'>" + "\n".join(parts) + "</robot>")
    return eo.load_robot(folder / "heavy.urdf")


def ur5e(_: Path) -> eo.Robot:
    """By its name."""
    return eo.load_robot("ur5e")


def unpublished_panda(folder: Path) -> eo.Robot:
    """A Panda by its URDF alone, as an FR3 comes: accelerations and jerks are assumed."""
    return eo.load_robot(urdf_of(CATALOG["panda"]), lock={"panda_finger_joint1": 0.0})


@pytest.mark.parametrize(
    ("arm", "start", "goal", "payload"),
    [
        (heavy_arm, [0, 0.8, 0.5, 0.8, 0, 0], [1.0, 1.4, 1.2, 1.6, 0.7, -1], None),
        (
            lambda _: eo.load_robot("ur5e"),
            [0.78, -2.42, 0.6, -0.4, -2.4, 1.1],
            [-0.5, -1.2, 1.9, -1.9, -1.2, -0.9],
            None,
        ),
        (unpublished_panda, [0, -0.785, 0, -2.356, 0, 1.571, 0.785], [1.2, 0.3, 0.4, -1.2, -0.5, 2.2, -0.4], 1.0),
    ],
    ids=["heavy", "ur5e", "panda with 1 kg"],
)
def test_free_durations_do_not_stall_at_the_fastest_timing(arm, start, goal, payload, tmp_path: Path) -> None:
    """Without a bound on acceleration the search ended where it began, at the minimum-time timing of the line."""
    robot = arm(tmp_path)
    answer = eo.optimize(robot, "source-method-2", start=start, goal=goal, payload=payload, **QUICK)
    fastest = answer.baseline("toppra")
    assert answer.status == "solved" and answer.chosen == "reshape" and fastest.valid
    assert answer.energy.total < 0.999 * fastest.energy.total and answer.energy.loss < 0.95 * fastest.energy.loss
    assert np.abs(answer.trajectory.acceleration).max() <= 50


def in_a_gutter(folder: Path) -> Path:
    """An arm whose first link turns about the middle of a gutter: their hulls overlap, they are 4 cm apart."""
    wide, deep, thick, long = 0.1, 0.2, 0.02, 0.6  # half width, depth, thickness, half length
    profile = [(-wide, 0), (wide, 0), (wide, deep), (wide - thick, deep), (wide - thick, thick),
               (thick - wide, thick), (thick - wide, deep), (-wide, deep)]  # fmt: skip
    points = [(x, y, z) for y in (-long, long) for x, z in profile]
    n = len(profile)
    quads = [(k, (k + 1) % n, n + (k + 1) % n, n + k) for k in range(n)]
    caps = [(0, 1, 4, 5), (1, 2, 3, 4), (0, 5, 6, 7)]
    quads += caps + [tuple(n + k for k in reversed(face)) for face in caps]
    faces = [f"f {a + 1} {b + 1} {c + 1}\nf {a + 1} {c + 1} {d + 1}" for a, b, c, d in quads]
    (folder / "gutter.obj").write_text("\n".join([*(f"v {x} {y} {z}" for x, y, z in points), *faces]) + "\n")
    inertia = '<inertia ixx=".02" iyy=".02" izz=".02" ixy="0" ixz="0" iyz="0"/>'
    inertial = '<inertial><mass value="2"/><origin xyz="{}"/>' + inertia + "</inertial>"
    box = '<collision><origin xyz="{}"/><geometry><box size="{}"/></geometry></collision>'
    limit = '<limit lower="-2" upper="2" velocity="3" effort="60"/>'
    text = f"""<robot name="gutter">
      <link name="base"><collision><geometry><mesh filename="gutter.obj"/></geometry></collision></link>
      <link name="turret">{inertial.format("0 0 0.1")}</link>
      <link name="axle">{inertial.format("0 0 0")}{box.format("0 0 0", "0.06 0.4 0.06")}</link>
      <link name="beam">{inertial.format("0 0 0.4")}{box.format("0 0 0.5", "0.05 0.05 0.4")}</link>
      <joint name="lift" type="prismatic"><parent link="base"/><child link="turret"/><origin xyz="0 0 0"/>
        <axis xyz="0 1 0"/><limit lower="-0.1" upper="0.1" velocity="1" effort="200"/></joint>
      <joint name="roll" type="revolute"><parent link="turret"/><child link="axle"/><origin xyz="0 0 0.09"/>
        <axis xyz="0 1 0"/>{limit}</joint>
      <joint name="pitch" type="revolute"><parent link="axle"/><child link="beam"/><origin xyz="0 0 0.3"/>
        <axis xyz="0 1 0"/>{limit}</joint>
    </robot>"""
    (folder / "gutter.urdf").write_text(text)
    return folder / "gutter.urdf"


def test_a_body_within_the_hull_of_another_is_no_obstacle_to_reshaping(tmp_path: Path) -> None:
    """The proof looks at surfaces; the search once gave up, as no plane separates the hulls."""
    start, goal = np.array([0.0, -0.3, -1.5]), np.array([0.05, 0.3, 1.5])
    answer = eo.optimize(str(in_a_gutter(tmp_path)), "source-method-2", start=start, goal=goal, duration=3.0, **QUICK)
    assert answer.chosen == "reshape" and answer.certificate.clearance.proven
    assert answer.saving["loss_percent"] == pytest.approx(60, abs=40)
