"""Symbolic inverse dynamics against Pinocchio's numbers, for every robot and every source."""

from __future__ import annotations

import sys
import types
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from energy_opt.dynamics import SOURCES, compact, pinocchio_casadi, torque_function, verify
from energy_opt.errors import BadInput, EnergyOptError
from energy_opt.motion import Planner, Settings
from energy_opt.power import source_method_2
from energy_opt.robot import Link, PointMass, RigidBody, known_robots, load_robot

SLIDER = """<robot name="slider">
  <link name="base"/>
  <joint name="rail" type="prismatic"><parent link="base"/><child link="cart"/>
    <origin xyz="0.1 0 0.2" rpy="0.3 0.2 0.1"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="50" velocity="2"/></joint>
  <link name="cart"><inertial><mass value="2"/><origin xyz="0.02 0.01 0.03"/>
    <inertia ixx="0.01" ixy="0.001" ixz="0" iyy="0.02" iyz="0.002" izz="0.015"/></inertial></link>
  <joint name="swing" type="continuous"><parent link="cart"/><child link="pole"/>
    <origin xyz="0 0.05 0" rpy="0.1 -0.4 0.2"/><axis xyz="0.6 0 0.8"/><limit effort="20" velocity="3"/></joint>
  <link name="pole"><inertial><mass value="1"/><origin xyz="0 0 0.3"/>
    <inertia ixx="0.03" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.001"/></inertial></link>
  <joint name="lift" type="prismatic"><parent link="pole"/><child link="tip"/>
    <origin xyz="0 0 0.6"/><axis xyz="0 0.6 0.8"/><limit lower="0" upper="0.3" effort="20" velocity="1"/></joint>
  <link name="tip"><inertial><mass value="0.5"/><origin xyz="0.1 0 0"/>
    <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.002"/></inertial></link>
</robot>"""


@pytest.fixture
def slider(tmp_path: Path) -> RigidBody:
    """Prismatic, continuous and skew axes in one tree."""
    path = tmp_path / "slider.urdf"
    path.write_text(SLIDER)
    return load_robot(str(path)).body


def full_state(model: pin.Model, joints: tuple[str, ...], angles: np.ndarray, locked: dict[str, float]) -> np.ndarray:
    """Pinocchio's configuration of the whole URDF, built joint by joint without the library's help."""
    q = pin.neutral(model)
    for name, x in [*zip(joints, angles, strict=True), *locked.items()]:
        joint = model.joints[model.getJointId(name)]
        q[joint.idx_q : joint.idx_q + joint.nq] = [np.cos(x), np.sin(x)] if joint.nq == 2 else [x]
    return q


@pytest.mark.parametrize("name", known_robots())
def test_symbolic_torque_equals_rnea_of_the_whole_urdf(name: str) -> None:
    robot = load_robot(name)
    model = pin.buildModelFromUrdf(str(robot.urdf))  # grippers included, at the positions where they are locked
    data = model.createData()
    moving = [model.joints[model.getJointId(joint)].idx_v for joint in robot.joints]
    function = torque_function(robot.body)
    rng = np.random.default_rng(7)
    for _ in range(20):
        q, v, a = rng.uniform(-np.pi, np.pi, robot.n), rng.normal(size=robot.n), 3 * rng.normal(size=robot.n)
        full_v, full_a = np.zeros(model.nv), np.zeros(model.nv)
        full_v[moving], full_a[moving] = v, a
        expected = pin.rnea(model, data, full_state(model, robot.joints, q, robot.locked), full_v, full_a)[moving]
        tau = np.array(function(q, v, a, [0, 0, -9.81], 0, [0, 0, 0])).ravel()
        assert np.abs(tau - expected).max() <= 1e-10 * max(1.0, np.abs(expected).max())


@pytest.mark.parametrize("name", known_robots())
def test_derivatives_equal_rnea_derivatives(name: str) -> None:
    robot = load_robot(name)
    body = robot.body
    model = pin.buildModelFromUrdf(str(robot.urdf))
    data = model.createData()
    moving = [model.joints[model.getJointId(joint)].idx_v for joint in robot.joints]
    q, v, a = (ca.SX.sym(x, body.n) for x in ("q", "v", "a"))
    tau = torque_function(body)(q, v, a, ca.DM(body.gravity), 0, ca.DM.zeros(3))
    derivatives = ca.Function("d", [q, v, a], [ca.jacobian(tau, x) for x in (q, v, a)])
    rng = np.random.default_rng(3)
    for _ in range(5):
        state = (rng.uniform(-3, 3, body.n), rng.normal(size=body.n), rng.normal(size=body.n))
        full_v, full_a = np.zeros(model.nv), np.zeros(model.nv)
        full_v[moving], full_a[moving] = state[1:]
        angles = full_state(model, robot.joints, state[0], robot.locked)
        by_q, by_v, mass = pin.computeRNEADerivatives(model, data, angles, full_v, full_a)
        mass = np.triu(mass) + np.triu(mass, 1).T
        for got, whole in zip(derivatives(*state), (by_q, by_v, mass), strict=True):
            expected = whole[np.ix_(moving, moving)]
            assert np.abs(np.array(got) - expected).max() <= 1e-9 * max(1.0, np.abs(expected).max())


def test_prismatic_continuous_and_skew_axes(slider: RigidBody) -> None:
    assert verify(torque_function(slider), slider) < 1e-11


def test_the_tree_equals_the_urdf(slider: RigidBody) -> None:
    rail, swing, lift = slider.tree()
    assert (rail.prismatic, swing.prismatic, lift.prismatic) == (True, False, True)
    assert (rail.continuous, swing.continuous, lift.continuous) == (False, True, False)
    assert (rail.parent, swing.parent, lift.parent) == (-1, 0, 1)
    np.testing.assert_allclose(rail.axis, [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(swing.axis, [0.6, 0, 0.8], atol=1e-12)
    np.testing.assert_allclose(swing.lever, [0, 0, 0.3], atol=1e-12)
    assert (rail.mass, swing.mass, lift.mass) == (2, 1, 0.5)


def test_payload_and_gravity_are_inputs() -> None:
    """Turning gravity about the first axis changes nothing; a payload adds exactly a point mass's torque."""
    body = load_robot("ur5e").body
    function = torque_function(body)
    rng = np.random.default_rng(0)
    q, v, a = rng.normal(size=(3, body.n))
    com = np.array([0.03, -0.02, 0.1])
    loaded = np.array(function(q, v, a, body.gravity, 2.5, com)).ravel()
    np.testing.assert_allclose(loaded, body.torque(q, v, a, PointMass(2.5, com))[0], rtol=1e-11, atol=1e-11)

    turned = q.copy()
    turned[0] += 0.7
    side = np.array([3.0, 0.0, -9.0])
    c, s = np.cos(0.7), np.sin(0.7)
    rotated = np.array([c * side[0] - s * side[1], s * side[0] + c * side[1], side[2]])
    np.testing.assert_allclose(
        np.array(function(q, v, a, side, 1, com)), np.array(function(turned, v, a, rotated, 1, com)), atol=1e-10
    )


def test_compact_graph_is_at_most_as_long_as_measured() -> None:
    """Speed rests on short graphs: the Panda's torque takes at most 700 instructions (Pinocchio's own: 1132)."""
    body = load_robot("panda").body
    q, v, a = (ca.SX.sym(x, body.n) for x in ("q", "v", "a"))

    tau = torque_function(body)(q, v, a, ca.DM(body.gravity), 0, ca.DM.zeros(3))
    assert ca.Function("tau", [q, v, a], [tau]).n_instructions() <= 700


def test_a_wrong_function_is_refused() -> None:
    body = load_robot("z1").body
    good = compact.torque_function(body.tree())
    inputs = [ca.SX.sym(good.name_in(k), *good.size_in(k)) for k in range(good.n_in())]
    wrong = ca.Function("tau", inputs, [good(*inputs) * (1 + 1e-7)])
    with pytest.raises(EnergyOptError, match="differs from Pinocchio's"):
        verify(wrong, body)
    poisoned = ca.Function("tau", inputs, [good(*inputs) * ca.SX.nan()])
    with pytest.raises(EnergyOptError, match="differs from Pinocchio's"):
        verify(poisoned, body)


def test_unknown_and_absent_sources_are_bad_input(monkeypatch: pytest.MonkeyPatch) -> None:
    body = load_robot("z1").body
    with pytest.raises(BadInput, match="expected one of"):
        torque_function(body, "magic")
    monkeypatch.setitem(sys.modules, "pinocchio.casadi", None)
    for source in SOURCES:
        if source == "pinocchio":
            with pytest.raises(BadInput, match="not available"):
                torque_function(body, source)
        else:
            torque_function(body, source)


def test_the_planner_reports_a_missing_source_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pinocchio.casadi", None)
    with pytest.raises(BadInput, match="dynamics pinocchio: not available"):
        Planner(load_robot("z1"), source_method_2("z1"), Settings(dynamics="pinocchio"))


class _Stub(types.ModuleType):
    """`pinocchio.casadi` as far as it is used, its recursion replaced by the compact one."""

    class Motion:
        def __init__(self, linear: ca.SX, angular: ca.SX) -> None:
            assert linear.shape == angular.shape == (3, 1)
            self.linear = linear

    class Inertia:
        def __init__(self, mass: ca.SX, lever: ca.SX, inertia: ca.SX) -> None:
            assert inertia.shape == (3, 3)
            self.mass, self.lever = mass, lever

        def __add__(self, other: _Stub.Inertia) -> _Stub.Inertia:
            assert self.mass is None, "the payload belongs to the last link, once"
            return other

    def __init__(self, tree: tuple[Link, ...]) -> None:
        super().__init__("pinocchio.casadi")
        self.tree = tree

    def Model(self, model: pin.Model) -> types.SimpleNamespace:
        empty = _Stub.Inertia(None, None, ca.SX.zeros(3, 3))
        return types.SimpleNamespace(nq=model.nq, inertias=[empty] * model.njoints, createData=lambda: None)

    def rnea(self, model: types.SimpleNamespace, data: None, q: ca.SX, v: ca.SX, a: ca.SX) -> ca.SX:
        assert q.shape == (model.nq, 1)
        angles, at = [], 0
        for link in self.tree:
            angles.append(ca.atan2(q[at + 1], q[at]) if link.continuous else q[at])
            at += 2 if link.continuous else 1
        load = model.inertias[-1]
        return compact.torque_function(self.tree)(
            ca.vertcat(*angles), v, a, model.gravity.linear, load.mass, load.lever
        )


@pytest.mark.parametrize("name", ["panda", "kinova", "ur3e"])
def test_pinocchio_casadi_is_driven_rightly(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """No wheel has `pinocchio.casadi`; what it is handed and what is made of its answer can be tested."""
    body = load_robot(name).body
    stub = _Stub(body.tree())
    monkeypatch.setitem(sys.modules, "pinocchio.casadi", stub)
    monkeypatch.setattr(pin, "casadi", stub, raising=False)
    function = pinocchio_casadi.torque_function(body)
    assert function is not None
    assert verify(function, body) < 1e-11


@pytest.mark.parametrize("quarter", [1.5708, 1.570796, 1.57])
def test_rounded_quarter_turns_leave_the_torque_exact(quarter: float, tmp_path: Path) -> None:
    """Origins slid by kilometres along axes that are nearly at right angles: one arm in twenty was refused."""
    body = (
        '<inertial><mass value="2"/><inertia ixx="0.02" ixy="0.001" ixz="0" iyy="0.03" iyz="0" izz="0.025"/></inertial>'
    )
    for seed in range(40):
        rng, parts = np.random.default_rng(seed), ['<robot name="arm"><link name="l0"/>']
        for k in range(1, int(rng.integers(5, 8)) + 1):
            place = " ".join(f"{x:.3f}" for x in rng.uniform(-0.4, 0.4, 3) * (rng.random(3) < 0.5))
            turn = " ".join(f"{x:.6f}" for x in rng.choice([0, quarter, -quarter, 2 * quarter], 3))
            parts.append(
                f'<link name="l{k}">{body}</link><joint name="j{k}" type="revolute"><parent link="l{k - 1}"/>'
                f'<child link="l{k}"/><origin xyz="{place}" rpy="{turn}"/><axis xyz="0 0 1"/>'
                '<limit lower="-3" upper="3" velocity="9" effort="900"/></joint>'
            )
        path = tmp_path / f"{seed}.urdf"
        path.write_text("\n".join([*parts, "</robot>"]))
        torque_function(load_robot(str(path)).body)
