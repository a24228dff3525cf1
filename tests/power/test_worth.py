"""What a diagnosis is worth: the set's longest move, planned under two models."""

import numpy as np
import pytest

from energy_opt.effects import CoulombFriction
from energy_opt.measured import MeasuredSet
from energy_opt.measured.run import Run
from energy_opt.motion import Planner
from energy_opt.next_motion.worth import longest_move, worth_of
from energy_opt.power import source_method_2
from energy_opt.robot import load_robot

HERE, THERE = np.array([0.0, 1.0, -1.0, 0.0, 0.0, 0.0]), np.array([0.9, 1.6, -1.4, 0.4, 0.3, 0.2])


def run_of(file, *poses, seconds=2.0, kind="motion"):
    """A run that goes from pose to pose, `seconds` each, and waits a second at each."""
    time, position, at = [], [], 0.0
    for begin, end in zip(poses[:-1], poses[1:], strict=True):
        t = np.arange(0.0, seconds + 1.0, 0.01)
        s = np.clip(t / seconds, 0, 1)
        s = s**3 * (10 - 15 * s + 6 * s**2)
        time.append(at + t)
        position.append(begin + s[:, None] * (end - begin))
        at += seconds + 1.0
    none = np.zeros(0)
    return Run(file, kind, 0.0, np.concatenate(time), np.vstack(position), None, None, None, None, none, none)


def set_of(tmp_path, *runs):
    return MeasuredSet(tmp_path, load_robot("z1"), runs, True)


def test_the_longest_move_is_one_way_of_a_run_that_comes_back(tmp_path):
    half = HERE + 0.5 * (THERE - HERE)
    still = run_of("still.csv", HERE, 3 * THERE, kind="static")
    own = longest_move(set_of(tmp_path, run_of("short.csv", HERE, half), run_of("long.csv", HERE, THERE, HERE), still))
    assert own.file == "long.csv" and own.start == pytest.approx(HERE) and own.goal == pytest.approx(THERE, abs=1e-3)
    assert own.duration == pytest.approx(2.0, abs=0.15)
    assert longest_move(set_of(tmp_path, still)) is None


def test_a_plan_under_the_wrong_model_costs_more(tmp_path):
    measured = set_of(tmp_path, run_of("run.csv", HERE, THERE))
    declared = source_method_2("z1")
    worth = worth_of(measured, declared, declared.replaced(CoulombFriction(tau_c=[3.0] * 6)))
    assert worth["duration"] == pytest.approx(2.0, abs=0.15)
    assert worth["diagnosed_plan"] <= worth["evenly_slowed"]
    assert worth["diagnosed_plan"] < worth["declared_plan"] - 0.1


def test_a_model_that_says_the_same_is_planned_once(tmp_path, monkeypatch):
    solved, solve = [], Planner.solve
    monkeypatch.setattr(Planner, "solve", lambda self, move: solved.append(1) or solve(self, move))
    declared = source_method_2("z1")
    worth = worth_of(set_of(tmp_path, run_of("run.csv", HERE, THERE)), declared, source_method_2("z1"))
    assert len(solved) == 1 and worth["diagnosed_plan"] <= worth["declared_plan"]
