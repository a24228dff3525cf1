"""An arm whose links turn in one vertical plane."""

from __future__ import annotations

from pathlib import Path

LENGTHS = (0.4, 0.4, 0.2)  # [m] of the links
HEIGHT = 0.5  # [m] of the first joint; all joints turn about y, which lowers the link for positive angles


def arm(folder: Path, count: int) -> Path:
    """The file of an arm in a vertical plane with so many links."""
    parts = ['<robot name="plane"><link name="base"/>']
    before, at = "base", f"0 0 {HEIGHT}"
    for k, length in enumerate(LENGTHS[:count]):
        middle = f'<origin xyz="{length / 2} 0 0"/>'
        parts.append(
            f'<link name="l{k}"><inertial>{middle}<mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" '
            f'ixz="0" iyz="0"/></inertial><collision>{middle}<geometry><box size="{length} 0.04 0.04"/></geometry>'
            f'</collision></link><joint name="j{k}" type="revolute"><parent link="{before}"/><child link="l{k}"/>'
            f'<origin xyz="{at}"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="3" effort="100"/></joint>'
        )
        before, at = f"l{k}", f"{length} 0 0"
    parts.append(
        f'<link name="tip"/><joint name="end" type="fixed"><parent link="{before}"/><child link="tip"/>'
        f'<origin xyz="{at}"/></joint></robot>'
    )
    (folder / "arm.urdf").write_text("".join(parts))
    return folder / "arm.urdf"
