"""Effects that depend on the past or on further recorded signals: stores, holds, runs, signals, warm windings."""

from __future__ import annotations

from collections.abc import Collection
from itertools import combinations
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from energy_opt.effects.base import Signals
from energy_opt.effects.changing_friction import SOAKING
from energy_opt.effects.electrics import POWER_WIDTH
from energy_opt.effects.parameter import Kinks, Parameter
from energy_opt.effects.stages import HeatMemoryEffect, PowerEffect, StoreEffect
from energy_opt.errors import BadInput

ENDLESS = 1e9  # [J] a store of this size accepts all negative power, as if all of it were used again
SMALLEST = 0.1  # [J] a smaller store counts as none: regeneration that returns nothing
HELD = (0.3, 0.6, 1.0, 2.0)  # [s] durations that are tried first
EDGE = 0.02  # [s] half-width of the smoothed end of a hold


class DcLink(StoreEffect):
    """Negative power of the bus is stored up to `capacity` J (nothing at first) and used first; the rest is lost.

    Let e be the stored energy and x the sum of the joints' drive power. If x < 0, e grows by -x dt up to the capacity,
    and the supply gives nothing. If x > 0, the stored energy is used first, then the supply. From a capacity of
    `ENDLESS` J on, negative power counts in full.
    """

    name = "dc_link"
    parameters = (
        Parameter("capacity", "J", ENDLESS, 0.0, ENDLESS, fit=(SMALLEST, 200.0), trials=(0.5, 2.0, 8.0, 30.0)),
    )
    dissipates = True

    @classmethod
    def drawn(cls, drive: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """max(sum of drive powers, 0) [W]: without known past, nothing comes back."""
        return k.positive(ca.sum1(drive), POWER_WIDTH * k.size.power)

    @classmethod
    def return_factor(cls, p: SimpleNamespace) -> ca.SX | float:
        """Stored mechanical power does not reach the meter by itself: the factor is 0."""
        return 0.0

    @classmethod
    def example(cls, joints: int, rng: np.random.Generator) -> np.ndarray:
        """A capacity of 0.8 J."""
        return np.array([0.8])

    @classmethod
    def supplied(cls, step: np.ndarray, bus: np.ndarray, value: float) -> np.ndarray:
        """Power (N,) [W] that the supply gives.

        The stored energy e grows by -x dt while x < 0 (at most to the capacity), and is used first while x > 0.

        Args:
            step: (N,) [s] duration of each instant. bus: (N,) [W] the drives' power x. value: capacity [J].
        """
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
    """`power` for `duration` s after a motion ends, until the servo stage switches off or the brakes engage."""

    name = "idle_hold"
    parameters = (
        Parameter("power", "W", 0.0, 0.0, 1e5),
        Parameter("duration", "s", 1.0, 0.0, 1e5, shapes=True, steps=True, fit=(0.05, 1e3), trials=HELD),
    )
    follows = ("idle",)
    dissipates = True

    @classmethod
    def power(cls, x: Signals, tau_m: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """`power` [W] while 0 <= idle < duration, else 0. The end is rounded; an unknown idle time is none."""
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
        """power[run] [W]; 0 in plans, where there is no run."""
        if x.run is None:
            return ca.SX(0)
        return sum((ca.if_else(x.run == r, p.power[r], 0) for r in range(p.power.numel())), ca.SX(0))


TOGETHER = 3  # most signals that are sought at once
LOGGED = "signal."  # prefix of a logged signal's name among the signals of a recording


class SignalPower(PowerEffect):
    """Sum of power * s over the logged signals s that `signal` names; a signal is 0 or 1, or any number.

    In a model file, write `signal = "gripper"`, or several names with commas ("gripper,brake") and a power for each.
    A log has signals as columns `signal.<name>`; other columns with only 0 and 1 are read as signals, too. If a signal
    is unknown, as in a plan, it counts as 0.
    """

    name = "signal_power"
    parameters = (Parameter("power", "W", 0.0, -1e5, 1e5, "signals"),)
    options = {"signal": ("signal",)}
    free_options = ("signal",)
    extents_by_default = {"signals": 1}
    follows = ("logged",)

    def __init__(self, **values: Any) -> None:
        if isinstance(values.get("signal"), (list, tuple)):
            values["signal"] = ",".join(map(str, values["signal"]))
        super().__init__(**values)
        names = self.choices["signal"].split(",")
        if len(names) != self.values["power"].size:
            raise BadInput(f"effect {self.name}: {len(names)} signals and {self.values['power'].size} powers")

    @classmethod
    def offered(cls, recorded: Collection[str]) -> list[dict[str, str]]:
        """Every set of up to TOGETHER recorded signals."""
        names = sorted(name.removeprefix(LOGGED) for name in recorded if name.startswith(LOGGED))
        several = [s for k in range(1, TOGETHER + 1) for s in combinations(names, k)]
        return [{"signal": ",".join(s), "signals": str(len(s))} for s in several]

    @classmethod
    def power(cls, x: Signals, tau_m: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """sum of power_i s_i [W] over the signals that are known."""
        if x.logged is None:
            return ca.SX(0)
        parts = [p.power[i] * x.logged[name] for i, name in enumerate(p.signal.split(",")) if name in x.logged]
        return sum(parts, ca.SX(0))


GAP = 3.0  # steps longer than this multiple of the usual one are gaps between runs


class WindingSelfHeating(HeatMemoryEffect):
    """r_over_kt2 of a joint grows by the factor 1 + rate * theta; dtheta/dt = (c - theta) / time_constant.

    c is the joint's copper loss [W] at the resistance of a cold winding, so that theta is its recent mean with
    exponential weights. The one-body thermal model of a motor: rate is the winding's temperature coefficient (0.0039
    1/K of copper) times its thermal resistance [K/W]. A set begins cold, and between its runs the arm holds its last
    pose. A plan is made with cold windings: a move is short beside their time constant.
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
        """1 + rate * heated, (n, 1); 1 in plans."""
        return 1 + p.rate * x.heated if x.heated is not None else 1 + 0 * p.rate

    @classmethod
    def heated(cls, time: np.ndarray, heat: np.ndarray, values: np.ndarray) -> np.ndarray:
        """theta (N, n) [W] at every instant, with the heat constant between instants (zero-order hold):

            theta[k+1] = keep theta[k] + (1 - keep) heat[k],     keep = exp(-dt / time_constant)

        Within a run the instants are evenly spaced, so `lfilter` computes this. In a gap between runs (longer than GAP
        times the usual step), the arm holds its last pose: theta tends to the last heat.

        Args:
            time: (N,) [s]. heat: (N, n) [W]. values: as `full`; the last one is the time constant [s].
        """
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
