"""The rigid body of an arm: Pinocchio behind plain arrays. This is the only module that imports pinocchio.

Positions are angles [rad] for every revolute joint, continuous ones included, and lengths [m] for prismatic ones.
Pinocchio's model contains all joints of the tree as independent ones. Vectors here contain the independent joints only
(see `kinematics.Coupling`); indices of joints are those of the tree.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from energy_opt.errors import BadInput, suggest
from energy_opt.robot.checks import NOISE, inertia_matrix, placed
from energy_opt.robot.description import MOVING, Description
from energy_opt.robot.kinematics import Coupling, Follows, Link, PointMass, fingers, outermost

FEW = 50  # [states] from this number on, Pinocchio's own loop over many is worth its setup


ONE_JOINT = (
    '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="{}"><parent link="a"/><child link="b"/>'
    '<axis xyz="{}"/><limit lower="0" upper="0" velocity="0" effort="0"/></joint></robot>'
)


def _inertia(mass: float, lever: np.ndarray, inertia: np.ndarray) -> pin.Inertia:
    """Pinocchio's inertia of a link, also of an impossible one, which its constructor refuses."""
    body = pin.Inertia.Zero()
    body.mass, body.lever, body.inertia = mass, lever, inertia
    return body


def _built(description: Description, lock: Mapping[str, float]) -> pin.Model:
    """Pinocchio's model of a description, depth first, joints of one link by their names; joints of `lock` are fixed.

    Raises:
        BadInput: a joint of `lock` is not known, or a joint has more than one degree of freedom.
    """
    model, children = pin.Model(), dict[str, list[str]]()
    for name in sorted(description.joints):
        children.setdefault(description.joints[name].parent, []).append(name)
    moving = [name for name, joint in description.joints.items() if joint.kind in MOVING]
    for name in lock:
        if name not in moving:
            hint = f"{suggest(name, moving)}; joints are {', '.join(moving)}"
            raise BadInput(f"{description.path}: cannot lock {name!r}{hint}")

    ahead: list[tuple[str, int, pin.SE3]] = []  # joints that are still to come, with the joint and frame they hang on

    def hang(link: str, on: int, at: pin.SE3) -> None:
        """Hang a link on joint `on`, at a placement in its frame; the joints beyond it are next."""
        model.addBodyFrame(link, on, at, 0)
        given = description.links[link].inertial
        if given is not None:
            turn = placed(given.pose)[:3, :3]
            inertia = turn @ inertia_matrix(given.moments) @ turn.T
            model.appendBodyToJoint(on, _inertia(given.mass, np.array(given.pose.xyz), inertia), at)
        ahead.extend((name, on, at) for name in reversed(children.get(link, [])))

    hang(description.base, 0, pin.SE3.Identity())
    while ahead:
        name, on, at = ahead.pop()
        joint = description.joints[name]
        there, axis = at * pin.SE3(placed(joint.pose)), np.array(joint.axis) / np.linalg.norm(joint.axis)
        if joint.kind in ("floating", "planar"):
            raise BadInput(
                f"{description.path}: joint {name} ({joint.kind}) has more than one degree of freedom; "
                "expected an arm on a fixed base (type fixed where it does not move)"
            )
        if joint.kind in MOVING and name not in lock:
            alone = pin.buildModelFromXML(ONE_JOINT.format(joint.kind, " ".join(map(repr, axis.tolist()))))
            hang(joint.child, model.addJoint(on, alone.joints[1], there, name), pin.SE3.Identity())
            continue
        turned, slid = np.zeros(3), np.zeros(3)
        (slid if joint.kind == "prismatic" else turned)[:] = axis * lock.get(name, 0.0)
        hang(joint.child, on, there * pin.SE3(pin.exp3(turned), slid))
    return model


class RigidBody:
    """A fixed-base tree of joints with one degree of freedom each.

    Bodies of the same content are equal, so that what is built for an arm serves every load of its description.

    Args:
        model: Pinocchio's model of all joints of the tree.
        follows: the laws of followers by name: leader, ratio and offset.

    Attributes:
        joints: names of the n independent joints. slides: which of them slide. fingers: which of them are a gripper's.
        last: index of the joint that carries a payload. gravity: (3,) [m/s^2] in the base frame. plain: the body with
            the URDF's links.
    """

    def __init__(self, model: pin.Model, follows: Mapping[str, tuple[str, float, float]] | None = None) -> None:
        self._model, self._follows = model, dict(follows or {})
        self._data = model.createData()
        self.gravity = np.array(model.gravity.linear)
        self.continuous = np.array([model.joints[j].nq == 2 for j in range(1, model.njoints)])
        self.plain: RigidBody = self  # with the links of the URDF
        self._index_q = np.array([model.joints[j].idx_q for j in range(1, model.njoints)])
        self.coupling = Coupling.of(self.tree())
        self.joints: tuple[str, ...] = tuple(link.name for link in self.own_links())
        self.slides: tuple[bool, ...] = tuple(link.prismatic for link in self.own_links())
        self.n: int = len(self.joints)
        self.last, held = outermost(self.tree()), fingers(self.tree())
        self.fingers: tuple[bool, ...] = tuple(k in held for k in self.coupling.own.tolist())

    @classmethod
    def of(
        cls,
        description: Description,
        lock: Mapping[str, float],
        follows: Mapping[str, tuple[str, float, float]] | None = None,
    ) -> RigidBody:
        """That of a description; joints named in `lock` stay at the given position (rad or m), `follows` follow.

        Raises:
            BadInput: a locked joint is unknown, none is left that moves, or a joint has more than one degree of
                freedom.
        """
        model = _built(description, lock)
        if model.nv == 0:
            raise BadInput(f"{description.path}: no joint is left that moves")
        return cls(model, follows)

    def __eq__(self, other: object) -> bool:
        if self is other or not isinstance(other, RigidBody):
            return self is other
        nominal = (self.plain is self) == (other.plain is other) and (self.plain is self or self.plain == other.plain)
        return nominal and self._follows == other._follows and bool(self._model == other._model)

    def __hash__(self) -> int:
        return hash(self.joints)

    @cached_property
    def _links(self) -> tuple[Link, ...]:
        """The moving links as plain numbers, from Pinocchio's model."""
        m, data = self._model, self._model.createData()
        pin.forwardKinematics(m, data, pin.neutral(m), np.zeros(m.nv))  # fills every joint's motion subspace
        out = []
        index = {name: j - 1 for j, name in enumerate(m.names)}
        for j in range(1, m.njoints):
            law = self._follows.get(m.names[j])
            subspace = np.asarray(data.joints[j].S).ravel()
            prismatic = m.joints[j].shortname().startswith("JointModelP")
            out.append(
                Link(
                    name=m.names[j],
                    prismatic=prismatic,
                    continuous=bool(self.continuous[j - 1]),
                    parent=int(m.parents[j]) - 1,
                    placement=m.jointPlacements[j].homogeneous.copy(),
                    axis=subspace[:3] if prismatic else subspace[3:],
                    mass=float(m.inertias[j].mass),
                    lever=np.array(m.inertias[j].lever),
                    inertia=np.array(m.inertias[j].inertia),
                    armature=float(m.armature[m.joints[j].idx_v]),
                    follows=None if law is None else Follows(index[law[0]], law[1], law[2]),
                )
            )
        return tuple(out)

    def collision_check(
        self, parts: Sequence[tuple[int, np.ndarray, Any]], pairs: np.ndarray, margins: np.ndarray
    ) -> Callable[[np.ndarray], bool]:
        """A quick test of one pose (n,): whether any pair of convex parts comes nearer than its margin.

        Args:
            parts: the joint that carries each (-1: the base), its pose (4, 4) in that joint's frame, coal's geometry.
            pairs: (P, 2) numbers of parts; margins: (P,) [m].
        """
        model, data = self._model, self._model.createData()
        world = pin.GeometryModel()
        for k, (joint, pose, geometry) in enumerate(parts):
            world.addGeometryObject(pin.GeometryObject(str(k), joint + 1, 0, pin.SE3(pose), geometry))
        for a, b in pairs.tolist():
            world.addCollisionPair(pin.CollisionPair(a, b))
        results = pin.GeometryData(world)
        for request, margin in zip(results.collisionRequests, margins.tolist(), strict=True):
            request.security_margin = margin
        # it compares bounding boxes before it measures a pair, in a fifth of the time; it does not own its arguments
        manager = pin.BroadPhaseManager_NaiveCollisionManager(model, world, results)
        owned = world, results

        def touches(q: np.ndarray, owned: object = owned) -> bool:
            return bool(pin.computeCollisions(model, data, manager, self.configuration(q), True))

        return touches

    def link_frames(self) -> dict[str, tuple[int, np.ndarray]]:
        """Every link by name: index of the joint that carries it (-1: base), and its (4, 4) pose in that frame."""
        bodies = [frame for frame in self._model.frames if frame.type == pin.FrameType.BODY]
        return {frame.name: (int(frame.parentJoint) - 1, frame.placement.homogeneous.copy()) for frame in bodies}

    def frame_motion(
        self, joint: int, pose: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Motion of a frame that is fixed to a joint's link, in the base frame.

        Pinocchio's acceleration of a frame is spatial: the acceleration of the origin is its linear part plus w x v.

        Args:
            joint: index in the tree. pose: (4, 4) in the joint's frame. q, v, a: (N, n).

        Returns:
            Poses (N, 4, 4); velocity [m/s] and acceleration [m/s^2] of the frame's origin, (N, 3) each.
        """
        data, joint = self._model.createData(), joint + 1
        links, twist, change = np.empty((len(q), 4, 4)), np.empty((len(q), 6)), np.empty((len(q), 6))
        v, a = self.coupling.rates(v), self.coupling.rates(a)
        for k, c in enumerate(self.configuration(q)):
            pin.forwardKinematics(self._model, data, c, v[k], a[k])
            links[k], twist[k], change[k] = data.oMi[joint].homogeneous, data.v[joint].vector, data.a[joint].vector
        turn, origin, spin = links[:, :3, :3], np.asarray(pose, dtype=float)[:3, 3], twist[:, 3:]
        speed = twist[:, :3] + np.cross(spin, origin)  # in the link's frame, as is the rest of this line and the next
        growth = change[:, :3] + np.cross(change[:, 3:], origin) + np.cross(spin, speed)
        return links @ pose, (turn @ speed[..., None])[..., 0], (turn @ growth[..., None])[..., 0]

    def tree(self) -> tuple[Link, ...]:
        """The moving links, parents before children."""
        return self._links

    def own_links(self) -> tuple[Link, ...]:
        """Links of the independent joints, in their order."""
        return tuple(self._links[k] for k in self.coupling.own)

    def with_links(self, mass: np.ndarray, lever: np.ndarray, inertia: np.ndarray) -> RigidBody:
        """The same tree with other links: mass (n,) [kg], centre (n, 3) [m], inertia (n, 3, 3) [kg m^2] about it.

        Links are those of the independent joints; links of followers stay the same.

        Raises:
            BadInput: a mass or a principal moment is negative, and that of the URDF is not.
        """
        model = pin.Model(self._model)
        for j, (k, own) in enumerate(zip(self.coupling.own.tolist(), self.own_links(), strict=True)):
            least, usual = (float(np.linalg.eigvalsh(i)[0]) for i in (inertia[j], own.inertia))
            if mass[j] < -NOISE or least < min(usual, 0.0) - NOISE:
                raise BadInput(
                    f"the link of {own.name} would have {mass[j]:.4g} kg and a least principal moment of {least:.4g} "
                    f"kg m^2; the URDF's has {own.mass:.4g} kg and {usual:.4g} kg m^2; expected 0 or more of both"
                )
            model.inertias[k + 1] = _inertia(float(mass[j]), np.array(lever[j]), np.array(inertia[j]))
        out = RigidBody(model, self._follows)
        out.plain = self.plain
        return out

    def on_casadi(self) -> tuple[Any, Any] | None:
        """`pinocchio.casadi` and this model on its scalars; None where Pinocchio was built without that module."""
        try:
            from pinocchio import casadi as symbolic
        except ImportError:
            return None
        return symbolic, symbolic.Model(self._model)

    def configuration(self, q: np.ndarray) -> np.ndarray:
        """Pinocchio's configurations (..., nq) of positions (..., n) [rad, m].

        A continuous joint has two entries, cosine and sine.
        """
        q = self.coupling.positions(np.asarray(q, dtype=float))
        if not self.continuous.any():
            return q
        out = np.zeros((*q.shape[:-1], self._model.nq))
        out[..., self._index_q] = np.where(self.continuous, np.cos(q), q)
        out[..., self._index_q[self.continuous] + 1] = np.sin(q[..., self.continuous])
        return out

    def _variant(self, payload: PointMass | None, gravity: np.ndarray | None) -> tuple[pin.Model, pin.Data]:
        """The model with a payload and another gravity; the stored one where neither is given."""
        if (payload is None or payload.mass == 0) and gravity is None:
            return self._model, self._data
        model = pin.Model(self._model)
        if payload is not None:
            added = pin.Inertia(float(payload.mass), np.asarray(payload.com, dtype=float), np.zeros((3, 3)))
            model.inertias[self.last + 1] += added
        if gravity is not None:
            model.gravity.linear = np.asarray(gravity, dtype=float)
        return model, model.createData()

    def torque(
        self,
        q: np.ndarray,
        v: np.ndarray,
        a: np.ndarray,
        payload: PointMass | None = None,
        gravity: np.ndarray | None = None,
    ) -> np.ndarray:
        """Inverse dynamics (recursive Newton-Euler): torque (N, n) [N m].

        Args:
            q, v, a: (N, n) or (n,). payload: a point mass on the last joint. gravity: (3,) [m/s^2] in the base frame,
                instead of the model's own.
        """
        q, v, a = (np.atleast_2d(np.asarray(x, dtype=float)) for x in (q, v, a))
        v, a = self.coupling.rates(v), self.coupling.rates(a)
        if len(q) < FEW:
            model, data = self._variant(payload, gravity)
            torques = [pin.rnea(model, data, row, v[k], a[k]) for k, row in enumerate(self.configuration(q))]
            return self.coupling.joined(np.array(torques))
        pool = pin.ModelPool(self._variant(payload, gravity)[0], 1)
        out = np.empty((self._model.nv, len(q)), order="F")
        pin.rneaInParallel(1, pool, self.configuration(q).T, v.T, a.T, out)
        return self.coupling.joined(out.T)

    def energy(
        self, q: np.ndarray, v: np.ndarray, payload: PointMass | None = None, gravity: np.ndarray | None = None
    ) -> np.ndarray:
        """Kinetic plus potential energy (N,) [J] of the rigid body; the potential has an arbitrary constant.

        Args:
            q, v: (N, n) or (n,). payload, gravity: as `torque`.
        """
        model, data = self._variant(payload, gravity)
        q, v = np.atleast_2d(q), self.coupling.rates(np.atleast_2d(v))
        return np.array(
            [
                pin.computeKineticEnergy(model, data, c, v[k]) + pin.computePotentialEnergy(model, data, c)
                for k, c in enumerate(self.configuration(q))
            ]
        )

    def link_regressor(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray, gravity: np.ndarray | None = None
    ) -> np.ndarray:
        """Derivatives of torque by the inertial parameters of all L links, (N, n, 10 L). Torque is linear in these
        parameters.

        The parameters of a link, about its joint's origin, are in Pinocchio's order: m, m c (3), Ixx, Ixy, Iyy, Ixz,
        Iyz, Izz.

        Args:
            q, v, a: (N, n). gravity: as `torque`.
        """
        model, data = self._variant(None, gravity)
        v, a = self.coupling.rates(v), self.coupling.rates(a)
        out = np.empty((len(q), model.nv, 10 * model.nv))
        for k, c in enumerate(self.configuration(q)):
            out[k] = pin.computeJointTorqueRegressor(model, data, c, v[k], a[k])
        return self.coupling.joined(out, axis=1)
