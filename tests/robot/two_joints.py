"""A URDF of two joints with any numbers in it."""

from __future__ import annotations

from pathlib import Path

TWO_JOINTS = """<robot name="two">
  <link name="base"/>
  <joint name="first" type="revolute"><parent link="base"/><child link="one"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="2" effort="{effort}" velocity="{velocity}"/></joint>
  <link name="one"><inertial><mass value="1"/><origin xyz="0.1 0 0"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="second" type="revolute"><parent link="one"/><child link="two"/>
    <origin xyz="0.3 0 0"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="5" velocity="1"/></joint>
  <link name="two"><inertial><mass value="{mass}"/><origin xyz="0.1 0 0"/>
    <inertia ixx="{inertia}" ixy="0" ixz="0" iyy="{inertia}" iyz="0" izz="{inertia}"/></inertial></link>
</robot>"""


def two_joints(tmp_path: Path, **values: str) -> str:
    """A URDF file of two joints with the given numbers in it."""
    numbers = {"effort": "10", "velocity": "2", "mass": "0.5", "inertia": "0.002"} | values
    path = tmp_path / "two.urdf"
    path.write_text(TWO_JOINTS.format(**numbers))
    return str(path)
