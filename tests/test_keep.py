"""What the tool keeps on the way: upright, its orientation, a line, and a bounded acceleration."""

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from poses import START

from energy_opt.errors import BadInput, Infeasible
from energy_opt.motion import Move, Planner, Settings
from energy_opt.motion.limits.base import State
from energy_opt.motion.limits.keep import poses_of
from energy_opt.motion.limits.registry import limits_of
from energy_opt.power import PowerModel
from energy_opt.robot import Robot

# Where q6 = q2 - q4 and q3 = q5 = 0, the Panda's flange points straight down; so does every pose between two of these.
GOAL = np.array([0.7, 0.2, 0.0, -1.8, 0.0, 2.0, 0.785])
ALL = ("upright:3", "orientation:50", "line:120")


def frame(robot: Robot, q: np.ndarray) -> np.ndarray:
    """The last joint's pose by Pinocchio."""
    model = pin.buildModelFromUrdf(str(robot.urdf))
    data = model.createData()
    pin.forwardKinematics(model, data, np.concatenate([q, [0.0, 0.0]]))
    return data.oMi[7].homogeneous


@pytest.fixture(scope="module")
def solved(panda: Robot, model: PowerModel):
    settings = Settings(keep=ALL, tool_acceleration=2.5, starts=1, controls=20)
    return Planner(panda, model, settings).solve(Move(START, GOAL, duration=2.0))


def test_deviations_are_what_they_say(panda: Robot) -> None:
    move = Move(START, GOAL)
    upright, orientation, line = limits_of(panda, Settings(keep=ALL), move)[-3:]
    q = START + [0.4, 0.1, 0.2, 0.0, -0.3, 0.2, 0.5]
    poses = poses_of(panda.body, upright.tool, q[None])
    a, b, c = frame(panda, START), frame(panda, q), frame(panda, GOAL)
    tilt = np.arccos(np.clip(b[2, :3] @ a[2, :3], -1, 1))
    turn = np.linalg.norm(pin.log3(a[:3, :3].T @ b[:3, :3]))
    t = np.linspace(0, 1, 100001)[:, None]
    off = np.linalg.norm(a[:3, 3] + t * (c[:3, 3] - a[:3, 3]) - b[:3, 3], axis=1).min()
    for limit, value in ((upright, tilt), (orientation, turn), (line, off)):
        assert limit.deviation(poses)[0] == pytest.approx(value, abs=1e-6)
        symbols = [ca.SX.sym(name, 7) for name in ("q", "v", "a")]
        p = ca.SX.sym("p", limit.values.size)
        row = limit.expression(State(*symbols, symbols[0], ca.SX(0), ca.SX(0)), p)
        share = float(ca.Function("f", [*symbols, p], [row])(q, 0, 0, limit.values)) / limit.scale[0]
        assert share == pytest.approx(limit.row(value) / limit.row(limit.most), rel=1e-5)


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
    with pytest.raises(Infeasible, match=r"upright is off by 0\.2 rad, beyond 0\.08727 rad"):
        Planner(panda, model, Settings(keep=("upright",))).solve(Move(START, tilted, duration=2.0))
    for wrong in ({"keep": ("level",)}, {"keep": ("upright:-1",)}, {"tool_acceleration": 0.0}):
        with pytest.raises(BadInput, match="expected"):
            Planner(panda, model, Settings(**wrong))
