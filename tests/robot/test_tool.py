"""A tool's forward kinematics: symbolic and numeric against Pinocchio's own frames, Jacobian included."""

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from energy_opt.dynamics.compact import tool_state
from energy_opt.errors import BadInput
from energy_opt.robot import Robot, Tool, load_robot, tool_of

RNG = np.random.default_rng(11)
SLIDE = """<robot name="slide"><link name="base"/><link name="a"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link><link name="b"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link><link name="c"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="a"/><origin xyz="0.1 0.2 0.3" rpy="0.3 -0.2 0.5"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="1" effort="100"/></joint>
<joint name="slide" type="prismatic"><parent link="a"/><child link="b"/><origin xyz="0 0.4 0.1" rpy="1 0.1 -0.4"/>
<axis xyz="0.6 0 0.8"/><limit lower="-1" upper="1" velocity="1" effort="100"/></joint>
<joint name="wrist" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0.2 0 0.1" rpy="0 0.7 0"/>
<axis xyz="1 0 0"/><limit lower="-3" upper="3" velocity="1" effort="100"/></joint></robot>"""


@pytest.fixture(scope="module")
def arms(panda: Robot, tmp_path_factory: pytest.TempPathFactory) -> list[tuple[Robot, str]]:
    slide = tmp_path_factory.mktemp("arms") / "slide.urdf"
    slide.write_text(SLIDE)
    kinova = load_robot("kinova")  # continuous joints
    last = kinova.joints[-1]
    return [(panda, "panda_hand,0.01,-0.02,0.1"), (load_robot(str(slide)), "c,0.1,0.2,-0.3"), (kinova, last)]


def by_pinocchio(robot: Robot, tool: Tool, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> list[np.ndarray]:
    """Pose, velocity, classical acceleration and Jacobian of the tool, from a frame added to Pinocchio's own model."""
    model = pin.buildModelFromUrdf(str(robot.urdf))
    full = pin.neutral(model)
    if robot.locked:
        for name, where in robot.locked.items():
            full[model.joints[model.getJointId(name)].idx_q] = where
        model = pin.buildReducedModel(model, [model.getJointId(name) for name in robot.locked], full)
    frame = pin.Frame("tool", tool.joint + 1, 0, pin.SE3(np.array(tool.pose)), pin.FrameType.OP_FRAME)
    number = model.addFrame(frame)
    data, c = model.createData(), robot.body.configuration(q)
    pin.forwardKinematics(model, data, c, v, a)
    pin.updateFramePlacements(model, data)
    there = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    return [
        data.oMf[number].homogeneous,
        pin.getFrameVelocity(model, data, number, there).linear,
        pin.getFrameClassicalAcceleration(model, data, number, there).linear,
        pin.computeFrameJacobian(model, data, c, number, there)[:3],
    ]


def test_symbolic_and_numeric_kinematics_are_pinocchios(arms: list[tuple[Robot, str]]) -> None:
    for robot, words in arms:
        n, tool = robot.n, tool_of(robot.body, words)
        q, v, a = (ca.SX.sym(name, n) for name in "qva")
        state = tool_state(robot.body.tree(), tool, q, v, a)
        turned = [ca.mtimes(state.rotation, x) for x in (state.velocity, state.acceleration)]
        jacobian = ca.jacobian(state.position, q)
        whole = ca.Function("tool", [q, v, a], [state.position, state.rotation, *turned, jacobian])
        for _ in range(5):
            at = RNG.uniform(-2, 2, n), RNG.normal(size=n), RNG.normal(size=n)
            pose, velocity, acceleration, slope = by_pinocchio(robot, tool, *at)
            ours = [np.array(x) for x in whole(*at)]
            assert ours[0].ravel() == pytest.approx(pose[:3, 3], abs=1e-12)
            assert ours[1] == pytest.approx(pose[:3, :3], abs=1e-12)
            assert ours[2].ravel() == pytest.approx(velocity, abs=1e-11)
            assert ours[3].ravel() == pytest.approx(acceleration, abs=1e-10)
            assert ours[4] == pytest.approx(slope, abs=1e-11)
            numeric = robot.body.frame_motion(tool.joint, np.array(tool.pose), *(x[None] for x in at))
            for one, other in zip(numeric, (pose, velocity, acceleration), strict=True):
                assert one[0] == pytest.approx(other, abs=1e-12)


def test_tools_are_named_by_joint_or_link(panda: Robot) -> None:
    assert tool_of(panda.body).joint == 6 and (np.array(tool_of(panda.body).pose) == np.eye(4)).all()
    shifted = tool_of(panda.body, "panda_link7,0,0,0.2")
    assert shifted.joint == 6 and np.array(shifted.pose)[2, 3] == pytest.approx(0.2)
    for words in ("nothing", "panda_link0", "panda_link7,1,2", "panda_link7,a,b,c", "panda_link7,nan,0,0"):
        with pytest.raises(BadInput, match="tool"):
            tool_of(panda.body, words)
    for words, says in (("panda_link7,0,0,103", "are these millimetres"), ("panda_link7,0,0,0,0,0,90", "in degrees")):
        with pytest.raises(BadInput, match=says):
            tool_of(panda.body, words)
