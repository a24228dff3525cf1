"""What a model says the meter shows at the samples, with exact derivatives by every parameter of every effect."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from energy_opt.diagnose.samples import Samples
from energy_opt.effects import MeterEffect, RigidEffect, Signals, of_form
from energy_opt.numerics.batch import Batch
from energy_opt.power import PowerModel, drive_terms


@dataclass(frozen=True)
class Prediction:
    """The meter's reading (N,) [W], its derivatives (N, P) by `PowerModel.values`, and torques (N, n) [N m].

    `power` is the true power (N,) before the meter; `tau` the rigid body's torque.
    """

    reading: np.ndarray
    jacobian: np.ndarray
    power: np.ndarray
    tau: np.ndarray


@lru_cache(maxsize=256)
def _drive(structure: tuple[tuple[str, ...], ...], n: int, warmth: bool) -> ca.Function:
    """The law of a structure: ((q, v, a, tau, t), p) -> (power, dP/dtau, dP/dp) as one dense column.

    With `warmth` the joints' measured temperatures follow the time.
    """
    model = PowerModel("", tuple(of_form(form, n) for form in structure))
    q, v, a, tau, temperature = (ca.SX.sym(name, n) for name in ("q", "v", "a", "tau", "temperature"))
    x = Signals(q, v, a, tau, ca.SX.sym("t"), temperature if warmth else None)
    p = model.symbols(n)
    power = drive_terms(model, x, p).power
    by_p, by_tau = ca.gradient(power, p), ca.gradient(power, x.tau)
    out = ca.densify(ca.vertcat(power, by_tau, by_p))
    state = ca.vertcat(x.q, x.v, x.a, x.tau, x.t, *([temperature] if warmth else []))
    return ca.Function("law", [state, p], [out])


@lru_cache(maxsize=64)
def _rigid_map(structure: tuple[tuple[str, ...], ...], n: int) -> ca.Function:
    """(gravity, p) of the rigid effects of a structure -> inertial parameters (10,) added to the last link, gravity
    (3,), and both one's Jacobians by p."""
    model = PowerModel("", tuple(of_form(form, n) for form in structure))
    p, given = model.symbols(n), ca.SX.sym("g", 3)
    gravity, phi = given, ca.SX.zeros(10)
    for effect, where in zip(model.effects, model.slices(n), strict=True):
        if isinstance(effect, RigidEffect):
            values = effect.named(p[where], n)
            gravity, point = effect.gravity(gravity, values), effect.point_mass(values)
            phi = phi if point is None else phi + _inertial(*point)
    slopes = [ca.densify(ca.jacobian(x, p)) for x in (phi, gravity)]
    return ca.Function("rigid", [given, p], [ca.densify(phi), ca.densify(gravity), *slopes])


def _inertial(mass: ca.SX, place: ca.SX) -> ca.SX:
    """A point mass as inertial parameters (10,) in Pinocchio's order: m, m c, and the inertia about the origin."""
    second = mass * place @ place.T
    i = ca.trace(second) * ca.SX.eye(3) - second
    return ca.vertcat(mass, mass * place, i[0, 0], i[0, 1], i[1, 1], i[0, 2], i[1, 2], i[2, 2])


def rigid_torque(model: PowerModel, s: Samples) -> tuple[np.ndarray, np.ndarray]:
    """Rigid torque (N, n), and its derivatives (N, n, R) by the values of the model's rigid effects, in their order."""
    rigid = PowerModel("", tuple(e for e in model.effects if e.stage == "rigid"))
    if not rigid.effects:
        return s.free_torque + s.gravity_torque @ s.body.gravity, np.zeros((*s.q.shape, 0))
    out = _rigid_map(rigid.structure, s.n)(s.body.gravity, rigid.values(s.n))
    phi, gravity, by_phi, by_gravity = (np.array(x) for x in out)
    tau, slope = s.free_torque + s.gravity_torque @ gravity.ravel(), np.zeros((*s.q.shape, len(rigid.values(s.n))))
    by_g = s.gravity_torque
    if by_phi.any() or phi.any():
        regressor = s.free_regressor + s.gravity_regressor @ gravity.ravel()
        tau = tau + regressor @ phi.ravel()
        slope += regressor @ by_phi
        by_g = by_g + np.einsum("njpk,p->njk", s.gravity_regressor, phi.ravel())
    return tau, slope + by_g @ by_gravity


def predict(model: PowerModel, s: Samples) -> Prediction:
    """The reading of the meter under `model` at the samples, and its derivatives by `model.values(n)`."""
    tau, by_rigid = rigid_torque(model, s)
    warmth = bool(np.isfinite(s.temperature).all())
    state = np.column_stack([s.q, s.v, s.a, tau, s.t, *([s.temperature] if warmth else [])])
    (out,) = Batch(_drive(model.structure, s.n, warmth), len(state))(state, model.values(s.n))
    power, by_tau, jacobian = out[:, 0].copy(), out[:, 1 : 1 + s.n].copy(), out[:, 1 + s.n :].copy()
    where = dict(zip((e.name for e in model.effects), model.slices(s.n), strict=True))
    rigid = [
        np.arange(x.start, x.stop) for e, x in zip(model.effects, where.values(), strict=True) if e.stage == "rigid"
    ]
    if rigid:
        jacobian[:, np.concatenate(rigid)] += np.einsum("nj,njp->np", by_tau, by_rigid)
    reading = power.copy()
    for effect in sorted((e for e in model.effects if isinstance(e, MeterEffect)), key=lambda e: e.turn):
        value = float(effect.full(s.n)[0])
        before, reading = reading, np.empty_like(reading)
        for rows in s.slices:
            time = s.t[rows]
            power_and_slopes = np.column_stack([before[rows], jacobian[rows]])
            both = effect.reading(time, power_and_slopes, value)
            reading[rows], jacobian[rows] = both[:, 0], both[:, 1:]
            jacobian[rows, where[effect.name].start] = effect.sensitivity(time, power_and_slopes, value)[:, 0]
    for rows, count in zip(s.slices, s.counts, strict=True):
        reading[rows], jacobian[rows] = _bin_mean(reading[rows], count), _bin_mean(jacobian[rows], count)
    return Prediction(reading, jacobian, power, tau)


def _bin_mean(x: np.ndarray, count: int) -> np.ndarray:
    """The mean of `count` even readings in a bin of width h from the values at the bins' middles.

    x + x'' (h^2 - (h / count)^2) / 24, with second differences in place of x'' h^2.
    """
    if count == 1:
        return x
    out = x.copy()
    out[1:-1] += (x[2:] - 2 * x[1:-1] + x[:-2]) * (1 - 1 / count**2) / 24
    return out
