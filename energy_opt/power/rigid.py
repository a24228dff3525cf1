"""Numeric values of the effects that change the rigid body, in the form that Pinocchio's numbers need."""

from __future__ import annotations

import casadi as ca
import numpy as np

from energy_opt.effects import RigidEffect
from energy_opt.power.model import PowerModel
from energy_opt.robot import PointMass, RigidBody


def body_of(model: PowerModel, body: RigidBody) -> RigidBody:
    """The rigid body with its links as the model says they are; the URDF's where it says nothing of them."""
    nominal = [(link.mass, ca.DM(link.lever), ca.DM(link.inertia)) for link in body.plain.own_links()]
    for effect in model.effects:
        if isinstance(effect, RigidEffect):
            links = effect.links(nominal, effect.named(ca.DM(effect.full(body.n)), body.n))
            if links is not None:
                return body.with_links(
                    *(np.stack([np.array(x).squeeze() for x in part]) for part in zip(*links, strict=True))
                )
    return body


def rigid_inputs(model: PowerModel, body: RigidBody) -> tuple[PointMass | None, np.ndarray]:
    """The model's payload (None where it has none) and gravity (3,) [m/s^2] in the robot's base frame."""
    gravity, mass = ca.DM(body.gravity), None
    for effect in model.effects:
        if isinstance(effect, RigidEffect):
            p = effect.named(ca.DM(effect.full(body.n)), body.n)
            gravity = effect.gravity(gravity, p)
            point = effect.point_mass(p)
            mass = mass if point is None else PointMass(float(point[0]), np.array(point[1]).ravel())
    return mass, np.array(gravity).ravel()


def rigid_torque(model: PowerModel, body: RigidBody, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Rigid-body torque (N, n) [N m] with the model's payload, tilt and links, by Pinocchio."""
    body = body_of(model, body)
    payload, gravity = rigid_inputs(model, body)
    changed = None if np.array_equal(gravity, body.gravity) else gravity
    return body.torque(q, v, a, payload, changed)
