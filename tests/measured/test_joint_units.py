"""Units that differ from joint to joint: an arm that turns and slides."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from logs import lines, put

from energy_opt.errors import BadInput
from energy_opt.measured import read_set
from energy_opt.measured.importing import import_files
from energy_opt.robot import Robot, load_robot

LINK = """<link name="{name}"><inertial><mass value="3"/><origin xyz="0.1 0 0"/>
  <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>"""
JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
  <origin xyz="0.3 0 0"/><axis xyz="0 0 1"/><limit lower="{lower}" upper="{upper}" velocity="4" effort="90"/></joint>"""
JOINTS = ("a", "b", "z")


@pytest.fixture
def scara(tmp_path: Path) -> Robot:
    """Two joints that turn and one that slides by 0.3 m."""
    parts = [LINK.format(name=name) for name in ("one", "two", "three")]
    parts.append(JOINT.format(name="a", kind="revolute", parent="base", child="one", lower=-2.5, upper=2.5))
    parts.append(JOINT.format(name="b", kind="revolute", parent="one", child="two", lower=-2.5, upper=2.5))
    parts.append(JOINT.format(name="z", kind="prismatic", parent="two", child="three", lower=-0.3, upper=0))
    (tmp_path / "scara.urdf").write_text(f'<robot name="scara"><link name="base"/>{"".join(parts)}</robot>')
    return load_robot(tmp_path / "scara.urdf")


def motion() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Stamps [s], positions and velocities (N, 3) [rad, rad, m], power [W]."""
    t = np.arange(400) * 0.01
    size, rate = np.array([1.5, -1.2, 0.1]), np.array([1.1, 1.7, 2.3])
    q = size * np.sin(np.outer(t, rate)) + np.array([0, 0, -0.15])
    v = size * rate * np.cos(np.outer(t, rate))
    return t, q, v, 90 + 10 * np.abs(v).sum(axis=1)


DEGREES = np.array([180 / np.pi, 180 / np.pi, 1000.0])


@pytest.mark.parametrize(
    ("header", "units", "factors"),
    [
        ("a.position,b.position,z.position", "s,deg,deg,mm,W", DEGREES),
        ("a.position,b.position,z.position", "s,rad,rad,mm,W", np.array([1, 1, 1000.0])),
        ("a.position,b.position,z.position", "s,rad,rad,rad,W", np.ones(3)),
        ("a.position [deg],b.position [rad],z.position [m]", None, np.array([180 / np.pi, 1, 1])),
        ("a.position,b.position,z.position", None, DEGREES),
        ("a.position,b.position,z.position", None, np.array([180 / np.pi, 180 / np.pi, 1.0])),
        ("a.position,b.position,z.position", None, np.array([1, 1, 1000.0])),
    ],
)
def test_each_joints_positions_are_converted_by_their_own_unit(scara, tmp_path, header, units, factors):
    t, q, _, p = motion()
    text = lines(f"time,{header},power", [t, q * factors, p], "%.9f")
    if units:
        text = text.replace("\n", f"\n{units}\n", 1)
    import_files([put(tmp_path / "a.csv", text)], tmp_path / "set", scara)
    (run,) = read_set(tmp_path / "set").runs
    np.testing.assert_allclose(run.position, q, atol=1e-6)


@pytest.mark.parametrize("units", ["s,deg,deg,mm,rpm,rpm,m/s,W", "s,deg,deg,mm,,,,W"])
def test_each_joints_velocities_are_converted_by_their_own_unit(scara, tmp_path, units):
    t, q, v, p = motion()
    header = ",".join(f"{joint}.{signal}" for signal in ("position", "velocity") for joint in JOINTS)
    written = v * (np.array([30 / np.pi, 30 / np.pi, 1]) if "rpm" in units else DEGREES)
    text = lines(f"time,{header},power", [t, q * DEGREES, written, p], "%.9f").replace("\n", f"\n{units}\n", 1)
    import_files([put(tmp_path / "a.csv", text)], tmp_path / "set", scara)
    (run,) = read_set(tmp_path / "set").runs
    assert run.velocity is not None
    np.testing.assert_allclose(run.velocity, v, atol=1e-6)


def test_an_angles_unit_on_a_joint_that_slides_is_refused(scara, tmp_path):
    t, q, _, p = motion()
    header = "time,a.position [deg],b.position [deg],z.position [deg],power"
    path = put(tmp_path / "a.csv", lines(header, [t, q, p]))
    with pytest.raises(BadInput, match=re.escape("the unit is deg, but z slides; expected m, mm")):
        import_files([path], tmp_path / "set", scara)


@pytest.mark.parametrize(
    ("signal", "read"),
    [
        ("effort [A]", "current"),
        ("effort (mA)", "current"),
        ("effort [%]", None),
        ("torque_percent", None),
        ("effort [mN m]", "effort"),
        ("effort", "effort"),
    ],
)
def test_torques_in_another_unit_are_not_taken_for_newton_metres(scara, tmp_path, signal, read):
    t, q, v, p = motion()
    torque = 3 * q + v
    factor = 1000.0 if signal.endswith(("(mA)", "[mN m]")) else 1.0
    header = ",".join([*(f"{joint}.position" for joint in JOINTS), *(f"{joint} {signal}" for joint in JOINTS)])
    path = put(tmp_path / "a.csv", lines(f"time,{header},power", [t, q, torque * factor, p]))
    made = import_files([path], tmp_path / "set", scara)
    (run,) = read_set(tmp_path / "set").runs
    for name in ("effort", "current"):
        values = getattr(run, name)
        assert (values is not None) == (name == read)
        if values is not None:
            np.testing.assert_allclose(values, torque, atol=1e-5)
    assert any("effort" in word and ("taken for currents" in word or "left out" in word) for word in made.words) == (
        "[%]" in signal or read == "current"
    )


@pytest.mark.parametrize("unit", [1.0, 180 / np.pi])
def test_velocities_beside_a_paused_recording_are_judged_where_it_runs(scara, tmp_path, unit):
    """The arm is elsewhere after the pause, and a row is damaged."""
    t, q, v, p = motion()
    late = t + 8 * (t > 1.2) + 5 * (t > 2.5)
    q = q * [0.2, 0.2, 1] + np.outer(t > 1.2, [1.8, -1.0, 0])
    v = v * [0.2, 0.2, 1]
    damaged = q.copy()
    damaged[50, 0] = 90
    header = ",".join(f"{joint}.{signal}" for signal in ("position", "velocity") for joint in JOINTS)
    text = lines(f"time,{header},power", [late, damaged, v * [unit, unit, 1], p], "%.9f")
    imported = import_files([put(tmp_path / "a.csv", text)], tmp_path / "set", scara)
    assert not [word for word in imported.words if "left out" in word]
    runs = read_set(tmp_path / "set").runs
    shown = np.vstack([run.velocity for run in runs if run.velocity is not None])
    np.testing.assert_allclose(shown, np.delete(v, 50, axis=0), atol=1e-6)
