"""The base classes of the effects, one for each stage of the power law (see `base`), except the meter's."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from energy_opt.effects.base import Effect, Signals
from energy_opt.effects.parameter import Kinks

# Mass [kg], centre of mass (3, 1) [m], inertia (3, 3) [kg m^2] about it: numbers or symbols.
Link = tuple[Any, Any, Any]


class RigidEffect(Effect):
    """Changes the rigid body itself."""

    stage = "rigid"

    @classmethod
    def gravity(cls, gravity: ca.SX, p: SimpleNamespace) -> ca.SX:
        """Gravity (3, 1) [m/s^2] in the base frame, from what it is without the effect."""
        return gravity

    @classmethod
    def links(cls, nominal: Sequence[Link], p: SimpleNamespace) -> list[Link] | None:
        """Actual links, in joint order, from the URDF's links; None for an effect that does not change them."""
        return None

    @classmethod
    def point_mass(cls, p: SimpleNamespace) -> tuple[ca.SX, ca.SX] | None:
        """Mass [kg] and its place (3, 1) [m] in the last joint's frame; None for an effect that adds none."""
        return None

    @classmethod
    def changing_mass(cls, x: Signals, p: SimpleNamespace) -> tuple[ca.SX, ca.SX, ca.SX] | None:
        """Mass [kg], place (3, 1) [m] in the last joint's frame and the share of it that is there at an instant.

        None for an effect whose mass does not change in mid-run. In plans such a mass is not there.
        """
        return None


class TorqueEffect(Effect):
    """Adds to the motor's torque at the joint side. In the laws, n is the number of joints."""

    stage = "torque"

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """Added torque (n, 1) [N m]. x: state; p: parameters by name, see `Effect`; k: functions for kinks."""
        raise NotImplementedError


class HeatEffect(Effect):
    """Heat of each joint's drive, part of its drive power."""

    stage = "heat"

    @classmethod
    def heat(cls, x: Signals, tau_m: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """Heat of each joint (n, 1) [W]; tau_m: the motors' torque (n, 1) [N m], with all torque effects."""
        raise NotImplementedError


class WindingEffect(Effect):
    """Multiplies the heat of the effects that it `needs`."""

    stage = "winding"

    @classmethod
    def factor(cls, x: Signals, p: SimpleNamespace) -> ca.SX:
        """Factor on that heat, a scalar or (n, 1)."""
        raise NotImplementedError


class HeatMemoryEffect(WindingEffect):
    """Multiplies heat by a factor that depends on the joints' earlier heat: its law runs over time.

    Its last parameter is the time constant of this memory; the signal `heated` depends on this parameter only.
    """

    follows = ("heated",)

    @classmethod
    def heated(cls, time: np.ndarray, heat: np.ndarray, values: np.ndarray) -> np.ndarray:
        """The signal `heated` (N, n) [W] from the heat (N, n) [W] at times (N,) [s]; `values` are as `full`."""
        raise NotImplementedError


class DriveEffect(Effect):
    """Converts the joints' drive powers into the power drawn from the bus."""

    stage = "drive"

    @classmethod
    def drawn(cls, drive: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """Power (1, 1) [W] drawn from the bus; drive: of each joint, tau_m v + heat (n, 1) [W], negative in braking."""
        raise NotImplementedError


class StoreEffect(DriveEffect):
    """Keeps some of the drives' negative power and gives it back: its law runs over time.

    If the past is unknown, `drawn` is the law: nothing comes back, so a plan's energy is never below the true one. If
    the powers are known in the order of time, `supplied` is the law.
    """

    follows = ("returned",)

    @classmethod
    def supplied(cls, step: np.ndarray, bus: np.ndarray, value: float) -> np.ndarray:
        """Power (N,) [W] that the supply gives, from the drives' power `bus` (N,) [W], each for `step` (N,) s."""
        raise NotImplementedError


class PowerEffect(Effect):
    """Adds to the power of the whole arm."""

    stage = "power"

    @classmethod
    def power(cls, x: Signals, tau_m: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """Added power (1, 1) [W]; tau_m: the motors' torque (n, 1) [N m], with all torque effects."""
        raise NotImplementedError

    @classmethod
    def constant(cls, p: SimpleNamespace) -> ca.SX | float:
        """Power [W] that it adds at every instant, whatever the arm does; 0 if there is none."""
        return 0.0


class SupplyEffect(Effect):
    """Between the drives and the meter."""

    stage = "supply"

    @classmethod
    def at_meter(cls, power: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """Power at the meter (1, 1) [W]; power: behind the supply (1, 1) [W], negative while more is returned."""
        raise NotImplementedError
