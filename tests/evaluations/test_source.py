"""Motions to be evaluated come with the payload that a result states, and say what they are not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from energy_opt import formats
from energy_opt.errors import BadInput
from energy_opt.evaluations.source import load
from energy_opt.files import write_json
from energy_opt.motion.path import straight
from energy_opt.motion.timing.toppra import fastest
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import source_method_2
from energy_opt.robot import Robot, load_robot

Z1 = load_robot("z1")
START, GOAL = np.array([0, 1, -1, 0, 0, 0.0]), np.array([0.5, 1.2, -1.2, 0, 0, 0.0])


def motion(robot: Robot) -> Trajectory:
    """The fastest straight move from START to GOAL."""
    return fastest(robot, source_method_2(robot), straight(START, GOAL)).trajectory(robot.joints)


def test_a_result_states_its_payload(tmp_path: Path) -> None:
    formats.write(motion(Z1), tmp_path / "trajectory.csv")
    payload = {"mass": [1.5], "com": [0.0, 0.0, 0.1]}
    write_json(tmp_path / "result.json", {"request": {"payload": payload}})
    for given in (tmp_path, tmp_path / "result.json", tmp_path / "trajectory.csv"):
        (stretch,) = load(given, Z1.joints).stretches
        assert stretch.load == (1.5, 0.0, 0.0, 0.1)
    for document in ({"request": {}}, {"request": None}, {}):
        write_json(tmp_path / "result.json", document)
        (stretch,) = load(tmp_path, Z1.joints).stretches
        assert stretch.load is None


def test_a_folder_without_a_motion_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"a folder without result\.json or job\.json"):
        load(tmp_path, Z1.joints)
