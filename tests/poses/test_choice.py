"""Among all goals the cheapest is chosen, and what is said where none can be reached."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import BPoly
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation
from tool_poses import by_pinocchio, pose_at

import energy_opt as eo
from energy_opt.cell.load import load_cell
from energy_opt.cell.request import CellRequest
from energy_opt.cli.main import main
from energy_opt.errors import Infeasible
from energy_opt.front.given import source_model
from energy_opt.motion import Move, Planner, Settings, Trajectory
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.result import Result
from energy_opt.poses.choose import Chooser
from energy_opt.poses.inverse import ToolKinematics
from energy_opt.poses.pose import Pose, pose_from
from energy_opt.poses.sets import left_out
from energy_opt.reports.words import goals_words
from energy_opt.robot import load_robot

START = ["--robot", "ur5e", "--start", "0,-1.57,1.57,-1.57,-1.57,0", "--model", "source-method-2", "--quiet"]


def test_a_pose_out_of_reach_says_how_near_one_can_come(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = [*START, "--goal-pose", "2,0,0.3,0,0,0", "--out", str(tmp_path)]
    assert main(["optimize", *options]) == 3
    said = capsys.readouterr().err
    assert "no joint positions reach it" in said
    assert "mm and" in said and "free direction (--free)" in said
    assert len(json.loads((tmp_path / "result.json").read_text())["nearest_pose"]) == 6
    assert main(["optimize", *START, "--goal", "0,0,0,0,0,0", "--free", "rz", "--out", str(tmp_path)]) == 2
    assert "--free belongs to --goal-pose" in capsys.readouterr().err
    options = ["--goal", "0,0,0,0,0,0", "--via-pose", "0.4,0,0.4,3,0,0", "--mode", "retime", "--out", str(tmp_path)]
    assert main(["optimize", *START, *options]) == 2
    assert "--via-pose belongs to --mode reshape" in capsys.readouterr().err


def test_choices_of_poses_share_one_deadline(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each had its own: goals, and up to three choices of the start pose."""
    solves, own = list[Move](), Planner.solve
    monkeypatch.setattr(Planner, "solve", lambda self, move, *more: (solves.append(move), own(self, move, *more))[1])
    monkeypatch.setattr(Planner, "sketch", None)
    asked = {"start_pose": [0.4, -0.3, 0.3, 3.14159, 0, 0], "goal_pose": [0.4, 0.3, 0.3, 3.14159, 0, 0], "free": "rz"}
    found = eo.optimize("ur5e", "source-method-2", **asked, duration=3.0, starts=1, deadline=1e-6)
    assert found.status == "solved" and "deadline" in found.message
    assert len(solves) == 1 and found["nearest"]["energy"] is None
    assert "the search ended, at its deadline or interrupted, before the nearest" in goals_words(found.document())


@pytest.mark.slow
def test_the_chosen_goal_costs_no_more_than_the_nearest(tmp_path: Path) -> None:
    options = [*START, "--goal-pose", "0.4,0.3,0.3,3.14159265,0,0", "--free", "rz", "--duration", "2", "--starts", "3"]
    assert main(["optimize", *options, "--out", str(tmp_path)]) == 0
    found = json.loads((tmp_path / "result.json").read_text())
    energies = [c["energy"] for c in found["candidates"] if c["energy"] is not None]
    assert found["energy"]["total"] == pytest.approx(min(energies))
    assert found["energy"]["total"] <= found["nearest"]["energy"] + 1e-6
    assert found["poses"]["goal"]["valid"]
    last = np.loadtxt(tmp_path / "trajectory.csv", delimiter=",", skiprows=1)[-1]
    q = last[1:7]
    at = by_pinocchio(load_robot("ur5e"), q)
    assert np.linalg.norm(at[:3, 3] - [0.4, 0.3, 0.3]) < 2e-6
    assert np.arccos(np.clip(-at[2, 2], -1, 1)) < 1e-5  # the tool points down, turned as it likes


@pytest.mark.slow
def test_a_pose_on_the_way_is_passed_as_exactly_as_a_pose_at_the_end(tmp_path: Path) -> None:
    options = ["--robot", "ur3e", "--start", "0.2,-1.4,1.4,-1.5,-1.5,0.1", "--via-pose", "0.3,0.05,0.3,3.14,0,0"]
    options += ["--goal-pose", "0.25,0.2,0.25,3.1,0.1,0", "--free", "rz", "--duration", "2", "--starts", "1"]
    assert main(["optimize", *options, "--model", "source-method-2", "--quiet", "--out", str(tmp_path)]) == 0
    rows, robot = np.loadtxt(tmp_path / "trajectory.csv", delimiter=",", skiprows=1), load_robot("ur3e")
    motion = BPoly.from_derivatives(rows[:, 0], rows[:, 1:19].reshape(-1, 3, 6))
    wanted = pose_from("0.3,0.05,0.3,3.14,0,0").matrix

    def missed(time: float) -> float:
        at = by_pinocchio(robot, motion(time))
        return float(np.linalg.norm([*(at[:3, 3] - wanted[:3, 3]), *(at[:3, 2] - wanted[:3, 2])]))

    times = np.linspace(0, 2, 400)
    nearest = times[np.argmin(np.linalg.norm(ToolKinematics(robot)(motion(times))[1] - wanted[:3, 3], axis=1))]
    found = minimize_scalar(missed, bounds=(nearest - 0.01, nearest + 0.01), method="bounded", options={"xatol": 1e-10})
    assert found.fun < 1e-6


@pytest.mark.slow
def test_branches_of_start_and_via_poses_are_compared_by_motions() -> None:
    """By estimates of straight moves alone this move took 317.48 J; another branch of its start takes 302.25 J."""
    start = eo.Pose([0.1224, -0.3084, 0.9058, -0.074, -0.1673, 0.8849, 0.4284])
    via = eo.Pose([-0.4271, -0.2842, 0.9283, -0.3865, -0.5024, 0.5965, 0.4923])
    goal = eo.Pose([0.2719, 0.1616, 0.921, 0.0354, -0.5999, 0.7787, -0.1801])
    found = eo.optimize("ur5e", "source-method-2", start=start, via_pose=[via], goal=goal, duration=2.5)
    assert found.status == "solved" and found.energy.total < 303


@pytest.mark.slow
def test_of_several_goals_the_cheapest_is_taken(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    near, far = "0.1,-1.5,1.5,-1.5,-1.5,0.1", "2.9,-1.5,1.5,-1.5,-1.5,0.1"  # equally high
    options = [*START, "--goal", far, "--goal", near, "--duration", "2", "--starts", "2", "--out", str(tmp_path)]
    options.remove("--quiet")
    assert main(["optimize", *options]) == 0
    assert "; the nearest one is the cheapest" in capsys.readouterr().out
    assert "Goals: 2 looked at" in (tmp_path / "report.html").read_text()
    found = json.loads((tmp_path / "result.json").read_text())
    assert np.allclose(found["candidates"][0]["goal"], [float(x) for x in near.split(",")])
    assert len(found["candidates"]) == 2 and found["candidates"][0]["status"] == "solved"  # each is listed once


def test_the_saving_is_quoted_against_the_nearest_goal_at_equal_duration() -> None:
    near = {"energy": 12.0, "saving_joules": 2.0, "duration": 1.5}
    found = {
        "candidates": [{}, {}, {}],
        "solves": {"full": 2},
        "nearest": near,
        "energy": {"total": 10.0},
        "duration": 1.5,
    }
    said = "goals: 3 looked at, 2 solved in full; the nearest one takes 12.0000 J in the same time, "
    said += "this one 10.0000 J: saved 2 J, 16.7 %"
    assert goals_words(found) == said
    assert "in 1.7 s" in goals_words({**found, "nearest": {**near, "duration": 1.7}})
    assert goals_words({"energy": {"total": 10.0}}) == ""
    assert "no motion to the nearest one" in goals_words({**found, "nearest": {"energy": None, "status": "infeasible"}})
    found |= {"energy": {"total": 7.0}, "robust": {"kind": "worst", "total": 10.0}}  # 7 J is under the first model
    assert goals_words(found) == f"{said} (worst of the models)"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("start", "known", "duration", "least"),
    [
        (  # the sketch is beyond the limits; within them, only a start with acceleration reaches this goal in time
            [0.1008, -0.5952, -1.341, 1.9577, -0.4337, 0.1576, 1.8111],
            [-0.6542, -0.5456, -1.4115, 0.4006, -0.9987, 1.6923, 0.5898],
            1.062,
            [-0.0973, 2.0939, -1.3285, 0.4034, 1.0101, 1.717, 1.348],
        ),
        (  # the better sketch settles at the worse goal
            [-1.60383429, 0.78931919, -1.25413971, 2.11811819, -0.28921283, -0.32222646, 1.63934497],
            [-0.18259955, -1.10057066, 1.74947275, 2.02031943, -1.81561487, 1.50636817, 1.43025678],
            1.123,
            [-3.9112, 1.891, -3.0211, 1.942, 0.1628, 0.803, 0.079],
        ),
    ],
)
def test_redundancy_and_free_turn_cost_no_more_than_the_best_goal_of_an_enumeration(
    start: list[float], known: list[float], duration: float, least: list[float]
) -> None:
    robot = load_robot("xarm7")
    turn, origin = ToolKinematics(robot)(np.array([known]))
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn[0], origin[0]
    pose = eo.Pose(matrix, free=["rz"])
    model, enumerated = source_model(robot), Move(np.array(start), np.array(least), "reshape", duration)
    best = Planner(robot, model, Settings()).solve(enumerated)
    found = eo.optimize(robot, "source-method-2", start=start, goal=pose, duration=duration)
    assert found.status == best.status == "solved"
    assert found.energy.total <= best.energy.total + 0.01 * best.energy.loss


def test_a_sketch_is_near_the_answer_and_goals_without_one_are_solved_in_full(ur: ToolKinematics) -> None:
    robot, model = ur.robot, source_model(ur.robot)
    planner, start = Planner(robot, model, Settings(starts=1)), np.array([0.0, -1.5, 1.5, -1.6, -1.5, 0.0])
    goals = [start + 0.8, start - 0.7]
    move = Move(start, goals[0], "reshape", 1.2)
    answer, sketch = planner.solve(move), planner.sketch(move)
    assert sketch.duration == pytest.approx(1.2) and sketch.position[-1] == pytest.approx(goals[0])
    assert planner.score(sketch).total == pytest.approx(answer.energy.total, abs=0.05 * answer.energy.loss)
    with pytest.raises(Infeasible, match="no motion within the limits"):
        planner.sketch(replace(move, duration=0.1))

    def none(move: Move, *, rough: bool = False) -> Trajectory:
        raise Infeasible("no sketch")

    chosen = Chooser(ur, [Scorer(robot, model)], None, planner.solve, none, planner.settle).choose(move, goals)
    assert chosen.result.status == "solved" and chosen.screened == 2
    assert chosen.candidates[0].energy == pytest.approx(chosen.result.energy.total)


def test_the_nearest_goal_is_moved_along_its_freedom_where_it_is_the_cheapest(ur: ToolKinematics) -> None:
    """Sketches of goals near the start fail, so that only the comparison with the nearest goal finds these."""
    robot, model, start = ur.robot, source_model(ur.robot), np.array([1.05, -0.32, -0.06, -1.06, 0.6, -0.62])
    planner, asked = Planner(robot, model, Settings(starts=1)), []
    turn, origin = ur((start + [0.3, -0.18, 0.05, -0.08, 0.09, -0.24])[None])
    pose = Pose(np.block([[turn[0], origin.T], [0, 0, 0, 1.0]]), ["x:-100:100"])

    def solve(move: Move, warm: Sequence[Trajectory] = (), *, confirm: bool = True) -> Result:
        asked.append(confirm)
        return planner.solve(move, warm, confirm=confirm)

    def sketch(move: Move, *, rough: bool = False) -> Trajectory:
        if np.abs(move.goal - start).max() < 1:
            raise Infeasible("no sketch")
        return planner.sketch(move, rough=rough)

    chooser = Chooser(ur, [Scorer(robot, model)], None, solve, sketch, planner.settle)
    far = start + np.array([-1.5, -0.8, 0, 0, 0, 0])  # lifts the arm
    chosen = chooser.choose(Move(start, start, "reshape", 1.25), [far, pose])
    best, nearest = (c.energy for c in (chosen.candidates[0], chosen.nearest))
    assert np.abs(chosen.move.goal - start).max() < 1
    assert best is not None and nearest is not None
    assert best < nearest - 0.02 * chosen.result.energy.loss
    assert asked and not any(asked)  # a shortest duration is tried only for what is raised


def test_goals_that_differ_only_by_a_free_turn_are_tried_once(ur: ToolKinematics) -> None:
    robot, model, start = ur.robot, source_model(ur.robot), np.array([0.0, -1.5, 1.5, -1.6, -1.5, 0.0])
    planner, sketched = Planner(robot, model, Settings(starts=1)), []
    turn, origin = ur(start[None] + 0.3)
    pose = Pose(np.block([[turn[0], origin.T], [0, 0, 0, 1.0]]), ["rz"])

    def none(move: Move, warm: object = (), **more: object) -> Any:
        if "rough" in more:
            sketched.append(move.goal[:5])  # the last joint turns the tool about its z
        raise Infeasible("too short")

    chooser = Chooser(ur, [Scorer(robot, model)], None, none, none, planner.settle)
    with pytest.raises(Infeasible, match="too short"):
        chooser.choose(Move(start, start, "reshape"), [pose])
    assert len(sketched) > 1
    assert all(np.abs(a - b).max() > 0.1 for k, a in enumerate(sketched) for b in sketched[:k])


def test_the_shortest_duration_of_impossible_goals_is_confirmed(ur: ToolKinematics) -> None:
    robot, model = ur.robot, source_model(ur.robot)
    planner, asked = Planner(robot, model, Settings(starts=1)), []

    def none(move: Move, warm: object = (), *, confirm: bool = True) -> Result:
        asked.append(confirm)
        raise Infeasible("too short")

    start = np.zeros(6)
    chooser = Chooser(ur, [Scorer(robot, model)], None, none, planner.sketch, planner.settle)
    with pytest.raises(Infeasible, match="too short"):
        chooser.choose(Move(start, start, "reshape", 3.0), [start + 0.5, start + 0.7])
    assert asked[-1] and not any(asked[:-1]) and len(asked) > 1


def test_the_duration_that_a_refusal_names_works(ur: ToolKinematics) -> None:
    """It had been a bound without jerk and torque, rounded down: asked for again, it was refused in the same words."""
    planner, start = Planner(ur.robot, source_model(ur.robot), Settings()), np.array([0.0, -1.0, 1.0, -1.0, 1.0, 0.0])
    chooser = Chooser(ur, [Scorer(ur.robot, planner.model)], None, planner.solve, planner.sketch, planner.settle)
    goals = [start + 0.5, start + 0.7]
    with pytest.raises(Infeasible, match=r"goal: no goal is reached in 0.1 s; the nearest one: .*limit") as caught:
        chooser.choose(Move(start, start, "retime", 0.1), goals)
    named = float(re.search(r"([0-9.]+) s$", str(caught.value))[1])
    assert named == pytest.approx(caught.value.shortest_duration, rel=1e-5) and caught.value.joint in ur.robot.joints
    chosen = chooser.choose(Move(start, start, "retime", caught.value.shortest_duration), goals)
    np.testing.assert_allclose(chosen.move.goal, goals[0])


def test_poses_within_their_tolerance_are_reached_by_arms_of_few_axes(tmp_path: Path) -> None:
    """They were refused as "0 mm and 0.3 deg away", whatever the tolerance; a message names one that allows them."""
    arm, words = load_robot("ur5e", lock={"wrist_2_joint": -1.5}), {"model": "source-method-2", "self_collision": False}
    start, reached = np.array([0.0, -1.57, 1.57, -1.57, 0.0]), np.array([0.8, -1.2, 1.3, -1.4, 0.4])
    pose = pose_at(ToolKinematics(arm), reached)
    pose.matrix[:3, :3] = pose.matrix[:3, :3] @ Rotation.from_rotvec([3e-3, -4e-3, 2e-3]).as_matrix()
    asked = {"start": start, "goal_pose": pose.matrix, "duration": 2.0, "starts": 2, **words}
    with pytest.raises(Infeasible, match="no joint positions reach it") as refused:
        eo.optimize(arm, **asked)
    found = re.search(r"pose_tolerance (\S+) allows it", str(refused.value))
    assert found is not None
    for tolerance, free in ((found[1], ()), ("1mm,1deg", ("rz:-10:10", "z:-20:20"))):
        answer = eo.optimize(arm, **asked, pose_tolerance=tolerance, free=free).document()
        assert answer["status"] == "solved" and answer["poses"]["goal"]["valid"]


def test_a_job_reaches_poses_within_their_tolerance(tmp_path: Path) -> None:
    pose = pose_at(ToolKinematics(load_robot("ur5e")), np.array([0.8, -1.2, 0.0, -1.4, -1.5, 0.4]))
    pose.matrix[:3, 3] *= 1 + 5e-4 / np.linalg.norm(pose.matrix[:3, 3])  # a little beyond the stretched arm
    place = [*pose.matrix[:3, 3].tolist(), *Rotation.from_matrix(pose.matrix[:3, :3]).as_euler("xyz").tolist()]
    text = 'format = "energy-opt/job/1"\nrobot = "ur5e"\ncycle_time = 6.0\nhome = [0, -1.57, 1.57, -1.57, -1.57, 0]\n'
    text += f'[[step]]\npose = {place}\npose_tolerance = "1mm,1deg"\n[[step]]\nto = "home"\n'
    (tmp_path / "job.toml").write_text(text)
    asked = {"model": "source-method-2", "self_collision": False, "starts": 2}
    found = json.loads(json.dumps(eo.job(tmp_path / "job.toml", **asked).document()))  # it held arrays
    (end,) = found["poses"]
    assert end["valid"] and 1e-5 < end["distance"] < 1e-3


@pytest.mark.slow
def test_of_several_poses_the_cheapest_is_taken(tmp_path: Path) -> None:
    """Only the last one was looked at."""
    near, far = "0.4,0.3,0.3,3.14159265,0,0", "-0.4,-0.3,0.8,1.5,0,0"
    options = [*START, "--self-collision", "off", "--duration", "2", "--starts", "2", "--mode", "retime"]
    energies = []
    for goals in ((near, far), (near,), (far,)):
        words = [word for goal in goals for word in ("--goal-pose", goal)]
        assert main(["optimize", *options, *words, "--force", "--out", str(tmp_path)]) == 0
        energies.append(json.loads((tmp_path / "result.json").read_text())["energy"]["total"])
    assert energies[0] == pytest.approx(min(energies[1:]))
    start = [float(word) for word in START[3].split(",")]
    given = [[float(x) for x in goal.split(",")] for goal in (near, far)]
    asked = {"start": start, "duration": 2.0, "starts": 2, "mode": "retime", "self_collision": False}
    found = eo.optimize("ur5e", "source-method-2", goal_pose=given, **asked).document()
    assert found["energy"]["total"] == pytest.approx(energies[0]) and len(found["request"]["goals"]) == 2
    # the pose that was reached was neither checked nor stated
    assert found["poses"]["goal"]["valid"] and found["poses"]["goal"]["distance"] < 1e-6


def test_a_goal_out_of_reach_is_left_out_where_others_are_not(tmp_path: Path, ur: ToolKinematics) -> None:
    """The move was refused; if its start was a pose, also where one goal is in contact."""
    far, inside, free = "2,0,0.3,0,0,0", "0.4,-0.3,0.3,3.14,0,0", "0.4,0.3,0.3,3.14,0,0"
    options = [*START, "--self-collision", "off", "--duration", "2", "--starts", "1", "--mode", "retime"]
    options += ["--goal-pose", far, "--out", str(tmp_path / "out")]
    assert main(["optimize", *options, "--goal-pose", "0,3,0,0,0,0"]) == 3
    assert main(["optimize", *options, "--goal-pose", free, "--force"]) == 0
    found = json.loads((tmp_path / "out" / "result.json").read_text())
    assert found["poses"]["goal"]["valid"]
    assert any(text.startswith("goal 1 of 2 is left out: --goal-pose: no joint") for text in found["warnings"])
    scene = tmp_path / "scene.yaml"
    scene.write_text("objects: [{name: ball, type: sphere, radius: 0.1, position: [0.4, -0.3, 0.3]}]")
    cell = load_cell(ur.robot, CellRequest(scene=scene))
    goals = [pose_from(numbers) for numbers in (inside, free)]
    kept, said = left_out(ur, goals, cell, ur.robot.limits.near_zero, 0)
    assert kept == (goals[1],) and "ball" in said[0]


def test_a_position_outside_by_less_than_six_digits_show_says_by_how_much() -> None:
    """6.2832 was "6.28319 outside [-6.28319, 6.28319]"; verbs move it onto the limit, planners do not."""
    robot = load_robot("ur5e")
    with pytest.raises(Infeasible, match=r"6\.2832 rad is 1\.5e-05 rad outside \[-6\.28319, 6\.28319\] rad"):
        eo.Planner(robot, eo.source_model(robot)).solve(eo.Move([6.2832, -1, 1, 0, 0, 0], [4, -1, 1, 0, 0, 0]))


def test_a_joint_may_turn_the_longer_way() -> None:
    """The goal was always the turn nearest to the start: 3.2 J of loss."""
    start, pose = [2.481, -1.284, -1.216, -2.134, -1.211, 1.316], [-0.457, -0.63, 0.636, -1.848, -0.42, 2.271]
    found = eo.optimize(
        "ur5e", start=start, goal_pose=pose, duration=3.0, model="source-method-2", self_collision=False
    )
    assert found.energy.loss < 1.6 and abs(found.trajectory.position[-1, 1] - start[1]) > np.pi
