"""Friction as a free curve over speed: what measured data say where no law of a few numbers does."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from energy_opt.effects.base import Effect, Signals
from energy_opt.effects.friction import SIGN_WIDTH
from energy_opt.effects.kinks import Kinks
from energy_opt.effects.parameter import Parameter
from energy_opt.effects.stages import TorqueEffect
from energy_opt.errors import BadInput

FASTEST = 2.5  # [rad/s] of the points of a curve that nothing else is known of


class FrictionCurve(TorqueEffect):
    """f(|v|) * sign(v), f the spline through (speed, torque): monotone between points, so never below the lower one.

    The spline is the piecewise cubic of Fritsch and Butland (SIAM J. Sci. Stat. Comput. 5(2), 1984; "PCHIP"): with h_k
    the steps and s_k the slopes of the chords, its slope at an inner point is 0 where s_{k-1} and s_k differ in sign,
    else their harmonic mean, weighted 2 h_k + h_{k-1} and h_k + 2 h_{k-1}. Torque is never negative, so friction never
    drives. Beyond the last speed it goes on straight, falling curves level.
    """

    name = "friction_curve"
    parameters = (
        Parameter("speed", "rad/s", 0.0, 0.0, 1e3, "points", shapes=True, steps=True),
        Parameter("torque", "N m", 0.0, 0.0, 1e3, ("joint", "points")),
    )
    extents_by_default = {"points": 6}
    convex_in_retiming = False
    dissipates = True

    def __init__(self, **values: Any) -> None:
        super().__init__(**values)
        speed = self.values["speed"]
        if len(speed) < 2 or speed[0] != 0 or not (np.diff(speed) > 0).all():
            raise BadInput(f"effect {self.name}: speed = {speed.tolist()}; expected two or more that ascend from 0")
        if self.values["torque"].shape[-1] != len(speed):
            given = self.values["torque"].shape[-1]
            raise BadInput(f"effect {self.name}: torque has {given} points; speed has {len(speed)}")

    @classmethod
    def neutral(cls, joints: int, **words: str | int) -> Effect:
        count = int(words.get("points", cls.extents_by_default["points"]))
        return cls(speed=np.linspace(0, 1, count) ** 2 * FASTEST, torque=np.zeros((joints, count)))

    @classmethod
    def example(cls, joints: int, rng: np.random.Generator) -> np.ndarray:
        count = cls.extents_by_default["points"]
        return np.concatenate([np.linspace(0, 1, count) ** 2 * FASTEST, rng.uniform(0.05, 0.15, joints * count)])

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        count = p.speed.numel()
        way = k.magnitude(x.v, SIGN_WIDTH)
        size = [spline(way[j], p.speed, p.torque[j * count : (j + 1) * count]) for j in range(x.v.numel())]
        return ca.vertcat(*size) * k.sign(x.v, SIGN_WIDTH)


def spline(x: ca.SX, at: ca.SX, y: ca.SX) -> ca.SX:
    """The monotone piecewise cubic through (at, y), (K, 1) each, at x >= at[0]."""
    count = at.numel()
    h = [at[i + 1] - at[i] for i in range(count - 1)]
    s = [(y[i + 1] - y[i]) / h[i] for i in range(count - 1)]
    inner = [_slope(h[i - 1], h[i], s[i - 1], s[i]) for i in range(1, count - 1)]
    first = _end(h[0], h[1], s[0], s[1]) if count > 2 else s[0]
    last = _end(h[-1], h[-2], s[-1], s[-2]) if count > 2 else s[0]
    d = [first, *inner, last]
    start, c = at[count - 1], [y[count - 1], ca.fmax(last, 0), 0 * x, 0 * x]
    for i in reversed(range(count - 1)):
        own = [y[i], d[i], (3 * s[i] - 2 * d[i] - d[i + 1]) / h[i], (d[i] + d[i + 1] - 2 * s[i]) / h[i] ** 2]
        here = x < at[i + 1]
        start, c = ca.if_else(here, at[i], start), [ca.if_else(here, a, b) for a, b in zip(own, c, strict=True)]
    u = x - start
    return c[0] + u * (c[1] + u * (c[2] + u * c[3]))


def _slope(h0: ca.SX, h1: ca.SX, s0: ca.SX, s1: ca.SX) -> ca.SX:
    """Slope at an inner point between chords of slopes s0 and s1 over steps h0 and h1."""
    alike = s0 * s1 > 0
    w0, w1 = 2 * h1 + h0, h1 + 2 * h0
    below = ca.if_else(alike, w0 * s1 + w1 * s0, 1)
    return ca.if_else(alike, (w0 + w1) * s0 * s1 / below, 0)


def _end(h0: ca.SX, h1: ca.SX, s0: ca.SX, s1: ca.SX) -> ca.SX:
    """Slope at an end: the parabola's through three points, kept to the sign of the chord and to thrice its slope."""
    d = ((2 * h0 + h1) * s0 - h0 * s1) / (h0 + h1)
    d = ca.if_else(d * s0 <= 0, 0, d)
    steep = ca.logic_and(s0 * s1 <= 0, ca.fabs(d) > 3 * ca.fabs(s0))
    return ca.if_else(steep, 3 * s0, d)
