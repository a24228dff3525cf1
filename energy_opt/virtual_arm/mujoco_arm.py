"""The forward simulation: MuJoCo moves the arm of a URDF, and a tracking controller drives it.

    (M + armature) dv/dt + bias(q, v) + D v + spring + specials = u

The controller is a stiff PD in every joint, u = kp e + kd de/dt, plus the gravity and Coriolis torque of MuJoCo's own
arm and a feed-forward of friction and springs. It uses no inverse dynamics of this package.

Friction and the PD's dependence on v enter through `dof_damping`, which is set at each step. MuJoCo's Euler step treats
damping implicitly. So the arm is stable at any gain and any friction, and comes to rest without chatter.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from energy_opt.errors import BadInput
from energy_opt.robot import Robot
from energy_opt.virtual_arm.drives import JointLaws
from energy_opt.virtual_arm.plant import Plant

STEP = 1e-3  # [s] time step
SETTLING = 0.4  # [s] time before a motion in which the controller settles
BANDWIDTH = 100.0  # [rad/s] bandwidth of the critically damped tracking controller
REST_HEADING = 2e-3  # [rad/s] a slower joint has no direction yet
NOMINAL_INERTIA = 0.5  # [kg m^2] inertia that the gains assume besides the arm's own

# Replaced by the true inertia in the compiled model: MuJoCo refuses inertias that no rigid body can have, which
# some published URDFs contain, and must not simplify for a centred or aligned inertia here.
PLACEHOLDER = {
    "mass": 1.0, "ipos": [0.1, 0.2, 0.3], "iquat": [0.8, 0.4, 0.2, 0.4], "inertia": [0.3, 0.25, 0.2],
    "fullinertia": np.full(6, np.nan), "explicitinertial": True,
}  # fmt: skip

CARRIED = "carried by the arm"  # no link has such a name
Inertial = tuple[float, np.ndarray, np.ndarray]  # mass [kg], its centre (3,) [m], inertia about it (3, 3) [kg m^2]


def import_mujoco() -> Any:
    """The mujoco module; BadInput with installation advice if it is missing."""
    try:
        import mujoco
    except ImportError:
        raise BadInput("simulate needs MuJoCo, which is not installed: pip install 'energy-opt[sim]'") from None
    return mujoco


@dataclass(frozen=True)
class Played:
    """The true motion of one run, at the middle of each time step.

    Attributes:
        time: (N,) s, from 0.
        position, velocity, torque: (N, n) rad, rad/s and N m (the motor's torque at the joint side).
    """

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    torque: np.ndarray


class MujocoArm:
    """A robot with the plant's payload, tilt, rotor inertia and joint torques, ready to be driven.

    Args:
        robot: the arm. plant: its true drives.

    Raises:
        BadInput: the arm has followers, or the plant does not fit it, or MuJoCo is not installed.
    """

    def __init__(self, robot: Robot, plant: Plant) -> None:
        plant.check(robot.n)
        for name, (leader, _, _) in robot.followers.items():
            raise BadInput(
                f"{name} follows {leader} (mimic), which the virtual arm does not support; use --lock {leader}=VALUE"
            )
        self.mujoco = import_mujoco()
        self.joints = tuple(robot.joints)
        armature = plant.value("armature", "inertia", robot.n)
        self.armature = np.zeros(robot.n) if armature is None else np.array(armature)
        self.laws = JointLaws(plant, robot.n)
        self.model = self._compile(robot, plant.number("payload", "mass", 0.0), plant.value("payload", "com"))
        if tuple(self.model.joint(k).name for k in range(self.model.njnt)) != self.joints:
            raise BadInput(f"{robot.urdf}: joints {', '.join(self.joints)} are not in the order of the kinematic tree")
        roll, pitch = (plant.number("base_tilt", name, 0.0) for name in ("roll", "pitch"))
        tilt = Rotation.from_euler("xy", [roll, pitch]).as_matrix()
        self.model.opt.gravity[:] = tilt.T @ np.asarray(robot.body.gravity)
        self.data = self.mujoco.MjData(self.model)

    def _compile(self, robot: Robot, payload: float, com: np.ndarray | None) -> Any:
        """MuJoCo's model of the robot's URDF. True masses and inertias are written into the compiled model.

        Args:
            robot: the arm; joints that it holds are welded. payload: a point mass [kg] at `com` (3,) [m] in the last
                joint's frame.

        Raises:
            BadInput: MuJoCo cannot read the URDF.
        """
        mujoco = self.mujoco
        text, inertials = _urdf_without_shapes(robot.urdf)
        try:
            spec = mujoco.MjSpec.from_string(text)
        except ValueError as error:
            raise BadInput(f"{robot.urdf}: MuJoCo cannot read it: {' '.join(str(error).split())}") from None
        spec.compiler.fusestatic = False
        spec.option.timestep, spec.option.integrator = STEP, mujoco.mjtIntegrator.mjINT_EULER
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        rotors = dict(zip(self.joints, self.armature.tolist(), strict=True))
        for joint in list(spec.joints):
            if joint.name in rotors:
                joint.armature = rotors[joint.name]
            else:
                _fix_joint(mujoco, joint, robot.locked.get(joint.name, 0.0))
                spec.delete(joint)
        if payload > 0 and com is not None:
            spec.joint(self.joints[robot.body.last]).parent.add_body(name=CARRIED, pos=com)
            inertials[CARRIED] = payload, np.zeros(3), np.zeros((3, 3))
        bodies = spec.bodies[1:]  # the first is the world
        for body in bodies:
            for name, value in PLACEHOLDER.items():
                setattr(body, name, value)
        model = spec.compile()
        for body in bodies:
            mass, centre, inertia = inertials[body.name]
            model.body_mass[body.id], model.body_ipos[body.id] = mass, centre
            model.body_inertia[body.id], axes = np.linalg.eigh(inertia)
            axes[:, 0] *= np.linalg.det(axes)
            mujoco.mju_mat2Quat(model.body_iquat[body.id], axes.ravel())
        return model

    def inverse(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """MuJoCo's own inverse dynamics, armature included and friction left out: torque (N, n) at q, v, a (N, n)."""
        d = self.data
        self.model.dof_damping[:] = 0
        out = np.empty_like(q)
        for k in range(len(q)):
            d.qpos[:], d.qvel[:], d.qacc[:] = q[k], v[k], a[k]
            self.mujoco.mj_inverse(self.model, d)
            out[k] = d.qfrc_inverse
        return out

    def _inertia(self) -> np.ndarray:
        """Diagonal of the mass matrix in the present pose, (n,)."""
        n = len(self.joints)
        column, out = np.empty(n), np.empty(n)
        for j, unit in enumerate(np.eye(n)):
            self.mujoco.mj_mulM(self.model, self.data, column, unit)
            out[j] = column[j]
        return out

    def play(self, position: np.ndarray, velocity: np.ndarray) -> Played:
        """Follow a reference given at every time step, (N, n) rad and rad/s; starts at rest, settled on its first row.

        Raises:
            BadInput: the arm does not follow (the reference jumps, or is beyond what the controller can do).
        """
        mujoco, m, d, laws = self.mujoco, self.model, self.data, self.laws
        settling = round(SETTLING / STEP)
        # The goal of a step is the reference at its end.
        goals = np.clip(np.arange(-settling, len(position)) + 1, 0, len(position) - 1)
        n = position.shape[1]
        mujoco.mj_resetData(m, d)
        q, v, bias, applied, passive = d.qpos, d.qvel, d.qfrc_bias, d.qfrc_applied, d.qfrc_passive
        damping, rest = m.dof_damping, np.zeros(n)
        q[:] = position[0]
        v[:] = 0
        mujoco.mj_forward(m, d)
        kp = BANDWIDTH**2 * (self._inertia() + NOMINAL_INERTIA)
        kd = 2 * kp / BANDWIDTH
        tau = bias.copy()
        travel, heading = np.ones(n), np.zeros(n)
        steps = len(position)
        qs, vs, us = np.empty((steps + 1, n)), np.empty((steps + 1, n)), np.empty((steps, n))
        for k, row in enumerate(goals):
            mujoco.mj_step1(m, d)
            goal_v = rest if row == 0 else velocity[row]
            friction = laws.damping(v, tau)
            known = laws.compensated_torque(q, v, tau)
            # u = push - pull v+, v+ the speed at the end of the step
            pull = kd + STEP * kp
            push = kp * (position[row] - q) + kd * goal_v + bias + known + laws.damping(goal_v, tau) * goal_v
            unknown: np.ndarray | float = 0.0
            if laws.specials:
                moving = np.abs(v) > REST_HEADING
                travel = np.where(moving & (v * heading < 0), 0.0, travel + np.abs(v) * STEP)
                heading = np.where(moving, np.sign(v), heading)
                unknown = laws.disturbance_torque(q, v, travel)
            applied[:] = push - known - unknown
            damping[:] = friction + pull
            passive[:] = -damping * v
            j = k - settling
            if j >= 0:
                qs[j], vs[j] = q, v
            before = v.copy()
            mujoco.mj_step2(m, d)
            u = push - pull * v
            if j >= 0:
                us[j] = u
            # Torque on the rigid body: the motor's torque less that of joint and rotor.
            tau = u - known - unknown - friction * v - self.armature * (v - before) / STEP
        qs[-1], vs[-1] = q, v
        error = np.abs(position - qs[:-1]).max(axis=0)
        worst = int(np.nanargmax(np.where(np.isfinite(error), error, np.inf)))
        if not error[worst] < 0.1:
            raise BadInput(
                f"the virtual arm does not follow the trajectory: joint {self.joints[worst]} is off by "
                f"{error[worst]:.3g} rad (or m); is the trajectory smooth and within the robot's limits?"
            )
        time = (np.arange(steps) + 0.5) * STEP
        return Played(time, (qs[1:] + qs[:-1]) / 2, (vs[1:] + vs[:-1]) / 2, us)

    def hold(self, position: np.ndarray, duration: float) -> Played:
        """Hold a pose (n,) [rad]: the settled torque throughout."""
        steps = round(duration / STEP)
        few = self.play(np.tile(position, (2, 1)), np.zeros((2, len(position))))
        q, u = (np.repeat(x[-1:], steps, axis=0) for x in (few.position, few.torque))
        return Played((np.arange(steps) + 0.5) * STEP, q, np.zeros_like(q), u)


COUNT = ("origin", "parent", "child", "axis")  # elements of joints that place and move links


def _urdf_without_shapes(urdf: Path) -> tuple[str, dict[str, Inertial]]:
    """The text of a URDF's tree of joints, without shapes and limits; and the inertia of each link by name."""
    root = ElementTree.parse(urdf).getroot()
    inertials = {str(link.get("name")): _inertial(link.find("inertial")) for link in root.findall("link")}
    for element in list(root):
        if element.tag not in ("link", "joint"):
            root.remove(element)
        for part in [part for part in element if part.tag not in COUNT]:
            element.remove(part)
    return ElementTree.tostring(root, encoding="unicode"), inertials


def _inertial(given: ElementTree.Element | None) -> Inertial:
    """Mass, centre and inertia from an <inertial>; a loaded robot has all these numbers.

    A link without one has no mass.
    """
    numbers = {} if given is None else {key: text for part in given.iter() for key, text in part.attrib.items()}
    place, rpy = (np.array([float(x) for x in numbers.get(key, "0 0 0").split()]) for key in ("xyz", "rpy"))
    xx, yy, zz, xy, xz, yz = (float(numbers.get(f"i{key}", "0")) for key in ("xx", "yy", "zz", "xy", "xz", "yz"))
    turn = Rotation.from_euler("xyz", rpy).as_matrix()  # as URDF defines roll, pitch and yaw
    return float(numbers.get("value", "0")), place, turn @ [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]] @ turn.T


def _fix_joint(mujoco: Any, joint: Any, position: float) -> None:
    """Move the body of a joint to where the joint is at `position` [rad, m]."""
    body, turn, way = joint.parent, np.zeros(4), np.zeros(3)
    if joint.type == mujoco.mjtJoint.mjJNT_SLIDE:
        mujoco.mju_rotVecQuat(way, position * np.array(joint.axis), body.quat)
        body.pos = body.pos + way
    else:
        mujoco.mju_axisAngle2Quat(turn, joint.axis, position)
        mujoco.mju_mulQuat(turn, body.quat, turn.copy())
        body.quat = turn
