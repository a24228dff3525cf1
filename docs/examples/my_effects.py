"""Two effects of your own: `energy-opt optimize --effects my_effects.py --model my_model.toml ...`."""

from types import SimpleNamespace

import casadi as ca

from energy_opt.effects import Kinks, Parameter, PowerEffect, Signals


class JointBrake(PowerEffect):
    """power for every joint that moves: its brake is released and takes this power."""

    name = "joint_brake"
    parameters = (Parameter("power", "W", neutral=0.0, lower=0.0, upper=1e3, size="joint"),)
    dissipates = True  # takes power, never gives any
    convex_in_retiming = False  # creeping would escape it

    @classmethod
    def power(cls, x: Signals, tau_m: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        return ca.SX(sum(p.power[j] * k.moving(x.v[j]) for j in range(x.v.numel())))


class Fan(PowerEffect):
    """per_kelvin * (mean joint temperature - 25 degC); 0 if no temperature is measured, as in planning."""

    name = "fan"
    parameters = (Parameter("per_kelvin", "W/K", neutral=0.0, lower=0.0, upper=100.0),)
    overhead = True  # drawn whether the arm moves or not: counted as standby

    @classmethod
    def power(cls, x: Signals, tau_m: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        if x.temperature is None:
            return ca.SX(0)
        return ca.SX(p.per_kelvin * (ca.sum1(x.temperature) / x.temperature.numel() - 25))
