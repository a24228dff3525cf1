"""A payload that is picked up or put down in mid-run, while the arm is at rest."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np

from energy_opt.effects.base import Effect, Signals
from energy_opt.effects.parameter import Parameter
from energy_opt.effects.rigid import Payload

ALWAYS = 1e3  # dwells: until the run's end


class PayloadChange(Payload):
    """A point mass at `com` in the last joint's frame, from the `first` dwell of every run on, for `lasts` dwells.

    A dwell is a standstill between two motions of one run; the payload changes in its middle. It belongs to a
    recording: in a plan the payload is the move's own.
    """

    name = "payload_change"
    parameters = (
        *Payload.parameters,
        Parameter("first", "1", 1.0, 1.0, ALWAYS, shapes=True, steps=True, trials=(1.0, 2.0)),
        Parameter("lasts", "1", ALWAYS, 1.0, ALWAYS, shapes=True, steps=True, trials=(1.0, ALWAYS)),
    )
    follows = ("dwell",)

    @classmethod
    def point_mass(cls, p: SimpleNamespace) -> tuple[ca.SX, ca.SX] | None:
        return None

    @classmethod
    def held(cls, x: Signals, p: SimpleNamespace) -> tuple[ca.SX, ca.SX, ca.SX] | None:
        if x.dwell is None:
            return None
        there = ca.logic_and(x.dwell >= p.first, x.dwell < p.first + p.lasts)
        return p.mass, p.com, ca.if_else(there, 1, 0)

    @classmethod
    def idle(cls, joints: int, **words: str | int) -> Effect:
        return cls(mass=1e-3, com=np.zeros(3), first=1.0, lasts=ALWAYS)

    @classmethod
    def example(cls, joints: int, rng: np.random.Generator) -> np.ndarray:
        return np.array([*rng.uniform(0.05, 0.15, 4), 2.0, 2.0])

    @classmethod
    def to_chart(cls, full: np.ndarray, joints: int) -> np.ndarray:
        return np.concatenate([super().to_chart(full[:4], joints), full[4:]])

    @classmethod
    def from_chart(cls, x: np.ndarray, joints: int) -> np.ndarray:
        return np.concatenate([super().from_chart(x[:4], joints), x[4:]])

    @classmethod
    def chart_slope(cls, x: np.ndarray, joints: int) -> np.ndarray:
        out = np.eye(6)
        out[:4, :4] = super().chart_slope(x[:4], joints)
        return out

    @classmethod
    def chart_bounds(cls, joints: int) -> tuple[np.ndarray, np.ndarray]:
        low, high = Payload.chart_bounds(joints)
        return np.append(low, [1.0, 1.0]), np.append(high, [ALWAYS, ALWAYS])
