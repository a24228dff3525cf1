"""What a model's drives do at a torque and a speed: friction, and power that is lost."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from energy_opt.power import PowerModel, drive_function


def friction(models: Sequence[PowerModel], speed: np.ndarray) -> np.ndarray:
    """Friction torque of each joint, the mean of both directions, of models of one structure.

    f(s) = (tau_m(s) - tau_m(-s)) / 2 at no load, without acceleration, in a drive that has not warmed up.

    Args:
        models: that differ in their values only. speed: (n, S) rad/s, not negative.

    Returns:
        (len(models), n, S) N m.
    """
    n, count = speed.shape
    function, _ = drive_function(models[0], n)
    both, none = np.hstack([speed, -speed]), ca.DM.zeros(n, 2 * count)
    out = np.empty((len(models), n, count))
    for k, model in enumerate(models):
        torque = np.array(function(none, both, none, none, ca.DM.zeros(1, 2 * count), model.values(n))[0])
        out[k] = (torque[:, :count] - torque[:, count:]) / 2
    return out


def loss(model: PowerModel, joints: int, joint: int, torque: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Power that is lost where one joint moves against a torque: at the meter, less mechanical power and standby.

    Args:
        joint: its index among the robot's `joints`. torque: (T,) N m at the joint. speed: (S,) rad/s.

    Returns:
        (T, S) W.
    """
    function, _ = drive_function(model, joints)
    loads, speeds = (x.ravel() for x in np.meshgrid(torque, speed, indexing="ij"))
    count = len(loads) + 1  # the last is rest without load
    tau, v = np.zeros((joints, count)), np.zeros((joints, count))
    tau[joint, :-1], v[joint, :-1] = loads, speeds
    none = ca.DM.zeros(joints, count)
    power = np.array(function(none, v, none, tau, ca.DM.zeros(1, count), model.values(joints))[1]).ravel()
    return (power[:-1] - power[-1] - loads * speeds).reshape(len(torque), len(speed))
