"""A winding that its own heat warms: the resistance of each joint follows what the joint did before."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np

from energy_opt.effects.base import Signals
from energy_opt.effects.friction import SOAKING
from energy_opt.effects.parameter import Parameter
from energy_opt.effects.stages import SoakingEffect

GAP = 3.0  # times the usual step between instants: between runs


class WindingSelfHeating(SoakingEffect):
    """r_over_kt2 of a joint grows by the factor 1 + rate * theta; dtheta/dt = (c - theta) / time_constant.

    c is the joint's copper loss [W] at the resistance of a cold winding, so that theta is what it has been of late. The
    one-body thermal model of a motor: rate is the winding's temperature coefficient (0.0039 1/K of copper) times its
    thermal resistance [K/W]. A set begins cold, and between its runs the arm holds its last pose. A plan is made with
    cold windings: a move is short beside their time constant.
    """

    name = "winding_self_heating"
    parameters = (
        Parameter("rate", "1/W", 0.0, 0.0, 10.0, "joint"),
        Parameter("time_constant", "s", 60.0, 1e-1, 1e5, shapes=True, fit=SOAKING, trials=(30.0, 150.0)),
    )
    needs = ("copper_loss",)
    dissipates = True
    convex_in_retiming = True  # in a plan it changes nothing

    @classmethod
    def factor(cls, x: Signals, p: SimpleNamespace) -> ca.SX:
        return 1 + p.rate * x.heated if x.heated is not None else 1 + 0 * p.rate

    @classmethod
    def soaked(cls, time: np.ndarray, heat: np.ndarray, values: np.ndarray) -> np.ndarray:
        """theta by the response to heat that stays until the next instant; within a run instants are evenly apart."""
        from scipy.signal import lfilter

        out, step = np.zeros_like(heat), np.diff(time)
        gaps = np.flatnonzero(step > GAP * np.median(step)) if step.size else step
        state, first = np.zeros(heat.shape[1]), 0
        for last in [*gaps.astype(int), len(time) - 1]:
            if last > first:
                keep = np.exp(-(time[last] - time[first]) / (last - first) / values[-1])
                passed = lfilter([1 - keep], [1, -keep], heat[first:last], axis=0, zi=keep * state[None])[0]
                out[first + 1 : last + 1] = passed
                state = passed[-1]
            if last + 1 < len(time):
                state = heat[last] + np.exp(-step[last] / values[-1]) * (state - heat[last])
                out[last + 1], first = state, last + 1
        return out
