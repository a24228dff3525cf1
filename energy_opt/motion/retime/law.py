"""A model's law at the points of a path: nine coefficients at each where that is all there is to it, else the law."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from energy_opt.motion.retime.limits import point_numbers
from energy_opt.motion.retime.points import AnyLaw, Cost, Monomials
from energy_opt.motion.retime.terms import BLURS, DEGREES, compressed, law_function
from energy_opt.motion.timing.path_dynamics import PathDynamics, SharedByStructure
from energy_opt.power import PowerModel


@dataclass(frozen=True)
class PathLaw:
    """The law at points (M,) of a path.

    Attributes:
        numbers: (6 n + 1, M) what the law is given at each point.
        unit: of squared speed [1/s^2] to which the coefficients belong.
        coefficients: (9, M) of the power's monomials; None where the law has other terms, kinks among them.
    """

    model: PowerModel
    joints: int
    numbers: np.ndarray
    unit: float
    coefficients: np.ndarray | None

    @classmethod
    def of(cls, model: PowerModel, dynamics: PathDynamics, unit: float, time: np.ndarray) -> PathLaw:
        """At the points of `dynamics`, which are passed at `time` (M,) [s]."""
        numbers, n = point_numbers(dynamics, time), dynamics.robot.n
        shared = np.append(model.values(n), [unit, BLURS[0]])
        return cls(model, n, numbers, unit, compressed(SharedByStructure(model), n, numbers, shared))

    def cost(self, weight: np.ndarray, unit: float, energy: float, time: float, blur: float) -> Cost:
        """Sum over points of weight / sqrt(b) (energy P + time), with a and b in `unit` and kinks `blur` wide."""
        if self.coefficients is None:
            shared = np.append(self.model.values(self.joints), [unit, blur, energy, time])
            return AnyLaw.of(SharedByStructure(self.model), self.joints, self.numbers, weight, shared)
        k = energy * self.coefficients * (unit / self.unit) ** DEGREES[:, None]
        k[0] += time
        return Monomials(k, weight)

    def smoothing(self, z: np.ndarray, unit: float, weight: np.ndarray) -> float:
        """What the smoothed kinks leave out of a bound [J]: supporting lines of the exact ones in their place.

        At z = (a, b) (2, M) in `unit`.
        """
        shared = np.append(self.model.values(self.joints), [unit, BLURS[-1]])
        values = np.repeat(shared[:, None], z.shape[1], axis=1)
        shared_by = SharedByStructure(self.model)
        lines, smooth = (
            np.array(law_function(shared_by, self.joints, tangents)(z, self.numbers, values)[0]).ravel()
            for tangents in (True, False)
        )
        return float((weight / np.sqrt(unit * z[1])) @ (lines - smooth))
