"""Physics on random robots: chains of 1 to 14 joints, trees, sliding and endless joints, against `independent.py`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from independent import Arm, judged

import energy_opt as eo
from energy_opt.motion.judge.energy import Scorer

FREE = ("fixed", "revolute", "revolute", "continuous", "prismatic")


def _row(rng: np.random.Generator, size: float) -> str:
    return " ".join(f"{x:.6f}" for x in rng.uniform(-size, size, 3))


def random_urdf(rng: np.random.Generator, joints: int, tree: bool) -> str:
    """A robot of so many moving joints; in a tree every link hangs from any earlier one."""
    parts, moving, k = ['<robot name="r"><link name="l0"/>'], 0, 0
    while moving < joints:
        k += 1
        kind = str(rng.choice(FREE))
        moving += kind != "fixed"
        parent = int(rng.integers(k)) if tree else k - 1
        root = rng.normal(size=(3, 3)) * 0.1
        inertia = root @ root.T + 0.01 * np.eye(3)  # the sum of squares below makes any such matrix a body's
        inertia = np.trace(inertia) * np.eye(3) - inertia
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = inertia
        parts.append(
            f'<link name="l{k}"><inertial><origin xyz="{_row(rng, 0.2)}" rpy="{_row(rng, 3)}"/>'
            f'<mass value="{rng.uniform(0.1, 3):.6f}"/><inertia ixx="{xx}" ixy="{xy}" ixz="{xz}" iyy="{yy}" iyz="{yz}" '
            f'izz="{zz}"/></inertial></link><joint name="j{k}" type="{kind}"><parent link="l{parent}"/>'
            f'<child link="l{k}"/><origin xyz="{_row(rng, 0.3)}" rpy="{_row(rng, 3)}"/><axis xyz="{_row(rng, 1)}"/>'
            '<limit lower="-3" upper="3" velocity="9" effort="900"/></joint>'
        )
    return "\n".join([*parts, "</robot>"])


def motion(robot: eo.Robot, rng: np.random.Generator) -> eo.Trajectory:
    """A closed path that begins and ends at rest, sampled densely."""
    t = np.linspace(0, 2, 401)
    turn = np.pi * t[:, None]
    size, shape = rng.uniform(-1, 1, robot.n), rng.uniform(-0.4, 0.4, robot.n)
    q = size * np.sin(turn) ** 2 + shape * (1 - np.cos(turn)) ** 2 * np.sin(turn)
    v, a = (_derivative(size, shape, turn, order) for order in (1, 2))
    return eo.Trajectory(robot.joints, t, q, v, a)


def _derivative(size: np.ndarray, shape: np.ndarray, x: np.ndarray, order: int) -> np.ndarray:
    """By t, of size sin(x)^2 + shape (1 - cos x)^2 sin x as sums of sines and cosines; x = pi t."""
    out = np.zeros((len(x), len(size)))
    # sin^2 x = (1 - cos 2x) / 2; (1 - cos x)^2 sin x = 5/4 sin x - sin 2x + 1/4 sin 3x
    waves = [(size * -0.5, 2, np.cos), (shape * 1.25, 1, np.sin), (-shape, 2, np.sin), (shape * 0.25, 3, np.sin)]
    for gain, k, wave in waves:
        if order == 1:
            out += gain * k * np.pi * (np.cos(k * x) if wave is np.sin else -np.sin(k * x))
        else:
            out -= gain * (k * np.pi) ** 2 * wave(k * x)
    return out


@pytest.mark.parametrize("seed", range(10))
def test_energy_of_random_robots(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    joints, tree = (1, 2, 3, 5, 7, 14, 4, 6, 9, 12)[seed], seed % 2 == 1
    text = random_urdf(rng, joints, tree)
    (tmp_path / "r.urdf").write_text(text)
    robot = eo.load_robot(str(tmp_path / "r.urdf"))
    assert robot.n == joints
    t, copper, standby = motion(robot, rng), rng.uniform(1e-3, 1e-2, joints), 30.0
    arm = Arm(text, robot.joints)
    mine = robot.body.torque(t.position, t.velocity, t.acceleration)
    other = arm.torque(t.position, t.velocity, t.acceleration)
    assert np.abs(mine - other).max() < 1e-9 * np.abs(other).max()

    model = eo.PowerModel("r", (eo.Standby(power=standby), eo.CopperLoss(r_over_kt2=copper.tolist())))
    energy = Scorer(robot, model).energy(t)
    bounds = {"lower": np.full(joints, -9.0), "upper": np.full(joints, 9.0)}
    bounds |= dict.fromkeys(("velocity", "acceleration", "jerk", "effort"), np.full(joints, 1e9))
    second, _ = judged(arm, bounds, standby, copper, (t.time, t.position, t.velocity, t.acceleration))
    assert energy.total == pytest.approx(second, rel=1e-8)

    bare = Scorer(robot, eo.PowerModel("r", ())).energy(t)  # nothing is lost, and the path is closed
    assert abs(bare.total) < 1e-6 * np.abs(other).max()
    for effect in (
        eo.CoulombFriction(tau_c=0.3), eo.ViscousFriction(b=0.2), eo.StribeckFriction(tau_s=0.2, v_s=0.1),
        eo.GearEfficiency(eta=0.8), eo.InverterLoss(c=0.1), eo.IronLoss(hysteresis=0.2, eddy=0.1),
        eo.MotionPower(power=5.0),
    ):  # fmt: skip
        with_effect = Scorer(robot, model + effect).energy(t).total
        assert with_effect >= energy.total * (1 - 1e-9), effect.name
