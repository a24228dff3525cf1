"""The law of the drives: from motion and rigid-body torque to electrical power, split by effect.

tau_m = tau + sum of torque effects
d_j   = tau_m,j v_j + c_j               drive power of joint j, c_j its heat (copper loss, warmer windings)
p     = drawn(d) + sum of power effects
P     = supply(p)                       at the meter, meter effects aside

Where friction `holds`, a joint at rest is held by it as far as it goes, and only the rest of its load is the motor's:
plans are made and judged so, as friction that is nothing at v = 0 makes creeping cheaper than standing still. That help
is in the heat alone: friction never does work, and what limits hold is tau_m without it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca

from energy_opt.effects import (
    EXACT,
    DriveEffect,
    HeatEffect,
    Kinks,
    PowerEffect,
    Signals,
    StoreEffect,
    SupplyEffect,
    TorqueEffect,
    WindingEffect,
)
from energy_opt.effects.kinks import Along
from energy_opt.power.model import PowerModel


@dataclass(frozen=True)
class DriveTerms:
    """Motor torque tau_m (n, 1) [N m], power [W] and its parts by effect [W]; the parts add up to the power.

    `parts` has an entry "mechanical" (tau^T v of the rigid body) and one for every effect of the stages torque,
    heat, winding, drive, power and supply. `conservative` is the part [W] whose integral only the ends decide: the work
    of the rigid body's torque, of rotors and of springs, times what drives and supply let pass of it. `bus` is the
    joints' drive power [W].
    """

    tau_m: ca.SX
    power: ca.SX
    parts: dict[str, ca.SX]
    conservative: ca.SX
    bus: ca.SX


def drive_terms(model: PowerModel, x: Signals, p: ca.SX, kinks: Kinks = EXACT, holds: bool = False) -> DriveTerms:
    """The law as expressions; `p` is laid out as `PowerModel.values`; `holds`: does friction hold joints at rest?

    Of a mixture (see `mixture`): the weighted sums of its members', and the first one's motor torque.
    """
    members = [(w, _terms_of_one(model, x, part, kinks, holds)) for w, model, part in model.shares(x.q.numel(), p)]
    if len(members) == 1:
        return members[0][1]
    names = dict.fromkeys(name for _, terms in members for name in terms.parts)
    return DriveTerms(
        members[0][1].tau_m,
        sum((w * terms.power for w, terms in members), ca.SX(0)),
        {name: sum((w * terms.parts.get(name, 0) for w, terms in members), ca.SX(0)) for name in names},
        sum((w * terms.conservative for w, terms in members), ca.SX(0)),
        members[0][1].bus,
    )


def _held(x: Signals, torques: Callable[[Kinks], list[ca.SX]], kinks: Kinks) -> list[ca.SX]:
    """Added torques where friction holds: the sign of v in them is the direction that friction has."""
    way = ca.SX.sym("way", x.v.numel())
    along = torques(Along(kinks, x.v, way))
    total = sum(along, ca.SX.zeros(x.v.numel()))
    if not ca.depends_on(total, way):
        return along
    forwards, backwards = (ca.substitute(total, way, sign * ca.SX.ones(way.numel())) for sign in (1, -1))
    load, level = x.tau + (forwards + backwards) / 2, ca.fabs(forwards - backwards) / 2
    return [ca.substitute(torque, way, kinks.direction(x.v, load, level)) for torque in along]


def _terms_of_one(model: PowerModel, x: Signals, p: ca.SX, kinks: Kinks, holds: bool) -> DriveTerms:
    n = x.q.numel()
    named = [(e, e.named(p[s], n)) for e, s in zip(model.effects, model.slices(n), strict=True)]
    parts: dict[str, ca.SX] = {"mechanical": ca.dot(x.tau, x.v)}

    adding = [(effect, values) for effect, values in named if isinstance(effect, TorqueEffect)]

    def torques(kinks: Kinks) -> list[ca.SX]:
        return [effect.torque(x, values, kinks) for effect, values in adding]

    moved, tau_m = torques(kinks), x.tau
    for (torque, _), added in zip(adding, moved, strict=True):
        parts[torque.name] = ca.dot(added, x.v)
        tau_m = tau_m + added

    drive = tau_m * x.v
    borne = sum(_held(x, torques, kinks), x.tau) if holds else tau_m
    heats: dict[str, ca.SX] = {}
    for effect, values in named:
        if isinstance(effect, HeatEffect):
            heats[effect.name] = heat = effect.heat(x, borne, values, kinks)
            parts[effect.name] = ca.sum1(heat)
            drive = drive + heat
    for effect, values in named:
        if isinstance(effect, WindingEffect):
            more = (effect.factor(x, values) - 1) * sum(heats[name] for name in effect.needs)
            parts[effect.name] = ca.sum1(more)
            drive = drive + more

    power = bus = ca.sum1(drive)
    for effect, values in named:
        if isinstance(effect, DriveEffect):
            clamped = effect.drawn(drive, values, kinks)
            if isinstance(effect, StoreEffect) and x.returned is not None:
                clamped = clamped - x.returned
            parts[effect.name] = clamped - power
            power = clamped

    for effect, values in named:
        if isinstance(effect, PowerEffect):
            parts[effect.name] = effect.power(x, borne, values, kinks)
            power = power + parts[effect.name]

    for effect, values in named:
        if isinstance(effect, SupplyEffect):
            behind = power
            power = effect.at_meter(behind, values, kinks)
            parts[effect.name] = power - behind
    passed = ca.SX(1)
    for effect, values in named:
        passed *= effect.passed(values)
    stored = sum((parts[effect.name] for effect, _ in named if effect.stores), parts["mechanical"])
    return DriveTerms(tau_m, power, parts, passed * stored, bus)


def drive_function(
    model: PowerModel, joints: int, kinks: Kinks = EXACT, past: bool = False, holds: bool = False
) -> tuple[ca.Function, tuple[str, ...]]:
    """The law as a function (q, v, a, tau, t, p) -> (tau_m, power, parts), and the names of the parts in order.

    With `past` it also takes idle and returned (see `Signals`), before p, and gives the power of the bus.
    """
    q, v, a, tau = (ca.SX.sym(name, joints) for name in ("q", "v", "a", "tau"))
    known = {name: ca.SX.sym(name) for name in ("idle", "returned")} if past else {}
    x = Signals(q, v, a, tau, ca.SX.sym("t"), **known)
    p = model.symbols(joints)
    terms = drive_terms(model, x, p, kinks, holds)
    inputs = [x.q, x.v, x.a, x.tau, x.t, *known.values(), p]
    parts = ca.vertcat(*terms.parts.values())
    function = ca.Function(
        "drive",
        inputs,
        [terms.tau_m, terms.power, parts, *([terms.bus] if past else [])],
        ["q", "v", "a", "tau", "t", *known, "p"],
        ["tau_m", "power", "parts", *(["bus"] if past else [])],
    )
    return function, tuple(terms.parts)
