"""What a model says the meter shows at the samples, with exact derivatives by every parameter of every effect."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from types import SimpleNamespace

import casadi as ca
import numpy as np

from energy_opt.diagnose.samples import Samples
from energy_opt.effects import BaseTilt, Payload, Signals
from energy_opt.effects.meter import METER_EFFECTS
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
def _drive(structure: tuple[tuple[str, ...], ...], n: int) -> ca.Function:
    """The law of a structure: ((q, v, a, tau, t), p) -> (power, dP/dtau, dP/dp) as one dense column."""
    from energy_opt.effects import BY_NAME

    effects = []
    for name, *options in structure:
        effect = BY_NAME[name].neutral(n)
        effect.choices.update(dict(option.split("=") for option in options))
        effects.append(effect)
    model = PowerModel("", tuple(effects))
    q, v, a, tau = (ca.SX.sym(name, n) for name in ("q", "v", "a", "tau"))
    x = Signals(q, v, a, tau, ca.SX.sym("t"))
    p = model.symbols(n)
    power = drive_terms(model, x, p).power
    by_p, by_tau = ca.gradient(power, p), ca.gradient(power, x.tau)
    out = ca.densify(ca.vertcat(power, by_tau, by_p))
    return ca.Function("law", [ca.vertcat(x.q, x.v, x.a, x.tau, x.t), p], [out])


@lru_cache(maxsize=2)
def _rigid_maps() -> tuple[ca.Function, ca.Function]:
    """(mass, com) -> the ten inertial parameters, (gravity, roll, pitch) -> gravity; each with its Jacobian."""
    p = ca.SX.sym("p", 4)
    m, h, s = Payload.inertia(SimpleNamespace(mass=p[0], com=p[1:]))
    inertia = ca.trace(s) * ca.SX.eye(3) - s
    phi = ca.vertcat(
        m, h, inertia[0, 0], inertia[0, 1], inertia[1, 1], inertia[0, 2], inertia[1, 2], inertia[2, 2]
    )  # in Pinocchio's order
    g, angles = ca.SX.sym("g", 3), ca.SX.sym("r", 2)
    turned = BaseTilt.gravity(g, SimpleNamespace(roll=angles[0], pitch=angles[1]))
    return (
        ca.Function("payload", [p], [phi, ca.densify(ca.jacobian(phi, p))]),
        ca.Function("tilt", [g, angles], [turned, ca.densify(ca.jacobian(turned, angles))]),
    )


def rigid_torque(model: PowerModel, s: Samples) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
    """Rigid torque (N, n), its derivatives by payload (N, n, 4) and base tilt (N, n, 2) where the model has them."""
    payload_map, tilt_map = _rigid_maps()
    payload, tilt = model.get(Payload.name), model.get(BaseTilt.name)
    gravity, by_angle = s.body.gravity, None
    if tilt is not None:
        turned, by_angle = (np.array(x) for x in tilt_map(gravity, tilt.full(s.n)))
        gravity = turned.ravel()
    tau = s.free_torque + s.gravity_torque @ gravity
    by_payload = by_tilt = None
    slope = s.gravity_torque
    if payload is not None:
        phi, by_value = (np.array(x) for x in payload_map(payload.full(s.n)))
        regressor = s.free_regressor + s.gravity_regressor @ gravity
        tau = tau + regressor @ phi.ravel()
        by_payload = regressor @ by_value
        if tilt is not None:
            slope = slope + np.einsum("njpk,p->njk", s.gravity_regressor, phi.ravel())
    if by_angle is not None:
        by_tilt = slope @ by_angle
    return tau, by_payload, by_tilt


def predict(model: PowerModel, s: Samples) -> Prediction:
    """The reading of the meter under `model` at the samples, and its derivatives by `model.values(n)`."""
    tau, by_payload, by_tilt = rigid_torque(model, s)
    state = np.column_stack([s.q, s.v, s.a, tau, s.t])
    (out,) = Batch(_drive(model.structure, s.n), len(state))(state, model.values(s.n))
    power, by_tau, jacobian = out[:, 0].copy(), out[:, 1 : 1 + s.n].copy(), out[:, 1 + s.n :].copy()
    where = dict(zip((e.name for e in model.effects), model.slices(s.n), strict=True))
    if by_payload is not None:
        jacobian[:, where[Payload.name]] = np.einsum("nj,njp->np", by_tau, by_payload)
    if by_tilt is not None:
        jacobian[:, where[BaseTilt.name]] = np.einsum("nj,njp->np", by_tau, by_tilt)
    reading = power.copy()
    for effect in METER_EFFECTS:
        held = model.get(effect.name)
        if held is None:
            continue
        value = float(held.full(s.n)[0])
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
