"""Effects with free numbers: how their values follow from these numbers, and the prior of the numbers.

The numbers z are those of the effect's chart, in which the effect is (nearly) linear; a payload, for example, is
(m, m c). Grids and parameters in which a law is discontinuous are chosen, not fitted. The prior is normal. A number of
joint j is z_j = s_j (g + e_j), with a share g ~ N(0, 1) that all joints have in common and an own one e_j ~
N(0, OWN^2). So joints that hardly move are assumed to be like the others. s_j is a usual size, by the parameter's unit
and the joint's limits.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from energy_opt.effects import Effect, Parameter, effect_class, words_of
from energy_opt.power import PowerModel
from energy_opt.robot import Limits

OWN = 0.6  # standard deviation of a joint's own share, over that of the share common to all joints
MOST = 1 / 3  # largest friction as a share of a joint's effort limit
USUAL = 0.02  # usual dry friction as a share of a joint's effort limit
CRUISE = 0.3  # share of a joint's velocity limit at which viscous friction usually equals dry friction
HOLD, HEAT = 0.3, 2.0  # a winding usually dissipates HEAT [W] at the share HOLD of the effort limit
ROTOR = 3e-3  # [kg m^2 / (N m)] usual reflected rotor inertia over the effort limit
REFIT = (0.4, 0.2)  # relative standard deviations of declared numbers: common to all joints, and each joint's own
POWER = 0.06  # usual power of a number of the whole arm, as a share of the arm's level
REACH = 0.1  # [m] usual distance of a payload's centre of mass from the last joint's frame
SHAPE = 0.7  # standard deviation of a shape parameter over the value tried


@dataclass(frozen=True)
class Measured:
    """An effect's numbers from the joints' own readings: indices of joints (m,), values (m,), covariance (m, m)."""

    joints: np.ndarray
    values: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True)
class Scale:
    """Usual sizes on an arm.

    Attributes:
        effort, velocity: (n,) limits [N m, N] and [rad/s, m/s]. level: [W] of its power.
        measured: by effect with one number per joint, its values from other readings than the power.
    """

    effort: np.ndarray
    velocity: np.ndarray
    level: float
    measured: Mapping[str, Measured] = field(default_factory=dict)

    @property
    def usual_speed(self) -> np.ndarray:
        """(n,) rad/s at which viscous friction is usually as large as dry friction."""
        return CRUISE * self.velocity

    @classmethod
    def of(cls, limits: Limits, power: np.ndarray) -> Scale:
        """From an arm's limits and its measured power (M,) [W], whose median magnitude is the level (at least 5 W)."""
        return cls(limits.effort, limits.velocity, max(float(np.median(np.abs(power))), 5.0))


@dataclass(frozen=True)
class Term:
    """An effect with free numbers.

    Attributes:
        options: `key=word` of its options and lengths.
        trial: values of `full` where its shapes start and its grid stays (a tuple, so that terms can be compared).
        declared: True to refit an effect of the declared model.
        instead: names of the declared effects that this one replaces. If it contains them, it starts at all values of
            `trial`.
    """

    name: str
    options: tuple[str, ...] = ()
    trial: tuple[float, ...] = ()
    declared: bool = False
    instead: tuple[str, ...] = ()

    @property
    def kind(self) -> type[Effect]:
        """The class of the effect."""
        return effect_class(self.name)


@dataclass(frozen=True)
class Chart:
    """The numbers z of a term and their prior.

    Attributes:
        base: (P,) chart values of the effect at z = origin. kept: (Z,) indices of the free ones.
        origin: (Z,) numbers at which an absent effect changes (almost) nothing; for a declared one its values.
        mean, precision: (Z,), (Z, Z) of the normal prior. lower, upper: (Z,) bounds.
        unknown: (Z,) True for numbers whose usual size follows from their effect on the power, see `sized`.
    """

    term: Term
    n: int
    base: np.ndarray
    kept: np.ndarray
    origin: np.ndarray
    mean: np.ndarray
    precision: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    unknown: np.ndarray

    def values(self, z: np.ndarray) -> np.ndarray:
        """Parameters (P,) as `Effect.full`."""
        return self.term.kind.from_chart(self._inner(z), self.n)

    def slope(self, z: np.ndarray) -> np.ndarray:
        """d parameters / d z (P, Z)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.term.kind.chart_slope(self._inner(z), self.n)[:, self.kept])

    def effect(self, z: np.ndarray) -> Effect:
        """The effect with these numbers, kept inside its physical bounds."""
        kind, words = self.term.kind, words_of(self.term.options)
        values = self.values(z)
        lower, upper = _bounds(kind, self.n, len(values))
        return kind.from_full(np.clip(values, lower, upper), self.n, **words)

    def into(self, model: PowerModel, z: np.ndarray) -> PowerModel:
        """The model with the effect of these numbers, in place of those that it replaces."""
        for name in self.term.instead:
            model = model.without(name)
        return model.replaced(self.effect(z))

    def out_of(self, model: PowerModel, declared: PowerModel) -> PowerModel:
        """The model with what the declared one has in place of the effect."""
        held = [e for name in (self.term.instead or (self.term.name,)) if (e := declared.get(name)) is not None]
        if not self.term.declared:
            model = model.without(self.term.name)
        for effect in held:
            model = model.replaced(effect)
        return model

    @property
    def shapes(self) -> np.ndarray:
        """(Z,) True for shape parameters."""
        return np.array([p.shapes for p, *_ in entries(self.term.kind, self.n, len(self.base))])[self.kept]

    def wider(self, times: np.ndarray) -> Chart:
        """The chart with the prior widths of its sizes multiplied by (Z,) factors; shapes keep theirs."""
        narrow = np.where(self.shapes, 1.0, 1 / times)
        return replace(self, precision=self.precision * np.outer(narrow, narrow))

    def _inner(self, z: np.ndarray) -> np.ndarray:
        """All chart values (P,) with the free ones set to z."""
        x = self.base.copy()
        x[self.kept] = z
        return x


def entries(kind: type[Effect], n: int, length: int) -> list[tuple[Parameter, int, int]]:
    """For each entry of `full` (of `length` numbers): its parameter, joint (-1 if none), and index within it."""
    free = {d for p in kind.parameters for d in p.free}
    extents = dict(kind.extents_by_default)
    if free:  # one free dimension, whose length follows from the number of entries
        name = next(iter(free))
        fixed = sum(p.count(n, {name: 0}) for p in kind.parameters)
        per = sum(p.count(n, {name: 1}) for p in kind.parameters) - fixed
        extents[name] = (length - fixed) // per
    out = []
    for p in kind.parameters:
        count = p.count(n, extents)
        each = count // n if p.per_joint else count
        out += [(p, k // each if p.per_joint else -1, k % each) for k in range(count)]
    return out


def _bounds(kind: type[Effect], n: int, length: int) -> tuple[np.ndarray, np.ndarray]:
    """Bounds (P,) of all parameters in a fit."""
    limits = [p.bounds for p, _, _ in entries(kind, n, length)]
    return np.array([low for low, _ in limits]), np.array([high for _, high in limits])


def usual(unit: str, joint: int, scale: Scale) -> float | None:
    """Usual size of a joint's number, by its unit; None if it follows from the number's effect on the power."""
    if joint < 0:
        return None
    effort, cruise = scale.effort[joint], scale.usual_speed[joint]
    sizes = {
        "N m": USUAL * effort,
        "N m s/rad": USUAL * effort / cruise,
        "kg m^2": ROTOR * effort,
        "W/(N m)^2": HEAT / (HOLD * effort) ** 2,
        "1": 0.1,
        "1/W": 0.1 / HEAT,  # of a winding warmed by its own heat
        "N m/rad": 2 * USUAL * effort,
        "rad": 2 * USUAL * effort,  # a spring, whose chart value is a torque
        "W s/rad": USUAL * effort / 2,
        "W s^2/rad^2": USUAL * effort / cruise / 2,
    }
    return sizes.get(unit, USUAL * effort if unit.startswith("N m (") else None)


def chart(term: Term, declared: PowerModel, scale: Scale, n: int) -> Chart:
    """The chart of a term over a declared model.

    An effect that the model lacks starts where it changes (almost) nothing; a declared one at its values. Friction is
    bounded by the share `MOST` of the effort limits, and readings of the joints in `scale.measured` narrow the prior.

    Args:
        scale: usual sizes on the arm, which give the prior's widths. n: number of joints.
    """
    kind, words = term.kind, words_of(term.options)
    held = declared.get(term.name) if term.declared else None
    idle = kind.neutral(n, **words)
    full = np.array(term.trial) if term.instead and term.trial else held.full(n) if held is not None else idle.full(n)
    own = entries(kind, n, len(full))
    if held is None and term.trial:
        full = np.where([p.shapes or p.steps for p, _, _ in own], term.trial, full)
    x0 = kind.to_chart(full, n)
    kept = np.array([k for k, (p, _, _) in enumerate(own) if not p.steps])
    free = {d for p in kind.parameters for d in p.free}
    low, high = _bounds(kind, n, len(full)) if free else kind.chart_bounds(n)
    torque = np.array([p.unit.startswith("N m") and j >= 0 and p.lower >= 0 for p, j, _ in own])
    most = np.array([MOST * scale.effort[j] if j >= 0 else np.inf for _, j, _ in own])
    friction = torque & np.array([p.unit == "N m" or p.unit.startswith("N m (") for p, _, _ in own])
    viscous = torque & np.array([p.unit == "N m s/rad" for p, _, _ in own])
    speed = np.array([scale.velocity[j] if j >= 0 else 1.0 for _, j, _ in own])
    high = np.where(friction, np.minimum(high, most), high)
    high = np.where(viscous, np.minimum(high, most / (CRUISE * speed)), high)
    mean, covariance, unknown = _before(kind, own, full, x0, scale, held is not None)
    mean, covariance = mean[kept], covariance[np.ix_(kept, kept)]
    if term.name in scale.measured:
        mean, covariance = _informed(mean, covariance, scale.measured[term.name])
    return Chart(
        term, n, x0, kept, x0[kept].copy(), mean, np.linalg.inv(covariance), low[kept], high[kept], unknown[kept]
    )


def _informed(mean: np.ndarray, covariance: np.ndarray, seen_by: Measured) -> tuple[np.ndarray, np.ndarray]:
    """Kalman update of a prior with measurements of some of its numbers, one for each joint."""
    seen = covariance[seen_by.joints]
    gain = np.linalg.solve(seen[:, seen_by.joints] + seen_by.covariance, seen).T
    mean = mean + gain @ (seen_by.values - mean[seen_by.joints])
    covariance = covariance - gain @ seen
    return mean, (covariance + covariance.T) / 2


def _before(
    kind: type[Effect], owners: list[tuple[Parameter, int, int]], full: np.ndarray, x0: np.ndarray, scale: Scale,
    declared: bool,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Prior mean (P,) and covariance (P, P) of the chart's values, and which sizes are still unknown (P,)."""
    count = len(owners)
    size, unknown = np.ones(count), np.zeros(count, dtype=bool)
    shared = np.zeros((count, count))
    own = np.ones(count)
    for k, (p, joint, _) in enumerate(owners):
        known = usual(p.unit, joint, scale)
        if declared and x0[k] != 0 and not p.shapes:
            size[k], own[k] = abs(x0[k] - (p.neutral if p.neutral == 1 else 0.0)) or 0.1, REFIT[1]
        elif p.shapes and joint < 0 and full[k] != 0:
            size[k] = SHAPE * abs(full[k])
        elif known is not None:
            size[k], own[k] = known, OWN
        else:
            unknown[k] = True
    for i, (p, joint, at) in enumerate(owners):
        for k, (other, beside, place) in enumerate(owners):
            if p is other and joint >= 0 and beside >= 0 and kind.same_on_all_joints:
                near = 1.0 if p.dimensions == ("joint",) else 0.3 + 0.7 * float(np.exp(-((at - place) ** 2) / 4))
                share = REFIT[0] ** 2 if declared else 1.0
                shared[i, k] = share * near + (own[i] ** 2 * near if joint == beside else 0.0)
            elif i == k:
                shared[i, i] = REFIT[0] ** 2 if declared and not unknown[i] else 1.0
    covariance = shared * np.outer(size, size)
    return x0.copy(), covariance + 1e-9 * np.diag(np.diag(covariance)), unknown


def sized(c: Chart, columns: np.ndarray, scale: Scale) -> Chart:
    """Set the prior width of unknown numbers: the size that adds a share `POWER` of the arm's level.

    Args:
        columns: (M, Z) [W] derivatives of the readings by each number.
    """
    if not c.unknown.any():
        return c
    precision = c.precision.copy()
    rms = np.sqrt(np.mean(columns**2, axis=0))
    for k in np.flatnonzero(c.unknown):
        precision[k, :] = precision[:, k] = 0.0
        precision[k, k] = (max(float(rms[k]), 1e-9) / (POWER * scale.level)) ** 2
    own = entries(c.term.kind, c.n, len(c.base))
    for k in np.flatnonzero(c.unknown):
        if own[c.kept[k]][0].unit == "m":  # a payload: its chart is (m, m c)
            precision[k, k] = precision[0, 0] / REACH**2
    return replace(c, precision=precision, unknown=np.zeros_like(c.unknown))
