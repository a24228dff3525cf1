"""What a hypothesis adds to the declared model: effects with free parameters, shared over the joints or one per joint.

A term maps its free numbers z to the effect's parameters p (laid out as `Effect.full`) and back:

    number   z = p                                       effects without per-joint parameters
    shared   one number stands for all joints            z = (value, ...)
    joint    one number per joint
    scale    z times the declared values                 a declared list that is off by a common factor

Payload is fitted as (m, m c) and a spring as (k, k * rest): in these both are (nearly) linear.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from energy_opt.effects import BY_NAME, Effect
from energy_opt.power import PowerModel

# Bounds that a fit keeps to, tighter than what a model file may hold.
TIGHTER: dict[tuple[str, str], tuple[float, float]] = {
    ("payload", "mass"): (1e-4, 200.0),
    ("base_tilt", "roll"): (-1.5, 1.5),
    ("base_tilt", "pitch"): (-1.5, 1.5),
    ("meter_delay", "delay"): (-0.5, 1.0),
    ("meter_filter", "time_constant"): (0.0, 2.0),
    ("stribeck_friction", "v_s"): (5e-3, 1.5),
    ("winding_temperature", "time_constant"): (10.0, 2e3),
    ("standby_drift", "time_constant"): (10.0, 2e3),
    ("winding_temperature", "rate"): (-0.5, 3.0),
    ("gear_efficiency", "eta"): (0.2, 1.0),
    ("supply_efficiency", "eta"): (0.2, 1.0),
}
RESOLVED_LAG = 0.01  # [s] a smaller delay or lag of the meter is not told from smoothing
SPRING, PAYLOAD = "gravity_spring", "payload"
SMALL = 1e-9  # [N m/rad] a spring's stiffness is kept this far from 0 while its rest position is sought


@dataclass(frozen=True)
class Term:
    """An effect with free parameters; `options` as `key=value` words, `joints` those whose numbers are free.

    `declared` is True where the declared model has the effect and its values are fitted anew.
    """

    name: str
    mode: str
    options: tuple[str, ...] = ()
    joints: tuple[int, ...] | None = None
    declared: bool = False

    @property
    def kind(self) -> type[Effect]:
        return BY_NAME[self.name]

    def effect(self, values: np.ndarray, n: int) -> Effect:
        """The effect with parameters p = values, kept inside its bounds."""
        lower, upper = bounds(self.kind, n)
        choices = dict(option.split("=") for option in self.options)
        if self.name == SPRING and self.joints is not None:
            there = np.isin(np.arange(n), self.joints)
            values = np.where(np.tile(there, 2), values, 0.0)
        return self.kind.from_full(np.clip(values, lower, upper), n, **choices)

    def with_joints(self, joints: tuple[int, ...]) -> Term:
        """The same term with only some joints free; the others keep their declared or neutral values."""
        return replace(self, joints=joints)


def bounds(kind: type[Effect], n: int) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bounds of `Effect.full`."""
    low, high = [], []
    for p in kind.parameters:
        a, b = TIGHTER.get((kind.name, p.name), (p.lower, p.upper))
        low += [a] * p.count(n)
        high += [b] * p.count(n)
    return np.array(low), np.array(high)


def _per_joint(kind: type[Effect], n: int) -> np.ndarray:
    """For each entry of `full`: its joint, or -1 where it belongs to none."""
    out: list[int] = []
    for p in kind.parameters:
        out += list(range(n)) if p.size == "joint" else [-1] * p.count(n)
    return np.array(out)


@dataclass(frozen=True)
class Chart:
    """The free numbers z of a term at declared or neutral values p0: p = p0 + T (z - z0), then to physical values."""

    term: Term
    n: int
    base: np.ndarray  # chart values where z = 0
    matrix: np.ndarray  # (P, Z)
    lower: np.ndarray
    upper: np.ndarray

    def inner(self, z: np.ndarray) -> np.ndarray:
        """Chart coordinates (P,)."""
        return self.base + self.matrix @ z

    def values(self, z: np.ndarray) -> np.ndarray:
        """Parameters p (P,) as `Effect.full`."""
        return physical(self.term.name, self.inner(z), self.n)

    def slope(self, z: np.ndarray) -> np.ndarray:
        """dp / dz (P, Z)."""
        return physical_slope(self.term.name, self.inner(z), self.n) @ self.matrix


def physical(name: str, x: np.ndarray, n: int) -> np.ndarray:
    """Parameters from chart coordinates."""
    out = x.copy()
    if name == PAYLOAD:
        out[1:] = x[1:] / x[0]
    if name == SPRING:
        k = _away(x[:n])
        out[:n], out[n:] = k, x[n:] / k
    return out


def to_chart(name: str, p: np.ndarray, n: int) -> np.ndarray:
    """Chart coordinates from parameters."""
    out = np.array(p, dtype=float)
    if name == PAYLOAD:
        out[1:] *= out[0]
    if name == SPRING:
        out[n:] *= out[:n]
    return out


def physical_slope(name: str, x: np.ndarray, n: int) -> np.ndarray:
    """Derivative of `physical` (P, P)."""
    out = np.eye(len(x))
    if name == PAYLOAD:
        out[1:, 1:] = np.eye(3) / x[0]
        out[1:, 0] = -x[1:] / x[0] ** 2
    if name == SPRING:
        k = _away(x[:n])
        out[n:, n:] = np.diag(1 / k)
        out[n:, :n] = np.diag(-x[n:] / k**2)
    return out


def _away(k: np.ndarray) -> np.ndarray:
    return np.where(np.abs(k) < SMALL, SMALL, k)


def chart(term: Term, declared: PowerModel, n: int) -> Chart:
    """The chart of a term over a declared model."""
    kind = term.kind
    held = declared.get(term.name)
    start = held.full(n) if held is not None and term.declared else kind.neutral(n).full(n)
    x0 = to_chart(term.name, start, n)
    lower, upper = bounds(kind, n)
    if term.name == PAYLOAD:
        lower[1:], upper[1:] = -100.0, 100.0
    if term.name == SPRING:
        lower, upper = np.full(2 * n, -1e4), np.full(2 * n, 1e4)
    joint = _per_joint(kind, n)
    free = set(range(n)) if term.joints is None else set(term.joints)
    columns: list[np.ndarray] = []
    base = x0.copy()
    low, high = [], []
    if term.mode == "scale":
        column = np.where([j in free for j in joint], x0, 0.0)
        base = x0 - column
        columns.append(column)
        low.append(0.0)
        high.append(20.0)
    elif term.mode == "shared":
        for p_rows in _blocks(kind, n):
            column = np.zeros(len(x0))
            column[[r for r in p_rows if joint[r] < 0 or joint[r] in free]] = 1.0
            base = base - column * x0
            columns.append(column)
            low.append(float(lower[p_rows[0]]))
            high.append(float(upper[p_rows[0]]))
    else:
        for row in range(len(x0)):
            if joint[row] < 0 or joint[row] in free:
                column = np.zeros(len(x0))
                column[row] = 1.0
                base[row] = 0.0
                columns.append(column)
                low.append(float(lower[row]))
                high.append(float(upper[row]))
    return Chart(term, n, base, np.column_stack(columns), np.array(low), np.array(high))


def _blocks(kind: type[Effect], n: int) -> list[list[int]]:
    """Rows of `full` that one shared number stands for."""
    out, at = [], 0
    for p in kind.parameters:
        rows = list(range(at, at + p.count(n)))
        out += [rows] if p.size == "joint" else [[r] for r in rows]
        at += p.count(n)
    return out


def negligible(term: Term, values: np.ndarray) -> bool:
    """True where the values are below what readings can resolve, so that the effect must not be claimed."""
    if term.name in ("meter_delay", "meter_filter"):
        return bool(np.abs(values).max() < RESOLVED_LAG)
    return False
