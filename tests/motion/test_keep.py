"""What the tool keeps on the way: upright, its orientation, a line, and a bounded acceleration."""

from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from poses import START
from test_clear_moves import touches

from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene import Scene, SceneObject, Shape
from energy_opt.errors import BadInput, Infeasible
from energy_opt.motion import Move, Planner, Settings
from energy_opt.power import PowerModel
from energy_opt.robot import Robot

# Where q6 = q2 - q4 and q3 = q5 = 0, the Panda's flange points straight down; so does every pose between two of these.
GOAL = np.array([0.7, 0.2, 0.0, -1.8, 0.0, 2.0, 0.785])
ALL = ("upright:3", "orientation:50", "line:120")


@cache
def tree(urdf: Path) -> tuple[pin.Model, pin.Data]:
    """Pinocchio's model of an arm, read once."""
    model = pin.buildModelFromUrdf(str(urdf))
    return model, model.createData()


def frame(robot: Robot, q: np.ndarray) -> np.ndarray:
    """The last joint's pose by Pinocchio."""
    model, data = tree(robot.urdf)
    pin.forwardKinematics(model, data, np.concatenate([q, [0.0, 0.0]]))
    return data.oMi[7].homogeneous.copy()


@pytest.fixture(scope="module")
def solved(panda: Robot, model: PowerModel):
    settings = Settings(keep=ALL, tool_acceleration=2.5, starts=1, controls=20)
    return Planner(panda, model, settings).solve(Move(START, GOAL, duration=2.0))


def test_a_move_keeps_what_it_is_asked_to(panda: Robot, solved) -> None:
    assert solved.status == "solved" and solved.chosen == "reshape"
    excess = solved.certificate.max_violation
    assert {"upright", "orientation", "line", "tool_acceleration"} <= set(excess) and solved.certificate.valid
    t, a = solved.trajectory, frame(panda, START)
    tilts = [np.degrees(np.arccos(np.clip(frame(panda, q)[2, :3] @ a[2, :3], -1, 1))) for q in t.position[::10]]
    assert max(tilts) <= 3 * (1 + 1e-6)
    steps = np.stack([frame(panda, q)[:3, 3] for q in t.sample(np.linspace(0, t.duration, 2001))[0]])
    acceleration = np.diff(steps, 2, axis=0) / (t.duration / 2000) ** 2
    assert np.linalg.norm(acceleration, axis=1).max() <= 2.5 * 1.001


def test_without_them_the_tool_tilts_more(panda: Robot, model: PowerModel, solved) -> None:
    free = Planner(panda, model, Settings(starts=1, controls=20)).solve(Move(START, GOAL, duration=2.0))
    a = frame(panda, START)
    tilt = max(np.arccos(np.clip(frame(panda, q)[2, :3] @ a[2, :3], -1, 1)) for q in free.trajectory.position[::10])
    assert np.degrees(tilt) > 5 and free.energy.total < solved.energy.total


def test_ends_that_cannot_keep_it_and_words_that_mean_nothing(panda: Robot, model: PowerModel) -> None:
    tilted = GOAL + [0, 0, 0, 0, 0, 0.2, 0]
    with pytest.raises(Infeasible, match=r"goal: .* 11\.46 deg from upright, allowed are 5"):
        Planner(panda, model, Settings(keep=("upright",))).solve(Move(START, tilted, duration=2.0))
    for wrong in ({"keep": ("level",)}, {"keep": ("upright:-1",)}, {"tool_acceleration": 0.0}):
        with pytest.raises(BadInput, match="expected"):
            Planner(panda, model, Settings(**wrong))


def test_it_is_kept_on_the_way_around_a_post(panda: Robot, model: PowerModel) -> None:
    """The straight line keeps the tool upright but goes through a ball; ways around need not keep it: rows do."""
    at = np.eye(4)
    at[:3, 3] = frame(panda, (START + GOAL) / 2)[:3, 3]
    cell = Cell(panda, CellRequest(), Scene((SceneObject("post", (Shape("sphere", (0.05,)),), at),)))
    settings = Settings(keep="upright:5", starts=1, controls=20, compile="never")
    result = Planner(panda, model, settings, cell=cell).solve(Move(START, GOAL, duration=3.0))
    assert result.status == "solved" and result.certificate.clearance.proven
    assert result.first_path.source in ("own", "ompl")
    assert touches(panda, result.trajectory, at) == 0
    up = frame(panda, START)[2, :3]
    tilts = [np.degrees(np.arccos(np.clip(frame(panda, q)[2, :3] @ up, -1, 1))) for q in result.trajectory.position]
    assert max(tilts) <= 5 * (1 + 1e-6)
