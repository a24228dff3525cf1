"""The values of a job file: each is checked, and what is wrong is collected, so that one reading names all faults."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.batches.faults import is_number
from energy_opt.batches.moves import joint_values
from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput, near
from energy_opt.files import inside
from energy_opt.poses.given import SUFFIXES, Given, poses_of_request
from energy_opt.poses.pose import UNIT, Pose
from energy_opt.robot import Robot

OF_POSE = ("pose", "free", "pose_tolerance")
SAME = 1e-9  # [rad] two positions nearer than this are one
LONGEST = 1e7  # [s] of a cycle and a wait: more is a slip of units
Target = Pose | np.ndarray
Load = tuple[float, float, float, float]  # mass [kg] and its centre [m] in the last joint's frame


class Reader:
    """One reading of a document; faults are collected."""

    def __init__(self, document: Mapping[str, Any], path: Path, robot: Robot, allow_outside: bool) -> None:
        self.document, self.path, self.robot, self.allow_outside = document, path, robot, allow_outside
        self.faults: list[str] = []
        self.poses: dict[str, Target] = {}

    def target(self, row: Mapping[str, Any], where: str) -> Target | None:
        """Where a step goes: `to`, or a pose of the tool with its freedom."""
        given = [key for key in OF_POSE if key in row]
        if "pose" not in row and not given:
            return self.pose(row["to"], where)
        if "pose" in row and "to" in row:
            self.faults.append(f"{where}: expected either `to` or `pose`")
            return None
        value = row.get("pose", row.get("to"))
        if isinstance(self.poses.get(value) if isinstance(value, str) else None, np.ndarray):
            self.faults.append(f"{where}: {value!r} is joint positions; {given[0]} belongs to a pose of the tool")
            return None
        try:
            return self._given().pose(value, where, row.get("free", ()), row.get("pose_tolerance"))
        except BadInput as error:
            self.faults.append(str(error))
            return None

    def _given(self) -> Given:
        return Given(self.path.parent, self.poses, self.allow_outside)

    def pose(self, value: Any, where: str) -> Target | None:
        """A pose of the tool, or positions within the position limits, by name or as they are."""
        if isinstance(value, str) and value in self.poses:
            return self.poses[value]
        named = self.document.get("poses")
        if self.faults and isinstance(named, Mapping) and isinstance(value, str) and value in named:
            return None  # what is wrong with it has been said
        if isinstance(value, str) and not ("," in value or value.endswith(SUFFIXES)):
            self.faults.append(f"{where}: unknown pose {value!r}{near(value, self.poses)}; [poses] names them")
            return None
        try:
            if isinstance(value, str) or (isinstance(value, Mapping) and "pose" in value):
                return self._given().pose(value, where)
        except BadInput as error:
            self.faults.append(str(error))
            return None
        try:
            q = np.array(joint_values(value, self.robot.joints))
        except BadInput as error:
            hint = "; a pose of the tool is { pose = [...] }" if np.size(value) in (6, 7) else ""
            self.faults.append(f"{where}: {error}{hint}")
            return None
        limits = self.robot.limits
        outside = np.flatnonzero((q < limits.lower - SAME) | (q > limits.upper + SAME))
        for j in outside[:1]:
            self.faults.append(
                f"{where}: {self.robot.joints[j]} = {q[j]:.4g} is outside its position limits "
                f"[{limits.lower[j]:.4g}, {limits.upper[j]:.4g}]"
            )
        return None if outside.size else q

    def remarks(self, name: str, value: Any) -> list[str]:
        """What to say of named positions that have as many numbers as a pose of the tool."""
        if not isinstance(value, list) or len(value) not in (6, 7):
            return []
        if len(value) == 7 and abs(np.linalg.norm(np.array(value[3:], dtype=float)) - 1) > UNIT:
            return []
        return [
            f"poses: {name}: these {len(value)} numbers are joint positions; a pose of the tool is "
            f"{name} = {{ pose = [...] }}"
        ]

    def number(self, table: Mapping[str, Any], key: str, where: str, default: float, least: float = 0.0) -> float:
        """Seconds from `least` to `LONGEST`; `default` where the table says none."""
        if key not in table:
            return default
        value = table[key]
        if not is_number(value) or not least <= value <= LONGEST:
            self.faults.append(f"{where}: {key} = {value!r}; expected seconds, {least:g} to {LONGEST:g}")
            return default
        return float(value)

    def truth(self, table: Mapping[str, Any], key: str, where: str, default: bool) -> bool:
        """true or false."""
        value = table.get(key, default)
        if not isinstance(value, bool):
            self.faults.append(f"{where}: {key} = {value!r}; expected true or false")
            return default
        return value

    def known(self, table: Mapping[str, Any], names: tuple[str, ...], where: str) -> None:
        """Keys that nobody knows."""
        for key in table:
            if key not in names:
                self.faults.append(f"{where}: unknown key {key!r}{near(key, names)}; known: {', '.join(names)}")

    def payload(self, value: Any, where: str) -> Load:
        """MASS or [MASS, CX, CY, CZ]."""
        parts = value if isinstance(value, list) else [value]
        numbers = list(filter(is_number, parts))
        if len(numbers) != len(parts) or len(numbers) not in (1, 4) or numbers[0] < 0:
            self.faults.append(f"{where}: payload = {value!r}; expected a mass in kg, or [mass, cx, cy, cz] with m")
            return (0.0, 0.0, 0.0, 0.0)
        mass, *com = (float(x) for x in numbers)
        x, y, z = com or (0.0, 0.0, 0.0)
        return mass, x, y, z

    def scene(self, value: Any, where: str) -> Path | None:
        """A file beside the job."""
        try:
            path = inside(self.path.parent, str(value), self.allow_outside)
        except BadInput as error:
            self.faults.append(f"{where}: scene: {error}")
            return None
        if not path.is_file():
            self.faults.append(f"{where}: scene {value!r} is not a file beside the job")
        return path


def of_scene(reader: Reader, document: Mapping[str, Any]) -> dict[str, Target]:
    """The poses that the job's scene file names."""
    try:
        path = reader.scene(document["scene"], "job") if "scene" in document else None
        return {} if path is None else dict(poses_of_request(CellRequest(scene=path)))
    except BadInput:
        return {}  # the scene's own faults are named where it is read
