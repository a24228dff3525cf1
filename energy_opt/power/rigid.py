"""Numeric values of the effects that change the rigid body, in the form that Pinocchio's numbers need."""

from __future__ import annotations

import casadi as ca
import numpy as np

from energy_opt.effects import BaseTilt, Payload
from energy_opt.power.model import PowerModel
from energy_opt.robot import PointMass, RigidBody


def rigid_inputs(model: PowerModel, body: RigidBody) -> tuple[PointMass | None, np.ndarray]:
    """The model's payload (None where it has none) and gravity (3,) [m/s^2] in the robot's base frame."""
    payload = model.get(Payload.name)
    mass = None if payload is None else PointMass(float(payload.values["mass"][0]), payload.values["com"])
    tilt = model.get(BaseTilt.name)
    if tilt is None:
        return mass, body.gravity
    turned = BaseTilt.gravity(ca.DM(body.gravity), BaseTilt.split(ca.DM(tilt.full(body.n)), body.n))
    return mass, np.array(turned).ravel()


def rigid_torque(model: PowerModel, body: RigidBody, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Rigid-body torque (N, n) [N m] with the model's payload and tilt, by Pinocchio."""
    payload, gravity = rigid_inputs(model, body)
    changed = None if np.array_equal(gravity, body.gravity) else gravity
    return body.torque(q, v, a, payload, changed)
