"""Error bounds of the polynomial that interpolates rigid-body torque at even places between two samples.

Between samples q(t) is a polynomial, so torque is analytic in t, for complex t too. With M its largest magnitude
within r of the piece (h long), Cauchy gives |f^(k)| <= k! M / r^k, and for the polynomial p of degree d through d + 1
even places, h / d apart,

    |f - p|   <= |f^(d+1)| / (d+1)! max |w|  <= M (h / (d r))^(d+1) d! / 4
    |f' - p'| <= |f^(d+1)| / d! h^d          <= (d + 1) M / r (h / r)^d

M follows from the recursive Newton-Euler algorithm on magnitudes: a rotation by a complex angle has a norm of at most
exp(|Im q|), and the cross product of complex vectors is at most the product of their norms.
Source: P. Davis, Interpolation and Approximation, chapters 3 and 4.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from math import factorial

import numpy as np

from energy_opt.power import PowerModel
from energy_opt.power.drive_law import body_of, rigid_inputs
from energy_opt.robot import RigidBody

RADII = (1.5, 3.0, 6.0, 12.0)  # radii r of the neighbourhood, in pieces' lengths
ROUNDING = 1e-13  # share of M: rounding error of torque


class TorqueBound:
    """Bounds on the torque of a body under a model's payload, tilt and links."""

    def __init__(self, model: PowerModel, body: RigidBody) -> None:
        body = body_of(model, body)
        payload, gravity = rigid_inputs(model, body)
        self._links, self._coupling = body.tree(), body.coupling
        self._mass = [(link.mass, float(np.linalg.norm(link.lever))) for link in self._links]
        self._inertia = [float(np.linalg.norm(link.inertia, 2)) for link in self._links]
        self._carried, self._last = (0.0, 0.0), body.last
        if payload is not None:
            self._carried = payload.mass, float(np.linalg.norm(payload.com))
        self._gravity = float(np.linalg.norm(gravity))

    def largest(self, turn: np.ndarray, v: np.ndarray, a: np.ndarray, slide: np.ndarray) -> np.ndarray:
        """Largest magnitudes (K, n) of torque, for each of K neighbourhoods.

        Args:
            turn, v, a: largest |Im q|, |v| and |a|; slide: largest |q|; all (K, n).
        """
        turn, v, a, slide = (self._coupling.reach(x) for x in (turn, v, a, slide))
        count = turn.shape[0]
        # outwards: bounds of each link's angular velocity, and of its angular and linear acceleration
        w: list[np.ndarray] = []
        dw: list[np.ndarray] = []
        acc: list[np.ndarray] = []
        gain, reach = [], []
        for k, link in enumerate(self._links):
            base = link.parent < 0
            w0, dw0 = (np.zeros(count), np.zeros(count)) if base else (w[link.parent], dw[link.parent])
            acc0 = np.full(count, self._gravity) if base else acc[link.parent]
            far = float(np.linalg.norm(link.placement[:3, 3])) + (slide[:, k] if link.prismatic else 0.0)
            here = acc0 + (dw0 + w0**2) * far
            if link.prismatic:
                gain.append(np.ones(count))
                w.append(w0)
                dw.append(dw0)
                acc.append(here + 2 * w0 * v[:, k] + a[:, k])
            else:
                gain.append(np.exp(turn[:, k]))
                w.append(gain[k] * w0 + v[:, k])
                dw.append(gain[k] * (dw0 + w0 * v[:, k]) + a[:, k])
                acc.append(gain[k] * here)
            reach.append(far)
        # inwards: bounds of the forces and moments that each link passes on
        force, moment, out = [np.zeros(count)] * len(w), [np.zeros(count)] * len(w), np.zeros(turn.shape)
        for k in reversed(range(len(w))):
            for mass, lever in (self._mass[k], *([self._carried] if k == self._last else [])):
                pull = mass * (acc[k] + (dw[k] + w[k] ** 2) * lever)
                force[k], moment[k] = force[k] + pull, moment[k] + lever * pull
            moment[k] = moment[k] + self._inertia[k] * (dw[k] + w[k] ** 2)
            link = self._links[k]
            out[:, k] = (force[k] if link.prismatic else moment[k]) + link.armature * a[:, k]
            if link.parent >= 0:
                passed = gain[k] * force[k]
                force[link.parent] = force[link.parent] + passed
                moment[link.parent] = moment[link.parent] + gain[k] * moment[k] + reach[k] * passed
        return self._coupling.reach_back(out)

    def errors(
        self, sizes: Sequence[np.ndarray], slide: np.ndarray, h: np.ndarray, degree: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Bounds (K, n) of |f - p| [N m] and of |f' - p'| [N m/s].

        Args:
            sizes: the largest of the derivatives 1 ... 5 of q on each piece, (K, n) each; slide: of |q| itself.
            h: (K, 1) [s], the pieces' lengths. degree: of p.
        """
        near = np.array(RADII)[:, None]
        with np.errstate(all="ignore"):  # overflow gives no bound
            # in memory, pieces come last, so that maxima are fast
            powers = np.ascontiguousarray([(size * h ** (k - 2)).T for k, size in enumerate(sizes, 1)])
            turn, v, a = (_shares(least) @ (powers * h[:, 0] ** (2 - least)).max(axis=2) for least in (0, 1, 2))
            # of all pieces together: the worst one decides, and `largest` gets a small array
            most = np.nan_to_num(self.largest(turn, v, a, slide.max(axis=0) + turn), nan=np.inf, posinf=np.inf)
            value = most * ((1 / (degree * near)) ** (degree + 1) * factorial(degree) / 4 + ROUNDING)
            rate = most * ((degree + 1) / near ** (degree + 1) + ROUNDING)  # times h
        best = np.argmin(rate, axis=0)[None]
        least, rates = (np.take_along_axis(x, best, axis=0) for x in (value, rate))
        return np.broadcast_to(least, slide.shape), rates / h


@cache
def _shares(least: int) -> np.ndarray:
    """Factors (radii, 5) of the k-th derivative times h^k in that of order `least` within each radius, times h^least.

    The Taylor series of the derivative: the sum over k of |q^(k)| r^(k - least) / (k - least)!.
    """
    return np.array(
        [[radius ** (k - least) / factorial(k - least) if k >= max(least, 1) else 0.0 for k in range(1, 6)]
         for radius in RADII]
    )  # fmt: skip
