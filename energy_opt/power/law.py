"""The law of the drives: from motion and rigid-body torque to electrical power, split by effect.

tau_m = tau + sum of torque effects
d_j   = tau_m,j v_j + c_j               drive power of joint j, c_j its copper loss
p     = regeneration(d) + sum of power effects
P     = p / eta                         at the meter, meter effects aside
"""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import cast

import casadi as ca

from energy_opt.effects import EXACT, Effect, Kinks, Signals
from energy_opt.effects.base import PowerEffect, TorqueEffect
from energy_opt.effects.electrics import CopperLoss, Regeneration, SupplyEfficiency, WindingTemperature
from energy_opt.power.model import PowerModel


@dataclass(frozen=True)
class DriveTerms:
    """Motor torque tau_m (n, 1) [N m], power [W] and its parts by effect [W]; the parts add up to the power.

    `parts` has an entry "mechanical" (tau^T v of the rigid body) and one for every effect of the stages torque,
    copper, drive, power and supply.
    """

    tau_m: ca.SX
    power: ca.SX
    parts: dict[str, ca.SX]


def drive_terms(model: PowerModel, x: Signals, p: ca.SX, kinks: Kinks = EXACT) -> DriveTerms:
    """The law as expressions; `p` is laid out as `PowerModel.values`."""
    n = x.q.numel()
    named: list[tuple[Effect, SimpleNamespace]] = [
        (e, type(e).split(p[s], n)) for e, s in zip(model.effects, model.slices(n), strict=True)
    ]
    of = {e.name: (e, values) for e, values in named}
    parts: dict[str, ca.SX] = {"mechanical": ca.dot(x.tau, x.v)}

    tau_m = x.tau
    for effect, values in named:
        if effect.stage == "torque":
            added = cast(TorqueEffect, effect).torque(x, values, kinks)
            parts[effect.name] = ca.dot(added, x.v)
            tau_m = tau_m + added

    drive = tau_m * x.v
    if CopperLoss.name in of:
        heat = CopperLoss.heat(tau_m, of[CopperLoss.name][1])
        parts[CopperLoss.name] = ca.sum1(heat)
        if WindingTemperature.name in of:
            hot = (WindingTemperature.factor(x.t, of[WindingTemperature.name][1]) - 1) * heat
            parts[WindingTemperature.name] = ca.sum1(hot)
            heat = heat + hot
        drive = drive + heat

    power = ca.sum1(drive)
    if Regeneration.name in of:
        effect, values = of[Regeneration.name]
        clamped = Regeneration.power(drive, values, kinks, effect.choices["level"])
        parts[Regeneration.name] = clamped - power
        power = clamped

    for effect, values in named:
        if effect.stage == "power":
            parts[effect.name] = cast(PowerEffect, effect).power(x, tau_m, values, kinks)
            power = power + parts[effect.name]

    if SupplyEfficiency.name in of:
        behind = power
        power = SupplyEfficiency.power(behind, of[SupplyEfficiency.name][1])
        parts[SupplyEfficiency.name] = power - behind
    return DriveTerms(tau_m, power, parts)


def drive_function(model: PowerModel, joints: int, kinks: Kinks = EXACT) -> tuple[ca.Function, tuple[str, ...]]:
    """The law as a function (q, v, a, tau, t, p) -> (tau_m, power, parts), and the names of the parts in order."""
    q, v, a, tau = (ca.SX.sym(name, joints) for name in ("q", "v", "a", "tau"))
    x = Signals(q, v, a, tau, ca.SX.sym("t"))
    p = model.symbols(joints)
    terms = drive_terms(model, x, p, kinks)
    inputs = [x.q, x.v, x.a, x.tau, x.t, p]
    parts = ca.vertcat(*terms.parts.values())
    function = ca.Function(
        "drive",
        inputs,
        [terms.tau_m, terms.power, parts],
        ["q", "v", "a", "tau", "t", "p"],
        ["tau_m", "power", "parts"],
    )
    return function, tuple(terms.parts)
