"""What a hypothesis adds to the declared model: effects with free parameters, shared over the joints or one per joint.

A term maps its free numbers z to the effect's parameters p (laid out as `Effect.full`) and back:

    number   z = p                                       effects without per-joint parameters
    shared   one number stands for all joints            z = (value, ...)
    joint    one number per joint
    scale    z times the declared values                 a declared list that is off by a common factor

Numbers are fitted in the effect's chart, in which it is (nearly) linear: a payload as (m, m c).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from energy_opt.effects import Effect, effect_class, words_of
from energy_opt.power import PowerModel


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
        return effect_class(self.name)

    def effect(self, values: np.ndarray, n: int) -> Effect:
        """The effect with parameters p = values, kept inside its bounds."""
        lower, upper = bounds(self.kind, n)
        if not self.kind.same_on_all_joints and self.joints is not None:
            joint = _per_joint(self.kind, n)
            values = np.where(np.isin(joint, (-1, *self.joints)), values, 0.0)
        return self.kind.from_full(np.clip(values, lower, upper), n, **words_of(self.options))

    def with_joints(self, joints: tuple[int, ...]) -> Term:
        """The same term with only some joints free; the others keep their declared or neutral values."""
        return replace(self, joints=joints)


def bounds(kind: type[Effect], n: int) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bounds of `Effect.full`."""
    rows = [p.bounds for p in kind.parameters for _ in range(p.count(n))]
    return np.array([low for low, _ in rows]), np.array([high for _, high in rows])


def _per_joint(kind: type[Effect], n: int) -> np.ndarray:
    """For each entry of `full`: its joint, or -1 where it belongs to none."""
    out: list[int] = []
    for p in kind.parameters:
        out += list(range(n)) if p.per_joint else [-1] * p.count(n)
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
        return self.term.kind.from_chart(self.inner(z), self.n)

    def slope(self, z: np.ndarray) -> np.ndarray:
        """dp / dz (P, Z)."""
        return self.term.kind.chart_slope(self.inner(z), self.n) @ self.matrix


def chart(term: Term, declared: PowerModel, n: int) -> Chart:
    """The chart of a term over a declared model."""
    kind = term.kind
    held = declared.get(term.name)
    start = held.full(n) if held is not None and term.declared else kind.neutral(n).full(n)
    x0 = kind.to_chart(start, n)
    lower, upper = kind.chart_bounds(n)
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
        out += [rows] if p.per_joint else [[r] for r in rows]
        at += p.count(n)
    return out


def negligible(term: Term, values: np.ndarray) -> bool:
    """True where the values are below what readings can resolve, so that the effect must not be claimed."""
    least = [p.resolved for p in term.kind.parameters for _ in range(p.count(len(values)))]
    return bool(np.any(least) and np.all(np.abs(values) < least))
