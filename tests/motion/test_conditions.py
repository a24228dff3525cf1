"""Limits that are asked for: electrical power and tool speed, retimed and reshaped, by Pinocchio on a dense grid."""

import numpy as np
import pinocchio as pin
import pytest
from poses import GOAL, START

from energy_opt import optimize
from energy_opt.cli.main import main
from energy_opt.effects import CoulombFriction, Regeneration
from energy_opt.errors import BadInput, Infeasible
from energy_opt.motion import Move, Planner, Settings
from energy_opt.motion.judge.certificate import certify
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.limits.own import Power
from energy_opt.motion.limits.registry import limits_of
from energy_opt.motion.limits.tool import ToolSpeed
from energy_opt.motion.path import straight
from energy_opt.motion.path_dynamics import PathDynamics
from energy_opt.motion.plan.robust import RobustPlanner
from energy_opt.motion.plan.robust_models import Rival
from energy_opt.motion.timing.toppra import fastest
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel, source_method_2
from energy_opt.power.known import named_model
from energy_opt.robot import Robot, load_robot, tool_of

STANDBY, COPPER = 88.04, 0.0036  # of the source paper's model
MOVE = {"starts": 1, "controls": 16, "compile": "never"}
TCP = "panda_hand_tcp,0,0,0.02"


def peaks(robot: Robot, trajectory: Trajectory, frame: str = "panda_joint7", shift: float = 0.0) -> tuple[float, float]:
    """Largest power of the source paper's law [W], and largest speed of a frame's origin, shifted along its z [m/s]."""
    model = pin.buildModelFromUrdf(str(robot.urdf))
    model = pin.buildReducedModel(model, [model.getJointId(name) for name in robot.locked], pin.neutral(model))
    data, number = model.createData(), model.getFrameId(frame)
    time = np.linspace(trajectory.time[0], trajectory.time[-1], 4001)
    power, speed, offset = [], [], np.array([0, 0, shift])
    for q, v, a, _ in zip(*trajectory.sample(time), strict=True):
        tau = pin.rnea(model, data, q, v, a)
        power.append(STANDBY + tau @ v + COPPER * tau @ tau)
        pin.forwardKinematics(model, data, q, v)
        twist = pin.getFrameVelocity(model, data, number, pin.ReferenceFrame.LOCAL)
        speed.append(np.linalg.norm(twist.linear + pin.skew(twist.angular) @ offset))
    return max(power), max(speed)


@pytest.fixture(scope="module")
def plain(panda: Robot, model: PowerModel) -> Trajectory:
    return Planner(panda, model, Settings(**MOVE)).solve(Move(START, GOAL, "retime", duration=1.6)).trajectory


def test_the_certificate_finds_peaks_where_pinocchio_has_them(
    panda: Robot, model: PowerModel, plain: Trajectory
) -> None:
    limits = Power(90.0), ToolSpeed(panda.body, tool_of(panda.body, TCP), 0.5)
    found = certify(plain, Scorer(panda, model), limits, samples=4000)
    power, speed = peaks(panda, plain, "panda_hand_tcp", 0.02)
    assert found.peak_power == pytest.approx(power, rel=1e-5)
    assert found.max_violation["power"] == pytest.approx(power / 90.0 - 1, rel=1e-4)
    assert found.max_violation["tool_speed"] == pytest.approx(speed / 0.5 - 1, rel=1e-4)
    half = certify(plain, Scorer(panda, model), [limit.scaled(0.5) for limit in limits], samples=4000)
    assert half.max_violation["tool_speed"] == pytest.approx(2 * speed / 0.5 - 1, rel=1e-4)


def test_use_along_a_path_is_the_law_of_the_motion(panda: Robot, model: PowerModel) -> None:
    law = model.replaced(CoulombFriction(tau_c=1.0)).replaced(Regeneration(efficiency=0.3))
    d = PathDynamics(panda, law, straight(START, GOAL), np.linspace(0.05, 0.95, 7))
    rng = np.random.default_rng(2)
    a, b = rng.normal(size=7), rng.uniform(0.05, 0.8, 7)
    tool = tool_of(panda.body, TCP)
    v, acceleration = d.q1 * np.sqrt(b)[:, None], d.q1 * a[:, None] + d.q2 * b[:, None]
    _, power, _ = Scorer(panda, law).drive(d.q, v, acceleration, np.zeros(7))
    assert Power(70.0).use(d, a, b)[:, 0] == pytest.approx(power / 70.0, rel=1e-12)
    speed = np.linalg.norm(panda.body.frame_motion(tool.joint, np.array(tool.pose), d.q, v, acceleration)[1], axis=1)
    limit = ToolSpeed(panda.body, tool, 0.4)
    line = limit.linear(d, 1.0)
    assert line.of_speed and (line.rb[:, 0] * b) == pytest.approx((speed / 0.4) ** 2, rel=1e-12)


@pytest.mark.parametrize("mode", ["retime", "reshape"])
def test_a_solved_move_holds_power_and_tool_speed(
    panda: Robot, model: PowerModel, mode: str, plain: Trajectory
) -> None:
    asked = {"max_power": 101.0, "tool_speed": 0.85, "tool": TCP}
    move = Move(START, GOAL, mode, duration=1.8)
    result = Planner(panda, model, Settings(**MOVE, **asked)).solve(move)
    power, speed = peaks(panda, result.trajectory, "panda_hand_tcp", 0.02)
    assert result.status == "solved"
    assert power <= 101.0 * (1 + 1e-6) and speed <= 0.85 * (1 + 1e-6)
    assert max(power / 101.0, speed / 0.85) > 0.99  # something binds
    document = result.document()
    assert document["peak_power"] == pytest.approx(power, rel=1e-4)
    assert set(document["certificate"]["max_violation"]) >= {"position", "effort", "power", "tool_speed"}
    free = Planner(panda, model, Settings(**MOVE)).solve(move)
    assert max(peaks(panda, free.trajectory, "panda_hand_tcp", 0.02) / np.array([101.0, 0.85])) > 1.02
    assert free.energy.total < result.energy.total


@pytest.mark.slow
def test_a_power_limit_is_held_where_the_solver_s_law_is_smoothed(panda: Robot) -> None:
    """What flows back is lost, and the smooth clamp lies below the sharp one: rows that hold it alone do not do."""
    model = named_model("careful", "panda")
    limit = {"max_power": 101.0, "compile": "never"}
    result = Planner(panda, model, Settings(**limit)).solve(Move(START, GOAL, "retime", duration=2.0))
    assert result.status == "solved" and result.chosen == "retime"
    t = np.linspace(0.0, 2.0, 8001)
    _, power, _ = Scorer(panda, model).drive(*result.trajectory.sample(t)[:3], t)
    assert 100.9 < power.max() <= 101.0 * (1 + 1e-6)


def test_the_fastest_under_a_power_limit_is_nearly_time_optimal(panda: Robot, model: PowerModel) -> None:
    path, limits = straight(START, GOAL), limits_of(panda, Settings(max_power=100.0))
    found = fastest(panda, model, path, limits=limits)
    power, _ = peaks(panda, found.trajectory(panda.joints))
    assert 99.0 < power <= 100.0 * (1 + 1e-6)
    plain = fastest(panda, model, path)
    factor = 1.0
    while peaks(panda, plain.slowed(factor * plain.duration).trajectory(panda.joints))[0] > 100.0:
        factor *= 1.3
    assert found.duration < 0.7 * factor * plain.duration  # slowing evenly takes far longer


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["retime", "reshape"])
def test_a_plan_under_several_models_holds_power_under_each(panda: Robot, model: PowerModel, mode: str) -> None:
    """Braking, the model that returns energy draws less, and holding a pose without friction it draws more: the mean
    of the models' powers was held, and one of them was above the limit."""
    careful = named_model("careful", "panda")
    planner = RobustPlanner(panda, [Rival("paper", model), Rival("careful", careful)], settings=Settings(**MOVE))
    limit = 0.95 * planner.solve(Move(START, GOAL, mode, duration=1.6)).certificate.peak_power
    held = RobustPlanner(
        panda, [Rival("paper", model), Rival("careful", careful)], settings=Settings(max_power=limit, **MOVE)
    ).solve(Move(START, GOAL, mode, duration=1.6))
    t = np.linspace(0.0, 1.6, 8001)
    powers = [
        peaks(panda, held.trajectory)[0],
        Scorer(panda, careful).drive(*held.trajectory.sample(t)[:3], t)[1].max(),
    ]
    assert held.status == "solved" and 0.995 * limit < max(powers) <= limit * (1 + 1e-6)


def test_a_retiming_holds_velocity_where_the_tool_s_speed_bounds_the_path_beside() -> None:
    """The bounds of control values left room for velocity there, and no constraint held it: not converged."""
    start = [1.407925, -0.713441, -1.677542, 1.339433, -0.972954, 1.207727, -0.820439]
    goal = [1.352286, 1.047011, -1.103465, 0.515126, -0.518626, 0.286569, 0.417176]
    xarm7 = load_robot("xarm7")
    result = Planner(xarm7, source_method_2("xarm7"), Settings(tool_speed=1.224)).solve(Move(start, goal, "retime"))
    assert result.status == "solved", result.message


@pytest.mark.slow
def test_a_retiming_that_narrow_kinks_stop_ends_with_wider_ones() -> None:
    """Power under two models, one of them with friction: at the narrowest width the solver found no step."""
    result = optimize(
        "ur10e", payload=(0.521, 0.006, -0.009, 0.073), mode="retime", max_power=495.0, self_collision=False,
        start=[0.933700, 1.426920, 1.383486, -1.016107, -0.243987, -1.551293],
        goal=[0.589423, 0.570258, -0.635025, -1.158145, -0.795170, 0.356783],
    )  # fmt: skip
    assert result.status == "solved", result.message
    assert [row["saving_joules"] > 0 for row in result.models] == [True, True]


def test_tool_speed_keeps_retiming_convex(panda: Robot, model: PowerModel) -> None:
    result = Planner(panda, model, Settings(tool_speed=0.7)).solve(Move(START, GOAL, "retime", duration=1.8))
    assert result.status == "solved" and result.optimality.kind == "global"
    assert peaks(panda, result.trajectory)[1] <= 0.7 * (1 + 1e-6)


def test_impossible_requests_are_reported(panda: Robot, model: PowerModel) -> None:
    said = r"^start: max_power 80 is too small: .* \(88.04 W of it is standby\); give at least 9\d W"
    with pytest.raises(Infeasible, match=said) as caught:
        Planner(panda, model, Settings(max_power=80.0)).solve(Move(START, GOAL, duration=2.0))
    assert caught.value.limit == "power"
    for wrong in ({"max_power": -1.0}, {"tool_speed": 0.0}, {"tool_speed": 1.0, "tool": "nothing"}):
        with pytest.raises(BadInput):
            Planner(panda, model, Settings(**wrong))
    assert [limit.name for limit in limits_of(panda, Settings(max_power=1e3, tool_speed=2.0))][-2:] == [
        "power",
        "tool_speed",
    ]


def test_options(tmp_path, capsys) -> None:
    words = ["optimize", "--robot", "panda", "--start", "0,-0.785,0,-2.356,0,1.571,0.785", "--goal"]
    words += ["0.2,-0.6,0.1,-2.2,0,1.6,0.7", "--mode", "retime", "--out", str(tmp_path), "--json", "--quiet"]
    words += ["--model", "source-method-2", "--self-collision", "off"]
    assert main([*words, "--max-power", "50"]) == 3
    capsys.readouterr()
    assert main([*words, "--max-power", "150", "--tool-speed", "0.2", "--tool", "panda_hand"]) == 0
    found = capsys.readouterr().out
    assert '"tool_speed": ' in found and '"peak_power": ' in found
    assert main([*words, "--tool-speed", "0.2", "--tool", "hand"]) == 2
