"""Effects that follow what was before: a link capacitor, a servo that stays on, what differs from run to run."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np

from energy_opt.effects.base import Signals
from energy_opt.effects.electrics import POWER_WIDTH
from energy_opt.effects.kinks import Kinks
from energy_opt.effects.parameter import Parameter
from energy_opt.effects.stages import PowerEffect, StoreEffect

ENDLESS = 1e9  # [J] a store of this size takes back all there is, as if negative power counted in full
SMALLEST = 0.1  # [J] a smaller store is none: regeneration that gives nothing back
HELD = (0.3, 0.6, 1.0, 2.0)  # [s] durations that are tried first
EDGE = 0.02  # [s] half-width of the smoothed end of a hold


class DcLink(StoreEffect):
    """Negative power of the bus is stored up to `capacity` J (nothing at first) and used first; the rest is lost.

    With e the stored energy and x the sum of the joints' drive power: where x < 0, e grows by -x dt up to the capacity
    and the supply gives nothing; where x > 0, what is stored is used before the supply gives. From `ENDLESS` J on,
    negative power counts in full.
    """

    name = "dc_link"
    parameters = (
        Parameter("capacity", "J", ENDLESS, 0.0, ENDLESS, fit=(SMALLEST, 200.0), trials=(0.5, 2.0, 8.0, 30.0)),
    )
    dissipates = True

    @classmethod
    def drawn(cls, drive: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        return k.positive(ca.sum1(drive), POWER_WIDTH)

    @classmethod
    def passed(cls, p: SimpleNamespace) -> ca.SX | float:
        return 0.0

    @classmethod
    def example(cls, joints: int, rng: np.random.Generator) -> np.ndarray:
        return np.array([0.8])

    @classmethod
    def supplied(cls, step: np.ndarray, bus: np.ndarray, value: float) -> np.ndarray:
        if value >= ENDLESS:
            return bus
        out, held = np.maximum(bus, 0.0), 0.0
        for k in np.flatnonzero(bus != 0):
            if bus[k] < 0:
                held = min(value, held - bus[k] * step[k])
            elif held > 0:
                used = min(held, bus[k] * step[k])
                held -= used
                out[k] -= used / step[k]
        return out


class IdleHold(PowerEffect):
    """`power` for `duration` s after a motion ends: the servo or the brakes take that long to let go."""

    name = "idle_hold"
    parameters = (
        Parameter("power", "W", 0.0, 0.0, 1e5),
        Parameter("duration", "s", 1.0, 0.0, 1e5, shapes=True, steps=True, fit=(0.05, 1e3), trials=HELD),
    )
    follows = ("idle",)
    dissipates = True

    @classmethod
    def power(cls, x: Signals, tau_m: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        if x.idle is None:
            return ca.SX(0) * p.power
        return p.power * k.below(x.idle, p.duration, EDGE) * ca.if_else(x.idle >= 0, 1, 0)


class RunOffset(PowerEffect):
    """Constant power that differs from run to run, one number per run; never part of a plan."""

    name = "run_offset"
    parameters = (Parameter("power", "W", 0.0, -1e5, 1e5, "runs"),)
    extents_by_default = {"runs": 6}
    follows = ("run",)

    @classmethod
    def power(cls, x: Signals, tau_m: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        if x.run is None:
            return ca.SX(0)
        return sum((ca.if_else(x.run == r, p.power[r], 0) for r in range(p.power.numel())), ca.SX(0))
