"""Electrical power of the virtual arm: drives, supply and meter, in numpy, apart from the library's expressions."""

from __future__ import annotations

import numpy as np

from energy_opt.virtual_arm.plant import Plant

MOVING = 1e-3  # [rad/s] a joint that is faster moves


def _growth(t: np.ndarray, time_constant: float) -> np.ndarray:
    """What has grown by set time t [s], from 0 to 1."""
    return -np.expm1(-t / time_constant)


def electrical_power(plant: Plant, t: np.ndarray, v: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """Power at the mains, W, shape (N,), from set time t (N,), speed v and motor torque at the joint side (N, n)."""
    joints = v.shape[1]
    heat = np.zeros_like(v)
    resistance = plant.value("copper_loss", "r_over_kt2", joints)
    if resistance is not None:
        heat = resistance * torque**2
        rate = plant.number("winding_temperature", "rate", 0.0)
        if rate:
            warm = 1 + rate * _growth(t, plant.number("winding_temperature", "time_constant", 1.0))
            heat = heat * warm[:, None]

    drive = torque * v + heat
    total = drive.sum(axis=1)
    regeneration = plant.model.get("regeneration")
    if regeneration is not None:
        lost = 1 - float(regeneration.values["efficiency"][0])
        if regeneration.choices["level"] == "joint":
            total = total - lost * np.minimum(drive, 0).sum(axis=1)
        else:
            total = total - lost * np.minimum(total, 0)

    capacity = plant.number("dc_link", "capacity", 0.0)
    if plant.model.get("dc_link") is not None:
        total = _linked(t, total, capacity)
    total = total + plant.number("inverter_loss", "c", 0.0) * np.abs(torque).sum(axis=1)
    total = total + plant.number("standby", "power", 0.0)
    drift = plant.number("standby_drift", "power", 0.0)
    if drift:
        total = total + drift * _growth(t, plant.number("standby_drift", "time_constant", 1.0))
    total = total + plant.number("motion_power", "power", 0.0) * (np.abs(v).max(axis=1) > MOVING)
    hysteresis, eddy = plant.value("iron_loss", "hysteresis", joints), plant.value("iron_loss", "eddy", joints)
    if hysteresis is not None and eddy is not None:
        total = total + np.abs(v) @ hysteresis + np.square(v) @ eddy
    if plant.model.get("idle_hold") is not None:
        moving = np.abs(v).max(axis=1) > MOVING
        ended = np.maximum.accumulate(np.where(moving, t, -np.inf))
        held = ~moving & (t - ended < plant.number("idle_hold", "duration", 0.0))
        total = total + plant.number("idle_hold", "power", 0.0) * held
    for special in plant.specials:
        total = total + special.added_power(t)
    affine, quadratic = plant.number("psu_loss", "affine", 0.0), plant.number("psu_loss", "quadratic", 0.0)
    total = total + affine * np.abs(total) + quadratic * np.square(total)
    return total / plant.number("supply_efficiency", "eta", 1.0)


def _linked(t: np.ndarray, bus: np.ndarray, capacity: float) -> np.ndarray:
    """What the supply gives (N,) [W] where a link takes what comes back, up to `capacity` [J], and gives it first."""
    out, held = np.empty_like(bus), 0.0
    for k, (p, h) in enumerate(zip(bus, np.gradient(t), strict=True)):
        given = min(held, p * h) if p > 0 else 0.0
        held = min(capacity, held - given - min(p, 0.0) * h)
        out[k] = max(p, 0.0) - given / h
    return out


def reading(plant: Plant, time: np.ndarray, power: np.ndarray, step: float) -> np.ndarray:
    """What the meter makes of the power, W, on the same times (N,): delay, lag and gain; constant before and after."""
    delay = plant.number("meter_delay", "delay", 0.0)
    if delay:
        power = np.interp(time - delay, time, power)
    lag = plant.number("meter_filter", "time_constant", 0.0)
    if lag > 0:
        from scipy.signal import lfilter

        keep = float(np.exp(-step / lag))
        power = lfilter([1 - keep], [1.0, -keep], power, zi=[keep * power[0]])[0]
    width = round(plant.number("meter_window", "duration", 0.0) / step)
    if width > 1:
        before = np.concatenate([np.full(width, power[0]), power])
        power = np.convolve(before, np.ones(width) / width, "valid")[1:]
    return plant.number("meter_gain", "gain", 1.0) * power
