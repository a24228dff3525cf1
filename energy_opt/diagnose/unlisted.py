"""Structures that no effect of the table has, as linear columns: they compete with the effects for the residual.

Each is a torque or a power with a free amplitude and one setting that is scanned:

    position   torque A sin(k q) + B cos(k q) of a joint            repeats with joint position
    velocity   torque A sin(2 pi v / P) + B cos(...) sign(v)        waves with joint speed
    reversal   torque A exp(-s / g) sign(v), s the way since the joint turned back
    time       power a step at a set time, or a wave of some period in time

A torque shows in the power through dP/dtau_m = v + 2 r tau_m.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from energy_opt.diagnose.evidence import blocks
from energy_opt.diagnose.fit import Extra, Fit
from energy_opt.diagnose.samples import Samples
from energy_opt.diagnose.screen import basis
from energy_opt.diagnose.terms import Term

HARMONICS = tuple(float(k) for k in range(3, 61))
SPEED_PERIODS = (0.1, 0.14, 0.2, 0.25, 0.3, 0.35, 0.42, 0.5, 0.6, 0.75)  # [rad/s]
GAPS = (0.01, 0.02, 0.04, 0.07, 0.12)  # [rad]
LONGEST, SHORTEST = 60.0, 0.8  # [s] periods tried
MOST_RATES = 4000
WAVES = (1, 2, 3, 4, 5)  # harmonics of a cycle in time
STEPS = 60  # instants tried for a step


def torque_weight(current: Fit, samples: Samples) -> np.ndarray:
    """dP / d(motor torque) (N, n): v + 2 r tau_m, here with the rigid torque in place of the motor's."""
    from energy_opt.diagnose.predict import rigid_torque

    copper = current.model.get("copper_loss")
    r = copper.full(samples.n) if copper is not None else np.zeros(samples.n)
    return samples.v + 2 * r * rigid_torque(current.model, samples)[0]


def travel(samples: Samples) -> np.ndarray:
    """Way since each joint last turned back within its run (N, n) rad; large before the first turn."""
    out = np.full_like(samples.v, 1e3)
    for rows in samples.slices:
        dt = np.gradient(samples.t[rows])
        for j in range(samples.n):
            v = samples.v[rows, j]
            heading, way = 0.0, 1e3
            for k, speed in enumerate(v):
                if speed != 0 and heading != 0 and np.sign(speed) != heading:
                    way = 0.0
                if speed != 0:
                    heading = float(np.sign(speed))
                way += abs(speed) * dt[k]
                out[rows.start + k, j] = way
    return out


def structures(current: Fit, samples: Samples) -> Iterator[tuple[float, Extra]]:
    """The best setting of every family with what it takes from the residual (W^2), for all joints together (joint = -1)
    and for single joints.
    """
    q = basis(current.jacobian) if current.jacobian.shape[1] else np.zeros((len(samples.power), 0))
    residual = current.residual - q @ (q.T @ current.residual)
    w = torque_weight(current, samples) * samples.weight[:, None]
    taken = {(e.family, e.joint) for e in current.extras}
    v, n = samples.v, samples.n
    way = np.minimum(travel(samples), 20.0)
    turning = [j for j in range(n) if (way[:, j] < 1.0).any()]

    def position(k: float) -> list[np.ndarray]:
        x = k * samples.q
        return [np.column_stack([w[:, j] * np.sin(x[:, j]), w[:, j] * np.cos(x[:, j])]) for j in range(n)]

    def velocity(period: float) -> list[np.ndarray]:
        x = 2 * np.pi * v / period
        even = np.sign(v) * (1 - np.cos(x))
        return [np.column_stack([w[:, j] * np.sin(x[:, j]), w[:, j] * even[:, j]]) for j in range(n)]

    def reversal(gap: float) -> list[np.ndarray]:
        return [(w[:, j] * np.exp(-way[:, j] / gap) * np.sign(v[:, j]))[:, None] for j in turning]

    families: list[tuple[str, Sequence[float], Callable[[float], list[np.ndarray]]]] = [
        ("position", HARMONICS, position),
        ("velocity", SPEED_PERIODS, velocity),
    ]
    if turning:
        families.append(("reversal", GAPS, reversal))
    for family, settings, build in families:
        joints = turning if family == "reversal" else list(range(n))
        if (family, -1) in taken:
            continue
        scored = []
        for setting in settings:
            own = build(float(setting))
            scored.append((_gain(np.column_stack(own), residual, q), float(setting), -1, np.column_stack(own)))
            if n > 1:
                scored += [(_gain(b, residual, q), float(setting), j, b) for j, b in zip(joints, own, strict=True)]
        for joint in (-1, *joints):
            rows = [row for row in scored if row[2] == joint and (family, joint) not in taken]
            if rows:
                gained, setting, _, columns = max(rows, key=lambda row: row[0])
                yield gained, Extra(family, joint, setting, columns)
    yield from _in_time(samples, residual, q, taken)


def _in_time(
    samples: Samples, residual: np.ndarray, q: np.ndarray, taken: set[tuple[str, int]]
) -> Iterator[tuple[float, Extra]]:
    t = samples.t
    if ("step", -1) not in taken:
        instants = np.quantile(t, np.linspace(0, 1, STEPS + 2)[1:-1])
        edges = [(t[a.stop - 1] + t[b.start]) / 2 for a, b in zip(samples.slices[:-1], samples.slices[1:], strict=True)]
        steps = [((t >= at) * samples.weight)[:, None] for at in [*instants, *edges]]
        gains = [_gain(c, residual, q) for c in steps]
        best = int(np.argmax(gains))
        yield gains[best], Extra("step", -1, float([*instants, *edges][best]), steps[best])
    if ("wave", -1) not in taken:
        best_wave: tuple[float, float, np.ndarray] = (-1.0, 0.0, np.zeros((0, 0)))
        for period in _likely_periods(samples, residual):
            phase = 2 * np.pi * t / period
            columns = np.column_stack([f(k * phase) * samples.weight for k in WAVES for f in (np.sin, np.cos)])
            gained = _gain(columns, residual, q)
            if gained > best_wave[0]:
                best_wave = (gained, float(period), columns)
        yield best_wave[0], Extra("wave", -1, best_wave[1], best_wave[2])


def _likely_periods(samples: Samples, residual: np.ndarray, most: int = 12) -> np.ndarray:
    """Periods [s] at which the residual has most of a sine, on a grid fine enough to keep phase over the whole set."""
    parts = blocks(samples, 0.2)
    t = np.array([samples.t[b].mean() for b in parts])
    r = np.array([residual[b].sum() for b in parts])
    span = max(float(np.ptp(samples.t)), 1.0)
    rates = np.arange(1 / LONGEST, 1 / SHORTEST, 0.2 / span)[:MOST_RATES]
    power = np.abs(np.exp(-2j * np.pi * np.outer(rates, t)) @ r)
    return 1 / rates[np.argsort(-power)[:most]]


def _gain(columns: np.ndarray, residual: np.ndarray, q: np.ndarray) -> float:
    """Sum of squares that the columns take from the residual (in W^2)."""
    gram = columns.T @ columns
    cross = columns.T @ residual
    inner = q.T @ columns
    gram = gram - inner.T @ inner
    gram[np.diag_indices_from(gram)] += 1e-9 * max(float(np.trace(gram)), 1e-12)
    return float(cross @ np.linalg.solve(gram, cross))


def exclusive(extra: Extra, terms: tuple[Term, ...]) -> bool:
    """False where the structure is only a rough form of an effect that the hypothesis has."""
    return not (extra.family == "step" and any(t.name == "standby_drift" for t in terms))
