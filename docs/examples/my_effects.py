"""Two effects of one's own: `energy-opt optimize --effects my_effects.py --model my_model.toml ...`."""

import casadi as ca

from energy_opt.effects import Kinks, Parameter, PowerEffect, Signals


class JointBrake(PowerEffect):
    """power for every joint whose brake is released: it is while the joint moves."""

    name = "joint_brake"
    parameters = (Parameter("power", "W", neutral=0.0, lower=0.0, upper=1e3, size="joint"),)
    dissipates = True  # takes power, never gives any
    convex_in_retiming = False  # creeping would escape it

    @classmethod
    def power(cls, x: Signals, tau_m: ca.SX, p, k: Kinks) -> ca.SX:
        return sum(p.power[j] * k.moving(x.v[j]) for j in range(x.v.numel()))


class Fan(PowerEffect):
    """per_kelvin * (mean joint temperature - 25 degC); nothing where no temperature is measured, as in planning."""

    name = "fan"
    parameters = (Parameter("per_kelvin", "W/K", neutral=0.0, lower=0.0, upper=100.0),)
    overhead = True  # drawn whether the arm moves or not: counted as standby

    @classmethod
    def power(cls, x: Signals, tau_m: ca.SX, p, k: Kinks) -> ca.SX:
        if x.temperature is None:
            return 0 * p.per_kelvin
        return p.per_kelvin * (ca.sum1(x.temperature) / x.temperature.numel() - 25)
