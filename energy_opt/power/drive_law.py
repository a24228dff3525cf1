"""The law of the drives: electrical power from motion and rigid-body torque, split by effect.

    tau_m = tau + sum of torque effects
    d_j   = tau_m,j v_j + c_j               drive power of joint j, c_j its heat (copper loss, warmer windings)
    p     = drawn(d) + sum of power effects
    P     = supply(p)                       at the meter, meter effects aside

If friction `holds`, it bears the load of a joint at rest as far as it can, and the motor bears only the rest. The
planner and the judge use this rule: if friction were zero at v = 0, slow creeping would cost less than rest. This rule
changes only the heat. Friction never does work, and limits on effort apply to tau_m without it.

The file also computes signals of the past of a known motion (time since motion ended, power returned by a store), and
the numeric values of the effects that change the rigid body.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import lru_cache

import casadi as ca
import numpy as np

from energy_opt.effects import (
    EXACT,
    DriveEffect,
    Effect,
    HeatEffect,
    HeatMemoryEffect,
    Kinks,
    PowerEffect,
    RigidEffect,
    Signals,
    StoreEffect,
    SupplyEffect,
    TorqueEffect,
    WindingEffect,
)
from energy_opt.effects.parameter import along
from energy_opt.power.model import PowerModel
from energy_opt.power.structure import SharedByStructure
from energy_opt.robot import PointMass, RigidBody


@dataclass(frozen=True)
class DriveTerms:
    """The law at one instant.

    Attributes:
        tau_m: motor torque (n, 1) [N m].
        power: at the meter [W].
        parts: power [W] by effect, with an entry "mechanical" (tau^T v of the rigid body) and one for every effect of
            the stages torque, heat, winding, drive, power and supply. They add up to `power`.
        conservative: the part [W] whose integral depends on the ends only: the power of the rigid body's torque, of
            rotors and of springs, times the share that drives and supply let pass.
        bus: sum of the joints' drive powers [W].
        powers: (K, 1) [W] at the meter under each member of a mixture; `power` of one model.
    """

    tau_m: ca.SX
    power: ca.SX
    parts: dict[str, ca.SX]
    conservative: ca.SX
    bus: ca.SX
    powers: ca.SX


def drive_terms(model: PowerModel, x: Signals, p: ca.SX, kinks: Kinks = EXACT, holds: bool = False) -> DriveTerms:
    """The law as expressions.

    Args:
        model: the effects. Of a mixture, all results are weighted sums over its members, except the motor torque and
            bus power, which are the first member's.
        x: the state at the instant; tau of all `bodies` of the model, one after the other. p: parameters, laid out as
            `PowerModel.values`.
        kinks: exact or rounded kinks. holds: whether friction holds joints at rest.
    """
    n = x.q.numel()
    members = [
        (w, _terms_of_one(member, replace(x, tau=x.tau[k * n : (k + 1) * n]), part, kinks, holds))
        for w, member, k, part in model.shares(n, p)
    ]
    if len(members) == 1:
        return members[0][1]
    names = dict.fromkeys(name for _, terms in members for name in terms.parts)
    return DriveTerms(
        members[0][1].tau_m,
        sum((w * terms.power for w, terms in members), ca.SX(0)),
        {name: sum((w * terms.parts.get(name, 0) for w, terms in members), ca.SX(0)) for name in names},
        sum((w * terms.conservative for w, terms in members), ca.SX(0)),
        members[0][1].bus,
        ca.vertcat(*(terms.power for _, terms in members)),
    )


def _torques_with_holding_friction(x: Signals, torques: Callable[[Kinks], list[ca.SX]], kinks: Kinks) -> list[ca.SX]:
    """Torques (n, 1) [N m] of all torque effects, if friction holds joints at rest.

    Each law is evaluated with a free sign of the velocity, `way`. The sum at way = +1 and at -1 gives the load without
    friction (their mean, plus the rigid body's torque) and the level of friction (half their difference).
    `Kinks.direction` then decides the sign.

    Args:
        x: the state. torques: the torques of all effects under given kinks. kinks: exact or rounded.
    """
    way = ca.SX.sym("way", x.v.numel())
    added = torques(along(kinks, x.v, way))
    total = sum(added, ca.SX.zeros(x.v.numel()))
    if not ca.depends_on(total, way):
        return added
    forwards, backwards = (ca.substitute(total, way, sign * ca.SX.ones(way.numel())) for sign in (1, -1))
    load, level = x.tau + (forwards + backwards) / 2, ca.fabs(forwards - backwards) / 2
    return [ca.substitute(torque, way, kinks.direction(x.v, load, level)) for torque in added]


def _terms_of_one(model: PowerModel, x: Signals, p: ca.SX, kinks: Kinks, holds: bool) -> DriveTerms:
    """`drive_terms` of a single model, stage by stage as in the module's text."""
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
    borne = sum(_torques_with_holding_friction(x, torques, kinks), x.tau) if holds else tau_m
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
        passed *= effect.return_factor(values)
    stored = sum((parts[effect.name] for effect, _ in named if effect.stores), parts["mechanical"])
    return DriveTerms(tau_m, power, parts, passed * stored, bus, power)


def drive_function(
    model: PowerModel, joints: int, kinks: Kinks = EXACT, past: bool = False, holds: bool = False
) -> tuple[ca.Function, tuple[str, ...]]:
    """The law as a function (q, v, a, tau, t, p) -> (tau_m, power, parts), and the names of the parts in order.

    Models of the same structure share the function, which is built once.

    Args:
        model, joints: the effects, and the number of joints. kinks, holds: as `drive_terms`.
        past: whether the function also takes `idle` [s] and `returned` [W] (see `Signals`) before p, and also returns
            `bus` and `powers` of `DriveTerms`.
    """
    return _drive(SharedByStructure(model), joints, kinks, past, holds)


@lru_cache(maxsize=64)
def _drive(
    shared_by: SharedByStructure, joints: int, kinks: Kinks, past: bool, holds: bool
) -> tuple[ca.Function, tuple[str, ...]]:
    """`drive_function`, kept for further models of the same structure."""
    model = shared_by.model
    q, v, a = (ca.SX.sym(name, joints) for name in ("q", "v", "a"))
    tau = ca.SX.sym("tau", joints * len(model.bodies))
    known = {name: ca.SX.sym(name) for name in ("idle", "returned")} if past else {}
    x = Signals(q, v, a, tau, ca.SX.sym("t"), **known)
    p = model.symbols(joints)
    terms = drive_terms(model, x, p, kinks, holds)
    inputs = {"q": x.q, "v": x.v, "a": x.a, "tau": x.tau, "t": x.t, **known, "p": p}
    parts = ca.vertcat(*terms.parts.values())
    outputs = {"tau_m": terms.tau_m, "power": terms.power, "parts": parts}
    outputs |= {"bus": terms.bus, "powers": terms.powers} if past else {}
    function = ca.Function("drive", [*inputs.values()], [*outputs.values()], [*inputs], [*outputs])
    return function, tuple(terms.parts)


def heated(model: PowerModel, time: np.ndarray, tau_m: np.ndarray) -> np.ndarray:
    """`Signals.heated` (N, n) [W] for the model's memory effect; zeros if it has none.

    Args:
        time: (N,) s, increasing. tau_m: (N, n) N m of the motors.
    """
    n = tau_m.shape[1]
    memory = next((e for e in model.effects if isinstance(e, HeatMemoryEffect)), None)
    if memory is None:
        return np.zeros_like(tau_m)
    torque, none = ca.SX.sym("tau_m", n), ca.SX.zeros(n)
    x = Signals(none, none, none, torque, ca.SX(0))
    sources = [e for e in model.effects if isinstance(e, HeatEffect) and e.name in memory.needs]
    heat = sum((e.heat(x, torque, e.named(ca.DM(e.full(n)), n), EXACT) for e in sources), ca.SX.zeros(n))
    by_joint = np.array(ca.Function("heat", [torque], [ca.densify(heat)])(tau_m.T)).T
    return memory.heated(time, by_joint, memory.full(n))


def store_of(model: PowerModel) -> StoreEffect | None:
    """The effect of a model that stores negative power, or None."""
    return next((e for e in model.effects if isinstance(e, StoreEffect)), None)


FULL_USE = 1e9  # [W] power that empties any store within a second


def returned_power(
    model: PowerModel, step: np.ndarray, bus: np.ndarray, stored: float = 0.0
) -> tuple[np.ndarray, float]:
    """Power (N,) [W] that the model's store gives back, and the energy [J] that it holds at the end.

    The power is the supply's with a store of no capacity minus that with the model's store. One more instant before the
    first fills the store, and one more after the last empties it.

    Args:
        model: the effects. step: (N,) [s] duration of each instant. bus: (N,) [W] sum of the drive powers.
        stored: energy [J] in the store at the first instant.
    """
    store = store_of(model)
    if store is None:
        return np.zeros_like(bus), 0.0
    value = float(store.full(1)[0])
    step, bus = np.concatenate([[1.0], step, [1.0]]), np.concatenate([[-stored], bus, [FULL_USE]])
    out = np.asarray(store.supplied(step, bus, 0.0) - store.supplied(step, bus, value))
    return out[1:-1], float(out[-1])


def body_of(model: PowerModel, body: RigidBody) -> RigidBody:
    """The rigid body with the model's links; with the URDF's links if the model does not change them."""
    return _with_links(body, _rigid(model.effects)) or body


def rigid_inputs(model: PowerModel, body: RigidBody) -> tuple[PointMass | None, np.ndarray]:
    """The model's payload (None where it has none) and gravity (3,) [m/s^2] in the robot's base frame.

    Of a mixture, those of its first member.
    """
    return _inputs(body, _rigid(model.bodies[0].effects))


def _rigid(effects: Iterable[Effect]) -> tuple[RigidEffect, ...]:
    return tuple(effect for effect in effects if isinstance(effect, RigidEffect))


@lru_cache(maxsize=64)
def _with_links(body: RigidBody, effects: tuple[RigidEffect, ...]) -> RigidBody | None:
    """The body with the links of the first effect that changes them; None if none does."""
    nominal = [(x.mass, ca.DM(x.lever), ca.DM(x.inertia)) for x in (body.plain.own_links() if effects else ())]
    for effect in effects:
        links = effect.links(nominal, effect.named(ca.DM(effect.full(body.n)), body.n))
        if links is not None:
            changed = [np.stack([np.array(x).squeeze() for x in part]) for part in zip(*links, strict=True)]
            return body.with_links(*changed)
    return None


@lru_cache(maxsize=64)
def _inputs(body: RigidBody, effects: tuple[RigidEffect, ...]) -> tuple[PointMass | None, np.ndarray]:
    """Payload and gravity of the effects, as of `rigid_inputs`."""
    gravity, mass = ca.DM(body.gravity), None
    for effect in effects:
        p = effect.named(ca.DM(effect.full(body.n)), body.n)
        gravity = effect.gravity(gravity, p)
        point = effect.point_mass(p)
        mass = mass if point is None else PointMass(float(point[0]), np.array(point[1]).ravel())
    out = np.array(gravity).ravel()
    out.flags.writeable = False  # all callers share it
    return mass, out


def rigid_torque(model: PowerModel, body: RigidBody, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Rigid-body torque (N, n B) [N m] with payload, tilt and links of the model's B `bodies`, by Pinocchio.

    Args:
        model: its rigid effects. body: the arm's. q, v, a: (N, n) [rad, rad/s, rad/s^2].
    """
    out = []
    for one in model.bodies:
        own = body_of(one, body)
        payload, gravity = rigid_inputs(one, own)
        changed = None if np.array_equal(gravity, own.gravity) else gravity
        out.append(own.torque(q, v, a, payload, changed))
    return out[0] if len(out) == 1 else np.hstack(out)
