"""Links that deviate from their URDF by some per cent: the effect of such deviations on the readings, as a few
directions.

A link's mass m deviates by a share, its centre of mass c by a share of its distance and a little more, its inertia by
twice the share. In terms of the inertial parameters phi these are Gaussian deviations B d, d ~ N(0, spread^2).
Directions that the readings do not show are left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from energy_opt.diagnosis.data.predict import predict
from energy_opt.diagnosis.data.samples import Samples
from energy_opt.effects import LinkInertia
from energy_opt.power import PowerModel
from energy_opt.robot import RigidBody

ASIDE, NEAR = 0.6, 0.01  # change of a centre's coordinates at a spread of 1: share of its distance, plus [m]
TURNED = 0.5  # change of products of inertia at a spread of 1, over the mean moment of inertia
# bounds of a deviating link: least share of its mass, largest shift of its centre over its distance
LIGHTEST, FARTHEST = 0.4, 0.5
USUAL_SPREAD = 0.06  # usual relative deviation of links from their URDF
SHOWN = 0.02  # directions are left out if their rms effect at a spread of 1 is below this share of a reading's noise


@dataclass(frozen=True)
class Links:
    """Directions of deviation.

    Attributes:
        basis: (10 L, c) inertial parameters of all links by amounts d of the directions, each of standard deviation
            `spread`.
        torques: (K, n, c) torque by the amounts.
    """

    basis: np.ndarray
    torques: np.ndarray

    def effect(self, d: np.ndarray, samples: Samples) -> LinkInertia:
        """The deviation of amounts d (c,) as an effect."""
        change = (self.basis @ d).reshape(-1, 10)[samples.body.coupling.own]
        mass, com, inertia = [], [], []
        for link, phi in zip(samples.body.plain.own_links(), change, strict=True):
            m = max(link.mass + phi[0], LIGHTEST * link.mass, 1e-6)
            far = FARTHEST * float(np.linalg.norm(link.lever)) + NEAR * 5
            c = link.lever + np.clip((link.mass * link.lever + phi[1:4]) / m - link.lever, -far, far)
            about = phi[[4, 5, 7, 5, 6, 8, 7, 8, 9]].reshape(3, 3) + link.inertia + link.mass * _apart(link.lever)
            i = about - m * _apart(c)
            values, axes = np.linalg.eigh(i)  # phi[4:] is xx, xy, yy, xz, yz, zz
            i = axes @ np.diag(np.maximum(values, 1e-3 * max(np.trace(link.inertia), 1e-9))) @ axes.T
            mass.append(m - link.mass)
            com.append(c - link.lever)
            inertia.append(_six(i - link.inertia))
        return LinkInertia(mass=np.array(mass), com=np.array(com), inertia=np.array(inertia))


def links_of(samples: Samples, model: PowerModel) -> Links:
    """Directions of link deviations that influence the readings under a model."""
    basis = deviations_of(samples.body)
    torques = samples.deviating(basis)
    shown = predict(model, samples, None, torques).external / samples.noise
    values, vectors = np.linalg.eigh(shown.T @ shown / len(shown))
    kept = vectors[:, values > SHOWN**2][:, ::-1]
    return Links(basis @ kept, torques @ kept)


def deviations_of(body: RigidBody) -> np.ndarray:
    """Inertial parameters (10 L, 10 n) of all links by deviations of their masses, centres and inertias.

    Only links with a joint of their own deviate; those of mimic joints are as in the URDF.
    """
    basis = np.zeros((10 * len(body.tree()), 10 * body.n))
    for j, (k, link) in enumerate(zip(body.coupling.own, body.plain.own_links(), strict=True)):
        basis[10 * k : 10 * k + 10, 10 * j : 10 * j + 10] = _deviations(link.mass, link.lever, link.inertia)
    return basis


def _deviations(m: float, c: np.ndarray, i: np.ndarray) -> np.ndarray:
    """Inertial parameters (10, 10) by deviations of mass, centre (3) and inertia (6), each of its usual size."""
    out = np.zeros((10, 10))
    out[0, 0], out[1:4, 0] = m, m * c
    out[4:, 0] = _six(i + m * _apart(c))  # the inertia scales with the mass
    size = ASIDE * float(np.linalg.norm(c)) + NEAR
    for k, unit in enumerate(np.eye(3)):
        out[1:4, 1 + k] = m * size * unit
        turned = 2 * float(c @ unit) * np.eye(3) - np.outer(c, unit) - np.outer(unit, c)
        out[4:, 1 + k] = _six(m * size * turned)
    mean = float(np.trace(i)) / 3
    out[4:, 4:] = np.diag([2 * i[0, 0], TURNED * mean, 2 * i[1, 1], TURNED * mean, TURNED * mean, 2 * i[2, 2]])
    return out


def _apart(c: np.ndarray) -> np.ndarray:
    """Inertia (3, 3) of a unit mass at c."""
    return np.asarray(float(c @ c) * np.eye(3) - np.outer(c, c))


def _six(i: np.ndarray) -> np.ndarray:
    """The entries xx, xy, yy, xz, yz, zz of a symmetric matrix (3, 3), in Pinocchio's order."""
    return np.asarray(i[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]])
