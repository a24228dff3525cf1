"""What the past adds to a motion that is known in order: time since motion ended, and what a store gives back."""

from __future__ import annotations

import numpy as np

from energy_opt.effects import StoreEffect
from energy_opt.effects.kinks import MOVING_SPEED
from energy_opt.power.model import PowerModel


def idle_time(time: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Time (N,) [s] since the last motion ended; -1 while any joint moves and before it first does.

    Args:
        time: (N,) s, increasing. v: (N, n) rad/s.
    """
    moving = np.abs(v).max(axis=1) > MOVING_SPEED
    last = np.maximum.accumulate(np.where(moving, np.arange(len(time)), -1))
    return np.where(moving | (last < 0), -1.0, time - time[np.maximum(last, 0)])


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
