"""What the past adds to a motion that is known in order: time since motion ended, and what a store gives back."""

from __future__ import annotations

import casadi as ca
import numpy as np

from energy_opt.effects import EXACT, HeatEffect, Signals, SoakingEffect, StoreEffect
from energy_opt.effects.kinks import MOVING_SPEED
from energy_opt.power.model import PowerModel

BRIEF = 0.1  # [s]


def idle_time(time: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Time (N,) [s] since the last motion ended; -1 while any joint moves and before it first does.

    Args:
        time: (N,) s, increasing. v: (N, n) rad/s.
    """
    moving = np.abs(v).max(axis=1) > MOVING_SPEED
    last = np.maximum.accumulate(np.where(moving, np.arange(len(time)), -1))
    return np.where(moving | (last < 0), -1.0, time - time[np.maximum(last, 0)])


def dwells(time: np.ndarray, v: np.ndarray) -> np.ndarray:
    """How many standstills between two motions of a run have passed their middle at each instant (N,).

    Motions and standstills of less than `BRIEF` s are none: speeds from positions have noise.

    Args:
        time: (N,) s, increasing. v: (N, n) rad/s.
    """
    moving = np.abs(v).max(axis=1) > MOVING_SPEED
    for state in (True, False):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], moving == state, [0]])))
        for first, last in edges.reshape(-1, 2):
            if time[min(last, len(time) - 1)] - time[first] < BRIEF:
                moving[first:last] = not state
    ends, begins = np.flatnonzero(moving[:-1] & ~moving[1:]), np.flatnonzero(~moving[:-1] & moving[1:])
    begins = begins[np.searchsorted(begins, ends[0]) :] if ends.size else begins[:0]
    count = min(len(ends), len(begins))
    middles = (time[ends[:count]] + time[begins[:count]]) / 2
    return np.searchsorted(middles, time, side="right").astype(float)


def heated(model: PowerModel, time: np.ndarray, tau_m: np.ndarray) -> np.ndarray:
    """What `Signals.heated` is of the model's soaking effect, (N, n) W; zeros where it has none.

    Args:
        time: (N,) s, increasing. tau_m: (N, n) N m of the motors.
    """
    n = tau_m.shape[1]
    soaking = next((e for e in model.effects if isinstance(e, SoakingEffect)), None)
    if soaking is None:
        return np.zeros_like(tau_m)
    torque, none = ca.SX.sym("tau_m", n), ca.SX.zeros(n)
    x = Signals(none, none, none, torque, ca.SX(0))
    sources = [e for e in model.effects if isinstance(e, HeatEffect) and e.name in soaking.needs]
    heat = sum((e.heat(x, torque, e.named(ca.DM(e.full(n)), n), EXACT) for e in sources), ca.SX.zeros(n))
    by_joint = np.array(ca.Function("heat", [torque], [ca.densify(heat)])(tau_m.T)).T
    return soaking.soaked(time, by_joint, soaking.full(n))


def store_of(model: PowerModel) -> StoreEffect | None:
    """The effect of a model that stores negative power, or None."""
    return next((e for e in model.effects if isinstance(e, StoreEffect)), None)


def returned_power(model: PowerModel, step: np.ndarray, bus: np.ndarray) -> np.ndarray:
    """Power (N,) [W] that the model's store gives back at each of N instants that stand for `step` (N,) s."""
    store = store_of(model)
    if store is None:
        return np.zeros_like(bus)
    value = float(store.full(1)[0])
    return np.asarray(store.supplied(step, bus, 0.0) - store.supplied(step, bus, value))
