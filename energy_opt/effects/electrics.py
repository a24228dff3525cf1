"""Effects of windings, drives, supply and overhead, which convert torque and speed into electrical power."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca

from energy_opt.effects.base import Signals
from energy_opt.effects.changing_friction import SOAKING, SOAKING_TRIALS
from energy_opt.effects.friction import SIGN_WIDTH, TORQUE_WIDTH
from energy_opt.effects.parameter import Kinks, Parameter
from energy_opt.effects.stages import DriveEffect, HeatEffect, PowerEffect, SupplyEffect, WindingEffect

POWER_WIDTH = 0.5  # [W] smoothing width of power about zero; times `ArmSize.power`


class Standby(PowerEffect):
    """Constant overhead power: the controller, the fans, the holding brakes."""

    name = "standby"
    parameters = (Parameter("power", "W", 0.0, 0.0, 1e6),)
    overhead = True

    @classmethod
    def power(cls, x: Signals, tau_m: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """The parameter itself [W]."""
        return p.power

    @classmethod
    def constant(cls, p: SimpleNamespace) -> ca.SX | float:
        """All of it is drawn at every instant [W]."""
        return p.power


class StandbyDrift(PowerEffect):
    """power * (1 - exp(-t / time_constant)): overhead that grows as the controller warms up."""

    name = "standby_drift"
    parameters = (
        Parameter("power", "W", 0.0, -1e4, 1e4),
        Parameter("time_constant", "s", 60.0, 1e-1, 1e5, shapes=True, fit=SOAKING, trials=SOAKING_TRIALS),
    )
    overhead = True
    drifts = True
    convex_in_retiming = False

    @classmethod
    def power(cls, x: Signals, tau_m: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """power (1 - exp(-t / time_constant)) [W]."""
        return p.power * (1 - ca.exp(-x.t / p.time_constant))


class MotionPower(PowerEffect):
    """Extra power while any joint moves (released brakes, the servo stage); a joint moves above 1e-3 rad/s.

    Retiming loses its convexity: creeping below that speed would escape the extra power.
    """

    name = "motion_power"
    parameters = (Parameter("power", "W", 0.0, 0.0, 1e5),)
    convex_in_retiming = False
    dissipates = True

    @classmethod
    def power(cls, x: Signals, tau_m: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """`power` [W] if any joint moves, else 0."""
        return p.power * k.moving(x.v)


class InverterLoss(PowerEffect):
    """c * sum |tau_m|: losses of the inverter in proportion to current.

    Retiming loses its convexity: |tau| / sqrt(b) is not convex in (tau, b) where copper loss is small beside it.
    """

    name = "inverter_loss"
    parameters = (Parameter("c", "W/(N m)", 0.0, 0.0, 1e3),)
    convex_in_retiming = False
    dissipates = True

    @classmethod
    def power(cls, x: Signals, tau_m: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """c sum_j |tau_m,j| [W]."""
        return p.c * ca.sum1(k.magnitude(tau_m, TORQUE_WIDTH * k.size.torque))


class CopperLoss(HeatEffect):
    """r_over_kt2 * tau_m^2 in every joint: Joule heat of the current that makes the torque (R / Kt^2).

    The winding loss of Petrichenko et al. 2024 (arXiv 2411.03194).
    """

    name = "copper_loss"
    parameters = (Parameter("r_over_kt2", "W/(N m)^2", 0.0, 0.0, 1e9, "joint", fit=(0.0, 1e3)),)
    dissipates = True

    @classmethod
    def heat(cls, x: Signals, tau_m: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """r_over_kt2,j tau_m,j^2 (n, 1) [W].

        The current is I = tau_m / Kt, and its Joule heat R I^2 = (R / Kt^2) tau_m^2.
        """
        return p.r_over_kt2 * tau_m**2


class WindingTemperature(WindingEffect):
    """Copper loss is multiplied by 1 + rate * (1 - exp(-t / time_constant)), t since the set's first sample."""

    name = "winding_temperature"
    parameters = (
        Parameter("rate", "1", 0.0, -0.5, 10.0, fit=(-0.5, 3.0)),
        Parameter("time_constant", "s", 60.0, 1e-1, 1e5, shapes=True, fit=SOAKING, trials=SOAKING_TRIALS),
    )
    drifts = True
    needs = ("copper_loss",)
    convex_in_retiming = False

    @classmethod
    def factor(cls, x: Signals, p: SimpleNamespace) -> ca.SX:
        """1 + rate (1 - exp(-t / time_constant)), a scalar."""
        return 1 + p.rate * (1 - ca.exp(-x.t / p.time_constant))


class Regeneration(DriveEffect):
    """The share `efficiency` of negative drive power is used again (1 = all, 0 = none).

    Drive power of a joint is tau_m * v + copper loss. `level` = "joint" clamps each joint's drive power, "bus" the sum.
    """

    name = "regeneration"
    parameters = (Parameter("efficiency", "1", 1.0, 0.0, 1.0),)
    options = {"level": ("bus", "joint")}
    dissipates = True

    @classmethod
    def drawn(cls, drive: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """e x + (1 - e) max(x, 0), x the drive power of each joint or their sum."""
        x = ca.sum1(drive) if p.level == "bus" else drive
        return ca.sum1(p.efficiency * x + (1 - p.efficiency) * k.positive(x, POWER_WIDTH * k.size.power))

    @classmethod
    def return_factor(cls, p: SimpleNamespace) -> ca.SX | float:
        """Stored mechanical power returns with the factor `efficiency`."""
        return p.efficiency


class SupplyEfficiency(SupplyEffect):
    """Power at the meter = power behind the supply / eta, standby included."""

    name = "supply_efficiency"
    parameters = (Parameter("eta", "1", 1.0, 0.05, 1.0, fit=(0.2, 1.0)),)

    @classmethod
    def at_meter(cls, power: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """P / eta [W]."""
        return power / p.eta

    @classmethod
    def return_factor(cls, p: SimpleNamespace) -> ca.SX | float:
        """Every watt behind the supply is 1 / eta W at the meter."""
        return 1 / p.eta


class PsuLoss(SupplyEffect):
    """P + affine * |P| + quadratic * P^2 at the meter, P the power behind the supply, standby included."""

    name = "psu_loss"
    parameters = (Parameter("affine", "1", 0.0, 0.0, 10.0), Parameter("quadratic", "1/W", 0.0, 0.0, 1.0))
    convex_in_retiming = False
    dissipates = True

    @classmethod
    def at_meter(cls, power: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """P + affine |P| + quadratic P^2 [W]."""
        return power + p.affine * k.magnitude(power, POWER_WIDTH * k.size.power) + p.quadratic * power**2


class IronLoss(PowerEffect):
    """sum of hysteresis * |v| + eddy * v^2: losses of the motors' iron. They are drawn as power and add no torque.

    Per cycle of the field, hysteresis loses a constant energy and eddy currents one in proportion to the frequency
    (Bertotti, IEEE Transactions on Magnetics 24(1), 1988). Retiming loses its convexity by the eddy currents: their
    energy grows with the root of squared path speed.
    """

    name = "iron_loss"
    parameters = (
        Parameter("hysteresis", "W s/rad", 0.0, 0.0, 1e4, "joint"),
        Parameter("eddy", "W s^2/rad^2", 0.0, 0.0, 1e4, "joint"),
    )
    convex_in_retiming = False
    dissipates = True

    @classmethod
    def power(cls, x: Signals, tau_m: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """sum_j hysteresis_j |v_j| + eddy_j v_j^2 [W]."""
        return ca.dot(p.hysteresis, k.magnitude(x.v, SIGN_WIDTH)) + ca.dot(p.eddy, x.v**2)
