"""Joint torques and electrical power of the virtual arm: drives, supply and meter.

Torques are split so that a time step can treat friction implicitly. Torque against the motion is written as D(v, tau) v
with a secant damping D >= 0. The simulator uses v at the end of the step there. This is stable for any friction and any
step, and comes to rest without chatter. At rest friction is zero, as sign(0) in the package's laws. All other torque is
explicit. The code uses NumPy and shares nothing with the package's expressions.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from energy_opt.virtual_arm.plant import Plant, Special

MOVING = 1e-3  # [rad/s] a faster joint counts as moving


def _growth_share(t: np.ndarray, time_constant: float) -> np.ndarray:
    """Share of the final growth reached at set time t [s], from 0 to 1."""
    return -np.expm1(-t / time_constant)


def electrical_power(plant: Plant, t: np.ndarray, v: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """Power at the mains, W, shape (N,), from set time t (N,), speed v and motor torque at the joint side (N, n)."""
    joints = v.shape[1]
    heat = np.zeros_like(v)
    resistance = plant.value("copper_loss", "r_over_kt2", joints)
    if resistance is not None:
        warm = _growth_share(t, plant.number("winding_temperature", "time_constant", 1.0))
        heat = resistance * torque**2 * (1 + plant.number("winding_temperature", "rate", 0.0) * warm)[:, None]

    drive = torque * v + heat
    total = drive.sum(axis=1)
    regeneration = plant.model.get("regeneration")
    if regeneration is not None:
        lost = 1 - float(regeneration.values["efficiency"][0])
        if regeneration.choices["level"] == "joint":
            total = total - lost * np.minimum(drive, 0).sum(axis=1)
        else:
            total = total - lost * np.minimum(total, 0)

    if plant.model.get("dc_link") is not None:
        total = _power_with_store(t, total, plant.number("dc_link", "capacity", 0.0))
    total = total + plant.number("inverter_loss", "c", 0.0) * np.abs(torque).sum(axis=1)
    total = total + plant.number("standby", "power", 0.0)
    drifted = _growth_share(t, plant.number("standby_drift", "time_constant", 1.0))
    total = total + plant.number("standby_drift", "power", 0.0) * drifted
    moving = np.abs(v).max(axis=1) > MOVING
    total = total + plant.number("motion_power", "power", 0.0) * moving
    hysteresis, eddy = plant.value("iron_loss", "hysteresis", joints), plant.value("iron_loss", "eddy", joints)
    if hysteresis is not None and eddy is not None:
        total = total + np.abs(v) @ hysteresis + np.square(v) @ eddy
    ended = np.maximum.accumulate(np.where(moving, t, -np.inf))
    held = ~moving & (t - ended < plant.number("idle_hold", "duration", 0.0))
    total = total + plant.number("idle_hold", "power", 0.0) * held
    for special in plant.specials:
        total = total + special.added_power(t)
    affine, quadratic = plant.number("psu_loss", "affine", 0.0), plant.number("psu_loss", "quadratic", 0.0)
    total = total + affine * np.abs(total) + quadratic * np.square(total)
    return total / plant.number("supply_efficiency", "eta", 1.0)


def _power_with_store(t: np.ndarray, bus: np.ndarray, capacity: float) -> np.ndarray:
    """Power (N,) [W] from the supply if a DC link stores returned energy, up to `capacity` [J], and is used first."""
    out, held = np.empty_like(bus), 0.0
    for k, (p, h) in enumerate(zip(bus, np.gradient(t), strict=True)):
        given = min(held, p * h) if p > 0 else 0.0
        held = min(capacity, held - given - min(p, 0.0) * h)
        out[k] = max(p, 0.0) - given / h
    return out


def reading(plant: Plant, time: np.ndarray, power: np.ndarray, step: float) -> np.ndarray:
    """Power as the meter shows it, (N,) [W]: delay, then lag, mean and gain. It is constant before and after the run.

    Args:
        plant: with the meter's effects. time: (N,) [s], evenly spaced. power: (N,) [W] true power. step: [s].
    """
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


REST_SPEED = 1e-3  # [rad/s] below this, dry friction falls to zero in proportion to v


# Friction torque (n,) [N m] by speed v and rigid-body torque tau: parameters and law of each effect.
DRY: dict[str, tuple[tuple[str, ...], Callable[..., Any]]] = {
    "coulomb_friction": (("tau_c",), lambda v, tau, tau_c: tau_c),
    "stribeck_friction": (("tau_s", "v_s"), lambda v, tau, tau_s, v_s: tau_s * np.exp(-np.square(v / v_s))),
    "load_friction": (("mu",), lambda v, tau, mu: mu * np.abs(tau)),
    "gear_efficiency": (("eta",), lambda v, tau, eta: (1 / eta - eta) / 2 * np.abs(tau)),
    "asymmetric_friction": (("tau_plus", "tau_minus"), lambda v, tau, plus, minus: np.where(v > 0, plus, minus)),
    "power_law_friction": (("c", "exponent"), lambda v, tau, c, exponent: c * np.abs(v) ** exponent),
}


class JointLaws:
    """Friction and other joint torques of a plant on an arm of n joints."""

    def __init__(self, plant: Plant, joints: int) -> None:
        def given(effect: str, *parameters: str) -> list[np.ndarray]:
            found = [plant.value(effect, parameter, joints) for parameter in parameters]
            return [value for value in found if value is not None]

        dry = [(law, given(effect, *names)) for effect, (names, law) in DRY.items()]
        self._dry = [(law, values) for law, values in dry if values]
        curve = _curve(plant, joints)
        if curve is not None:
            self._dry.append((lambda v, tau: curve(np.abs(v)), []))
        self._viscous, self._spring = given("viscous_friction", "b"), given("gravity_spring", "stiffness", "rest")
        self._gear = given("gear_efficiency", "eta")
        gear = plant.model.get("gear_efficiency")
        self._at_rest = "mean" if gear is None else gear.choices["rest"]
        self.specials = tuple(s for s in plant.specials if type(s).added_torque is not Special.added_torque)

    def damping(self, v: np.ndarray, tau: np.ndarray) -> np.ndarray | float:
        """Secant damping D [N m s/rad], shape (n,): friction torque is D v. `tau` is the rigid-body torque."""
        viscous: np.ndarray | float = self._viscous[0] if self._viscous else 0.0
        if not self._dry:
            return viscous
        return sum(law(v, tau, *values) for law, values in self._dry) / np.sqrt(v * v + REST_SPEED**2) + viscous

    def compensated_torque(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray | float:
        """Known torque (n,) [N m] that the motor must add and the controller compensates: springs and gear losses."""
        out: np.ndarray | float = 0.0
        if self._spring:
            stiffness, rest = self._spring
            out = -stiffness * (q - rest)
        for eta in self._gear:
            mean = (1 / eta + eta) / 2
            at_rest = {"mean": mean, "free": 1.0, "driving": 1 / eta, "driven": eta}[self._at_rest]
            out = out + tau * (mean - 1 + (at_rest - mean) * REST_SPEED**2 / (v * v + REST_SPEED**2))
        return out

    def disturbance_torque(self, q: np.ndarray, v: np.ndarray, travel: np.ndarray) -> np.ndarray | float:
        """Torque (n,) [N m] that the motor must add and the controller does not know: the specials.

        Args:
            q, v: (n,) [rad, rad/s]. travel: (n,) [rad] since each joint's last reversal.
        """
        out: np.ndarray | float = 0.0
        for special in self.specials:
            out = out + special.added_torque(q, v, travel)
        return out


def _curve(plant: Plant, joints: int) -> Callable[[np.ndarray], np.ndarray] | None:
    """Friction torque (n,) [N m] over speed (n,) by SciPy's monotone interpolation, straight beyond the last point."""
    found = plant.model.get("friction_curve")
    if found is None:
        return None
    from scipy.interpolate import PchipInterpolator

    speed = found.values["speed"]
    torque = np.broadcast_to(found.values["torque"], (joints, len(speed)))
    curves = [PchipInterpolator(speed, row) for row in torque]
    ends = np.array([max(float(c.derivative()(speed[-1])), 0.0) for c in curves])

    def at(v: np.ndarray) -> np.ndarray:
        past = np.maximum(v - speed[-1], 0.0)
        inside = [float(c(min(x, speed[-1]))) for c, x in zip(curves, v, strict=True)]
        return np.array(inside) + ends * past

    return at
