"""Positions that are beyond a limit by their rounding."""

from __future__ import annotations

import numpy as np
import pytest

import energy_opt as eo
from energy_opt.batches.suite import load_suite
from energy_opt.batches.tables import joint_values
from energy_opt.cell.request import CellRequest
from energy_opt.cli.main import main
from energy_opt.errors import Infeasible
from energy_opt.front.moves import ends_of, move_of
from energy_opt.requests.moves import OptimizeRequest
from energy_opt.robot import load_robot

START, GOAL = [0.0, -1.2, 3.1416, -1.0, 0.5, 0.0], [1.0, -1.0, 1.2, -1.0, 0.5, 6.2832]  # limits: pi and 2 pi


def test_rounded_positions_are_moved_onto_the_limit_and_noted(tmp_path):
    """The elbow of a ur5 turns by pi to either side; a file's and a job's positions are read as typed ones are."""
    robot, notes = load_robot("ur5"), []
    move = move_of(OptimizeRequest(robot=robot, start=START, goal=GOAL), robot, say=notes.append)
    assert (move.start[2], move.goal[5]) == (robot.limits.upper[2], robot.limits.upper[5])
    assert len(notes) == 2
    assert "7e-06 rad beyond its position limits" in notes[0]
    file = tmp_path / "path.csv"
    lines = (",".join(map(str, q)) for q in (START, GOAL))
    file.write_text("\n".join([",".join(f"{name}.position" for name in robot.joints), *lines]))
    for path in (str(file), [START, GOAL]):
        move = move_of(OptimizeRequest(robot=robot, path=path, mode="retime"), robot, say=notes.append)
        assert np.allclose(move.start, START, atol=1e-5)
        assert (move.path(np.linspace(0, 1, 9)) <= robot.limits.upper).all()
    notes.clear()
    assert joint_values(START, robot, notes.append)[2] == robot.limits.upper[2]
    assert len(notes) == 1


def test_rounded_positions_of_suites_goals_and_cells_are_noted(tmp_path, capsys):
    robot, notes = load_robot("ur5"), []
    ends_of(OptimizeRequest(robot=robot, start=START, goal=eo.AnyOf([GOAL, START])), robot, CellRequest(), notes.append)
    assert len(notes) == 2 and notes[0].startswith("--goal: wrist_3_joint is 1e-05 rad beyond")
    suite, job = tmp_path / "suite.toml", tmp_path / "job.toml"
    suite.write_text(
        f'format = "energy-opt/suite/1"\nrobots = ["ur5"]\n[[moves]]\nstart = {START}\ngoal = {GOAL}\n'
        f"[[moves]]\nstart = {START}\ngoal_pose = [0.4, 0.2, 0.4, 3.14159, 0, 0]\n"
    )
    found = load_suite(suite).notes
    assert [note.split(" is ")[0] for note in found] == [
        "moves 1 (move01) on ur5: elbow_joint", "moves 1 (move01) on ur5: wrist_3_joint",
        "moves 2 (move02) on ur5: elbow_joint",
    ]  # fmt: skip
    job.write_text(
        'format = "energy-opt/job/2"\ncycle_time = 9.0\n[[robot]]\nname = "a"\nrobot = "ur5"\n'
        f"[[robot.step]]\nto = {START}\n[[robot.step]]\nto = [0.0, -1.2, 1.0, -1.0, 0.5, 0.0]\n"
    )
    assert main(["check", str(suite), str(job)]) == 0
    said = capsys.readouterr().err
    assert all(note in said for note in found) and "robot a: step 1 (step 1): elbow_joint is 7e-06" in said


def test_positions_farther_beyond_a_limit_stay_as_they_are_and_are_infeasible():
    far, notes = [0.0, -1.2, 3.15, -1.0, 0.5, 0.0], []
    move = move_of(OptimizeRequest(robot="ur5", start=far, goal=GOAL[:5] + [0.0]), load_robot("ur5"), say=notes.append)
    assert (move.start[2], notes) == (3.15, [])
    with pytest.raises(Infeasible, match=r"0\.0084 rad outside"):
        eo.optimize("ur5", start=far, goal=GOAL[:5] + [0.0])
