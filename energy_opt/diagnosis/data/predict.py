"""The readings that a model predicts at the samples, with derivatives by every parameter of every effect.

The power law is that of planning, evaluated by CasADi with its gradient. Rigid torque is linear in the links' inertial
parameters and in gravity, so the regressors of the samples give it and its derivatives. Effects of the meter come last.
Only a store's size and the time constant of warming windings are differentiated by finite differences.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from energy_opt.diagnosis.data.samples import Samples, pieces, times
from energy_opt.effects import (
    EXACT,
    HeatMemoryEffect,
    MeterEffect,
    RigidEffect,
    Signals,
    TorqueEffect,
    of_form,
)
from energy_opt.numerics.batch import Batch
from energy_opt.power import PowerModel, drive_terms
from energy_opt.power.drive_law import heated, returned_power, store_of

MOST_RIGID = 6  # rigid-body torques kept in the cache
STORE_STEP = 1e-3  # step of finite differences, over a store's capacity or a time constant
AT_ONCE = 2048  # nodes per batch: a batch holds its arrays, and batches are cached
PER_JOINT = ("temperature", "warmth", "heated")  # signals with one value per joint
HOURS = 4 * 3600.0  # [s] duration from which a set may show the time of day


@dataclass(frozen=True)
class Prediction:
    """Readings under a model: M readings from K nodes.

    Attributes:
        metered: (K,) [W] the meter's view of the power at the nodes.
        reading: (M,) [W]. jacobian: (M, P) by `PowerModel.values`. external: (M, c) by the amounts of further torques,
            see `predict`.
        power: (K,) [W] true power before the meter. tau, tau_m: (K, n) [N m] torque of the rigid body and of the
            motors.
        by_tau: (K, n) d power / d tau.
    """

    metered: np.ndarray
    reading: np.ndarray
    jacobian: np.ndarray
    external: np.ndarray
    power: np.ndarray
    tau: np.ndarray
    tau_m: np.ndarray
    by_tau: np.ndarray


@lru_cache(maxsize=256)
def _drive(structure: tuple[tuple[str, ...], ...], n: int, known: tuple[str, ...]) -> ca.Function:
    """The law of a structure: ((q, v, a, tau, t, known), p) -> (power, bus, tau_m, dP/dtau, dP/dp) as one column.

    `known`: names of the available signals of the past and the recording, see `Signals`.
    """
    model = PowerModel("", tuple(of_form(form, n) for form in structure))
    q, v, a, tau = (ca.SX.sym(name, n) for name in ("q", "v", "a", "tau"))
    past = {name: ca.SX.sym(name, n if name in PER_JOINT else 1) for name in known}
    x = Signals(q, v, a, tau, ca.SX.sym("t"), **_named(past))
    p = model.symbols(n)
    terms = drive_terms(model, x, p)
    by_p, by_tau = ca.gradient(terms.power, p), ca.gradient(terms.power, x.tau)
    out = ca.densify(ca.vertcat(terms.power, terms.bus, terms.tau_m, by_tau, by_p))
    return ca.Function("law", [ca.vertcat(x.q, x.v, x.a, x.tau, x.t, *past.values()), p], [out])


@lru_cache(maxsize=64)
def _batch(structure: tuple[tuple[str, ...], ...], n: int, known: tuple[str, ...], count: int) -> Batch:
    """`_drive` evaluated at `count` samples at once."""
    return Batch(_drive(structure, n, known), count)


@lru_cache(maxsize=64)
def _rigid_map(structure: tuple[tuple[str, ...], ...], own: tuple[int, ...], last: int, count: int) -> Batch:
    """Function of a structure's rigid effects: change of inertial parameters, gravity, and the Jacobians of both.

    (gravity, nominal links (13, n), p) -> change (10 L,) for all links, gravity (3,), and both Jacobians by p. `own`:
    indices of the n links with a joint, of L = `count`. `last` carries the payload.
    """
    n = len(own)
    model = PowerModel("", tuple(of_form(form, n) for form in structure))
    p, given, nominal = model.symbols(n), ca.SX.sym("g", 3), ca.SX.sym("links", 13, n)
    links = [(nominal[0, j], nominal[1:4, j], ca.reshape(nominal[4:, j], 3, 3)) for j in range(n)]
    before = [_inertial(*link) for link in links]
    gravity, phi = given, ca.SX.zeros(10 * count)
    for effect, where in zip(model.effects, model.slices(n), strict=True):
        if isinstance(effect, RigidEffect):
            values = effect.named(p[where], n)
            gravity, point, changed = effect.gravity(gravity, values), effect.point_mass(values), None
            changed = effect.links(links, values)
            if point is not None:
                phi[10 * last : 10 * last + 10] += _inertial(*point, ca.SX.zeros(3, 3))
            if changed is not None:
                for k, was, link in zip(own, before, changed, strict=True):
                    phi[10 * k : 10 * k + 10] += _inertial(*link) - was
    slopes = [ca.densify(ca.vec(ca.jacobian(x, p).T)) for x in (phi, gravity)]
    arguments = [given, ca.vec(nominal), p]
    return Batch(ca.Function("rigid", arguments, [ca.densify(phi), ca.densify(gravity), *slopes]), 1)


def _inertial(mass: ca.SX, place: ca.SX, inertia: ca.SX) -> ca.SX:
    """A link as inertial parameters (10,) in Pinocchio's order: m, m c, and the inertia about the origin."""
    i = inertia + mass * (ca.dot(place, place) * ca.SX.eye(3) - place @ place.T)
    return ca.vertcat(mass, mass * place, i[0, 0], i[0, 1], i[1, 1], i[0, 2], i[1, 2], i[2, 2])


def rigid_torque(model: PowerModel, s: Samples) -> tuple[np.ndarray, np.ndarray]:
    """Rigid torque (K, n), and its derivatives (K, n, R) by the values of the model's rigid effects, in their order.

    The samples cache the last few, as most candidate models differ in other effects.
    """
    rigid = PowerModel("", tuple(e for e in model.effects if e.stage == "rigid"))
    key = tuple((e.form, e.full(s.n).tobytes()) for e in rigid.effects)
    if key not in s.rigid:
        if len(s.rigid) >= MOST_RIGID:
            del s.rigid[next(iter(s.rigid))]
        s.rigid[key] = _rigid_torque(rigid, s)
    return s.rigid[key]


def _rigid_torque(rigid: PowerModel, s: Samples) -> tuple[np.ndarray, np.ndarray]:
    """Rigid torque and its derivatives.

    Torque is linear in inertial parameters and in gravity: the regressors of the samples are multiplied with the
    changes by the effects.
    """
    body = s.body
    if not rigid.effects:
        return s.free_torque + s.gravity_torque @ body.gravity, np.zeros((*s.q.shape, 0))
    structure = tuple(e.form for e in rigid.effects)
    out = _rigid_map(structure, tuple(body.coupling.own.tolist()), body.last, len(body.tree()))(
        body.gravity, s.nominal_links, rigid.values(s.n)
    )
    phi, gravity = (x[0] for x in out[:2])
    by_phi, by_gravity = (x[0].reshape(count, -1) for x, count in zip(out[2:], (len(phi), 3), strict=True))
    tau, slope = s.free_torque + s.gravity_torque @ gravity, np.zeros((*s.q.shape, len(rigid.values(s.n))))
    by_g = s.gravity_torque
    live = np.flatnonzero(by_phi.any(axis=1) | (phi != 0))
    if live.size:
        if by_gravity.any():
            by_g = by_g.copy()
        tilt, turns = gravity - body.gravity, bool(by_gravity.any())
        for samples, at, own, by_unit in s.by_links(live, turns or bool(tilt.any())):
            regressor = own + by_unit @ tilt if tilt.any() else own
            tau[samples] += regressor @ phi[at]
            slope[samples] += times(regressor, by_phi[at])
            if turns:
                by_g[samples] += np.einsum("njpk,p->njk", by_unit, phi[at])
    slope += by_g @ by_gravity
    # a mass that is picked up or put down: the share of it that is held changes with time
    for effect, where in zip(rigid.effects, rigid.slices(s.n), strict=True):
        added = _changing(effect.form, s.n)
        if added is None:
            continue
        mass, share, by_mass = (x.copy() for x in added(s.dwell[:, None], effect.full(s.n)))
        if share.any():
            regressor = s.last_regressors[..., 0] + s.last_regressors[..., 1:] @ (gravity - body.gravity)
            tau += share * (regressor @ mass[0])
            slope[:, :, where] += share[:, :, None] * (regressor @ by_mass[0].reshape(10, -1))
    return tau, slope


@lru_cache(maxsize=64)
def _changing(form: tuple[str, ...], n: int) -> Callable[..., list[np.ndarray]] | None:
    """(dwell, p) -> inertial parameters, share, Jacobian by p at K nodes, for a mass that is picked up; else None."""
    effect = of_form(form, n)
    p, dwell, none = ca.SX.sym("p", effect.size(n, effect.extents)), ca.SX.sym("dwell"), ca.SX.zeros(n)
    assert isinstance(effect, RigidEffect)
    held = effect.changing_mass(Signals(none, none, none, none, ca.SX(0), dwell=dwell), effect.named(p, n))
    if held is None:
        return None
    mass, com, share = held
    phi = _inertial(mass, com, ca.SX.zeros(3, 3))
    columns = [ca.densify(phi), ca.densify(share), ca.densify(ca.vec(ca.jacobian(phi, p).T))]
    law = ca.Function("held", [dwell, p], columns)
    return lambda dwell, p: Batch(law, len(dwell))(dwell, p)


def predict(
    model: PowerModel, s: Samples, push: np.ndarray | None = None, torques: np.ndarray | None = None
) -> Prediction:
    """The reading of the meter under `model` at the samples, and its derivatives by `model.values(n)`.

    Args:
        push: (K, n) torque added to the rigid body's, N m.
        torques: (K, n, c) further torques, by whose amounts the reading's derivatives (M, c) are also asked for.
    """
    tau, by_rigid = rigid_torque(model, s)
    if push is not None:
        tau = tau + push
    known = {name: x for name, x in recorded(s).items() if name in ALWAYS or _followed(name, model)}
    state = [s.q, s.v, s.a, tau, s.t, *known.values()]
    structure = tuple(e.form for e in model.effects)
    values = model.values(s.n)

    def law() -> np.ndarray:
        table = np.column_stack(state)
        out = []
        for part in pieces(len(table), AT_ONCE):
            (own,) = _batch(structure, s.n, tuple(known), part.stop - part.start)(table[part], values)
            out.append(own.copy())
        return np.concatenate(out)

    where = model.places(s.n)
    out = law()
    store = store_of(model)
    if store is not None:  # what it returns follows from the bus power, which does not depend on it
        bus = out[:, 1].copy()
        state[4 + 1 + list(known).index("returned")] = _returned(model, s, bus)
        out = law()
    n = s.n
    if "heated" in known:
        warm, tau_m = state[5 + list(known).index("heated")], out[:, 2 : 2 + n].copy()
        memory = next(e for e in model.effects if isinstance(e, HeatMemoryEffect))
        at, step = where[memory.name].stop - 1, STORE_STEP * float(memory.full(n)[-1])
        moved = None
        if values[where[memory.name]][:-1].any():
            later = model.with_values(values + step * (np.arange(len(values)) == at), n)
            warm[:] = _heated(later, s, tau_m)
            moved = law()[:, 0].copy()
        warm[:] = _heated(model, s, tau_m)
        out = law()
        # the law takes `heated` as an input, so its derivative by the time constant is a finite difference
        if moved is not None:
            out[:, 2 + 2 * n + at] = (moved - out[:, 0]) / step
    power, tau_m = out[:, 0].copy(), out[:, 2 : 2 + n].copy()
    by_tau, jacobian = out[:, 2 + n : 2 + 2 * n].copy(), out[:, 2 + 2 * n :].copy()
    if store is not None:
        jacobian[:, where[store.name].start] = -_returned_slope(model, s, bus)
    rigid = [np.arange(where[e.name].start, where[e.name].stop) for e in model.effects if e.stage == "rigid"]
    if rigid:
        jacobian[:, np.concatenate(rigid)] += np.einsum("nj,njp->np", by_tau, by_rigid)
    external = np.zeros((len(power), 0)) if torques is None else np.einsum("nj,njc->nc", by_tau, torques)
    # the meter's effects are linear in the power: they act on its derivatives as on itself
    reading, slopes = power.copy(), np.column_stack([jacobian, external])
    for effect in sorted((e for e in model.effects if isinstance(e, MeterEffect)), key=lambda e: e.turn):
        value = float(effect.full(n)[0])
        before, reading = reading, np.empty_like(reading)
        for samples in s.slices:
            time = s.t[samples]
            power_and_slopes = np.column_stack([before[samples], slopes[samples]])
            both = effect.reading(time, power_and_slopes, value)
            reading[samples], slopes[samples] = both[:, 0], both[:, 1:]
            slopes[samples, where[effect.name].start] = effect.sensitivity(time, power_and_slopes, value)[:, 0]
    metered, reading, slopes = reading, s.shown(reading), s.shown(slopes)
    count = jacobian.shape[1]
    return Prediction(metered, reading, slopes[:, :count], slopes[:, count:], power, tau, tau_m, by_tau)


ALWAYS = ("temperature", "warmth", "idle", "returned", "run")


def recorded(s: Samples) -> dict[str, np.ndarray]:
    """The signals of the past and the recording at the nodes, (K,) or (K, n) by the names of `Signals`.

    Further logged ones are named signal.<name>, and `logged` says that there are any. `returned` and `heated` follow
    from a model, and are zeros here.
    """
    out: dict[str, np.ndarray] = {}
    if np.isfinite(s.temperature).all():
        out["temperature"] = s.temperature
        if np.isfinite(s.warmth).all():
            out["warmth"] = s.warmth
    out |= {"idle": s.idle, "returned": np.zeros(len(s.q)), "run": s.run.astype(float), "heated": np.zeros_like(s.q)}
    if s.dwell.any():
        out["dwell"] = s.dwell
    if np.ptp(s.t) > HOURS:
        out["day"] = s.t
    logged = {f"signal.{name}": x for name, x in s.logged.items()}
    return {**out, **logged, **({"logged": np.zeros(0)} if logged else {})}


def _followed(name: str, model: PowerModel) -> bool:
    """True if an effect of the model depends on the signal."""
    kind = "logged" if name.startswith("signal.") else name
    return name != "logged" and any(kind in effect.follows for effect in model.effects)


def _named(past: dict[str, ca.SX]) -> dict[str, Any]:
    """Symbols as arguments of `Signals`: further logged signals go into one mapping."""
    logged = {name.removeprefix("signal."): x for name, x in past.items() if name.startswith("signal.")}
    own = {name: x for name, x in past.items() if not name.startswith("signal.")}
    return {**own, **({"logged": logged} if logged else {})}


def _heated(model: PowerModel, s: Samples, tau_m: np.ndarray) -> np.ndarray:
    """`Signals.heated` (K, n) [W] of motors at `tau_m` (K, n); in the set's other runs they give the rigid torque."""
    time, torque = (np.concatenate(x) for x in zip((s.t, tau_m), *([s.elsewhere] if s.elsewhere else []), strict=True))
    order, out = np.argsort(time, kind="stable"), np.empty_like(torque)
    out[order] = heated(model, time[order], torque[order])
    return out[: len(s.t)]


def _returned(model: PowerModel, s: Samples, bus: np.ndarray) -> np.ndarray:
    """Power (K,) [W] that the model's store returns, run by run."""
    steps = [np.gradient(s.t[samples]) for samples in s.slices]
    return np.concatenate(
        [returned_power(model, h, bus[samples])[0] for h, samples in zip(steps, s.slices, strict=True)]
    )


def _returned_slope(model: PowerModel, s: Samples, bus: np.ndarray) -> np.ndarray:
    """Derivative of the store's returned power by its capacity."""
    store = store_of(model)
    assert store is not None
    value = float(store.full(1)[0])
    step = STORE_STEP * max(value, 1e-3)
    high = model.replaced(type(store).from_full(np.array([value + step]), 1))
    return (_returned(high, s, bus) - _returned(model, s, bus)) / step


def friction_torque(model: PowerModel, n: int) -> Callable[[np.ndarray, int], np.ndarray]:
    """Torque of the model's frictions, unloaded and cold.

    Returns:
        A function of speeds (N,) [rad/s, m/s] and of a joint's index, which gives the torque (N,) [N m, N] there.
    """
    v = ca.SX.sym("v", n)
    zero = ca.SX.zeros(n)
    x = Signals(zero, v, zero, zero, ca.SX(0))
    total = ca.SX.zeros(n)
    for effect in model.effects:
        if isinstance(effect, TorqueEffect) and effect.dissipates:
            total += effect.torque(x, effect.named(ca.SX(ca.DM(effect.full(n))), n), EXACT)
    function = ca.Function("friction", [v], [ca.densify(total)])

    def at(speed: np.ndarray, joint: int) -> np.ndarray:
        return np.array(function(np.tile(speed, (n, 1)))).reshape(n, -1)[joint]

    return at
