"""Among all goals the cheapest is chosen, and what is said where none can be reached."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import BPoly
from scipy.optimize import minimize_scalar
from tool_poses import by_pinocchio

from energy_opt.cli.main import main
from energy_opt.errors import Infeasible
from energy_opt.front.given import source_model
from energy_opt.front.rivals import rivals_from
from energy_opt.motion import Move, Planner, Settings, Trajectory
from energy_opt.motion.judge.energy import Scorer
from energy_opt.poses.choose import Chooser
from energy_opt.poses.estimate import curves
from energy_opt.poses.inverse import ToolKinematics
from energy_opt.poses.pose import pose_from
from energy_opt.poses.sets import Ring, layer
from energy_opt.reports.words import goals_words
from energy_opt.robot import load_robot


@pytest.fixture(scope="module")
def ur() -> ToolKinematics:
    return ToolKinematics(load_robot("ur5e"))


START = ["--robot", "ur5e", "--start", "0,-1.57,1.57,-1.57,-1.57,0", "--model", "source-method-2", "--quiet"]


def test_a_pose_out_of_reach_says_how_near_one_can_come(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = [*START, "--goal-pose", "2,0,0.3,0,0,0", "--out", str(tmp_path)]
    assert main(["optimize", *options]) == 3
    said = capsys.readouterr().err
    assert "no joint positions reach it" in said
    assert "mm and" in said
    assert main(["optimize", *START, "--goal", "0,0,0,0,0,0", "--free", "rz", "--out", str(tmp_path)]) == 2
    assert "--free belongs to --goal-pose" in capsys.readouterr().err


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
def test_of_several_goals_the_cheapest_is_taken(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    near, far = "0.1,-1.5,1.5,-1.5,-1.5,0.1", "2.9,-1.5,1.5,-1.5,-1.5,0.1"  # equally high
    options = [*START, "--goal", far, "--goal", near, "--duration", "2", "--starts", "2", "--out", str(tmp_path)]
    options.remove("--quiet")
    assert main(["optimize", *options]) == 0
    assert "; the nearest one is the cheapest" in capsys.readouterr().out
    assert "Goals: 2 looked at" in (tmp_path / "report.html").read_text()
    found = json.loads((tmp_path / "result.json").read_text())
    assert np.allclose(found["candidates"][0]["goal"], [float(x) for x in near.split(",")])
    assert [goal["status"] for goal in found["candidates"]] == ["solved", "screened"]  # each is listed once


def test_the_saving_is_quoted_against_the_nearest_goal_at_equal_duration() -> None:
    near = {"energy": 12.0, "saving_joules": 2.0, "duration": 1.5}
    found = {
        "candidates": [{}, {}, {}],
        "solves": {"full": 2},
        "nearest": near,
        "energy": {"total": 10.0},
        "duration": 1.5,
    }
    said = "goals: 3 looked at, 2 solved in full; the nearest one takes 12.0000 J in the same time: saved 2 J, 16.7 %"
    assert goals_words(found) == said
    assert "in 1.7 s" in goals_words({**found, "nearest": {**near, "duration": 1.7}})
    assert goals_words({"energy": {"total": 10.0}}) == ""


def test_the_ring_is_the_cheapest_of_all(ur: ToolKinematics) -> None:
    """Against all combinations, at the price of waiting."""
    scorer = [Scorer(ur.robot, rivals_from(["source-method-2"], None, ur.robot, None)[0][0].model)]
    rng = np.random.default_rng(1)
    layers = [layer(scorer, rng.uniform(-1, 1, (count, 6)), wait) for count, wait in ((3, 0.5), (2, 0.0), (3, 1.0))]
    ring = Ring(layers, [scorer] * 3, [(0.0, np.inf)] * 3)
    chosen, energy = ring.cheapest(1e3, 0.0)

    def cost(picked: tuple[int, ...]) -> float:
        q = [each.positions[k] for each, k in zip(layers, picked, strict=True)]
        moves = sum(curves(scorer, q[k][None], q[(k + 1) % 3][None]).cheapest()[0][0] for k in range(3))
        return moves + sum(each.wait * each.standing[k] for each, k in zip(layers, picked, strict=True))

    costs = {picked: cost(picked) for picked in product(range(3), range(2), range(3))}
    assert tuple(chosen) == min(costs, key=lambda picked: costs[picked])
    assert energy == pytest.approx(min(costs.values()))


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

    def none(move: Move, warm: object) -> Trajectory:
        raise Infeasible("no sketch")

    chosen = Chooser(ur, [Scorer(robot, model)], None, planner.solve, none, planner.settle).choose(move, goals)
    assert chosen.result.status == "solved" and chosen.screened == 2
    assert chosen.candidates[0].energy == pytest.approx(chosen.result.energy.total)
