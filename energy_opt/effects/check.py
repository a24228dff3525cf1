"""One check that every effect must pass, a user's own included."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from itertools import product
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from energy_opt.effects import stages
from energy_opt.effects.base import Effect, Signals
from energy_opt.effects.meter import MeterEffect
from energy_opt.effects.parameter import EXACT, Kinks, Parameter, Smooth
from energy_opt.errors import BadInput, one_line_of

SAMPLES = 60
CLOSE = 1e-4  # relative tolerance of derivatives and of recovered parameters
GRAVITY = np.array([0.0, 0.0, -9.81])
LINK = (2.0, np.array([0.02, -0.05, 0.1]), np.diag([0.03, 0.04, 0.02]))  # [kg], [m], [kg m^2] nominal link of the check
DRAWN = {  # random signals of the past and the recording
    "warmth": lambda rng, shape: rng.uniform(0, 1, shape),
    "idle": lambda rng, shape: rng.uniform(-1, 2, shape),
    "returned": lambda rng, shape: np.zeros(shape),
    "dwell": lambda rng, shape: rng.uniform(0, 5, shape),
    "day": lambda rng, shape: rng.uniform(0, 86400, shape),
    "logged": lambda rng, shape: rng.integers(0, 2, shape),
    "run": lambda rng, shape: rng.integers(0, 6, shape),
}


def check_effect(kind: type[Effect], joints: int = 3, seed: int = 0) -> list[str]:
    """Faults of an effect, one sentence each; empty if it passes.

    Checked: at its neutral value it changes nothing; its derivatives by every parameter agree with finite differences;
    it is finite at rest; if it claims to dissipate, it never gives power; its parameters are recovered from data
    that it simulates.

    Args:
        kind: the effect's class. joints: number of joints of the arm that is simulated. seed: of its random states.
    """
    rng = np.random.default_rng(seed)
    if issubclass(kind, MeterEffect | stages.StoreEffect | stages.HeatMemoryEffect):
        law = _law_over_time(kind, rng)
    else:
        law = _law(kind, joints, rng)
    joints = law.joints
    faults = []
    neutral = kind.neutral(joints).full(joints)
    change = law.change(neutral)
    if np.abs(change).max() > 1e-9:
        faults.append(f"{kind.name}: changes something at its neutral value (by {np.abs(change).max():.3g})")
    values = kind.example(joints, rng)
    faults += _derivatives(kind, law, values)
    if not (np.isfinite(law.at_rest(values)).all()):
        faults.append(f"{kind.name}: is not finite at rest")
    if kind.dissipates and law.given(values).min() < -1e-9:
        faults.append(f"{kind.name}: claims to dissipate, but gives {-law.given(values).min():.3g} W")
    return faults + _recovery(kind, law, values, rng)


def _derivatives(kind: type[Effect], law: SimpleNamespace, values: np.ndarray) -> list[str]:
    """A fault if the Jacobian of the law disagrees with central finite differences of step 1e-6."""
    exact, smooth = law.jacobian(values), _entries(kind, law.joints, lambda p: not p.steps)
    for k in np.flatnonzero(smooth):
        step = 1e-6 * max(1.0, abs(values[k]))
        high, low = values.copy(), values.copy()
        high[k] += step
        low[k] -= step
        difference = (law.change(high) - law.change(low)) / (2 * step)
        scale = max(float(np.abs(difference).max()), 1e-6)
        if np.abs(exact[:, k] - difference).max() > CLOSE * scale:
            return [f"{kind.name}: derivative by number {k} of its parameters disagrees with finite differences"]
    return []


def _recovery(kind: type[Effect], law: SimpleNamespace, values: np.ndarray, rng: np.random.Generator) -> list[str]:
    """A fault if least squares, started 10 % off, does not recover the parameters from the law's own values.

    Parameters whose law has steps are not fitted. For these, values of 0.7 and 1.4 times the true one must change the
    data.
    """
    from scipy.optimize import least_squares

    data = law.change(values)
    free = _entries(kind, law.joints, lambda p: not p.steps)  # a fit may descend along these
    start = np.where(free, values * (1 + 0.1 * rng.uniform(-1, 1, len(values))), values)
    low = np.concatenate([np.full(p.count(law.joints, kind.extents_by_default), p.lower) for p in kind.parameters])
    high = np.concatenate([np.full(p.count(law.joints, kind.extents_by_default), p.upper) for p in kind.parameters])
    found = least_squares(
        lambda x: law.change(_replaced_at(values, free, x)) - data, np.clip(start, low, high)[free],
        lambda x: law.jacobian(_replaced_at(values, free, x))[:, free],
        bounds=(low[free] - 1e-12, high[free] + 1e-12), x_scale=np.maximum(np.abs(values[free]), 1e-3),
        xtol=1e-14, ftol=1e-14, gtol=1e-14,
    ).x if free.any() else values[free]  # fmt: skip
    off = np.abs(found - values[free]) / np.maximum(np.abs(values[free]), 1e-3)
    if np.max(off, initial=0.0) > CLOSE:
        return [f"{kind.name}: its parameters are not recovered from its own data (off by {off.max():.2g})"]
    grid = _entries(kind, law.joints, lambda p: bool(p.free))
    for k in np.flatnonzero(~free & ~grid):  # scanned: no other value may fit as well
        others = [_replaced_at(values, np.arange(len(values)) == k, values[k] * share) for share in (0.7, 1.4)]
        if min(np.abs(law.change(x) - data).max() for x in others) < 1e-9:
            return [f"{kind.name}: number {k} of its parameters cannot be scanned: others fit its data as well"]
    return []


def _entries(kind: type[Effect], joints: int, holds: Callable[[Parameter], bool]) -> np.ndarray:
    """For each entry of `full`: what `holds` says of its parameter."""
    return np.array([holds(p) for p in kind.parameters for _ in range(p.count(joints, kind.extents_by_default))])


def _replaced_at(values: np.ndarray, where: np.ndarray, x: np.ndarray | float) -> np.ndarray:
    """`values` with x at the places `where`."""
    out = values.copy()
    out[where] = x
    return out


def _law(kind: type[Effect], joints: int, rng: np.random.Generator) -> SimpleNamespace:
    """The change that an effect makes (M,), its Jacobian, the power it takes away, and its values at rest."""
    q, v, a, tau, warm = (ca.SX.sym(name, joints) for name in ("q", "v", "a", "tau", "temperature"))
    past = {name: ca.SX.sym(name, joints if name == "warmth" else 1) for name in kind.follows if name != "temperature"}
    given = {name: {"signal": past[name]} if name == "logged" else past[name] for name in past}
    x = Signals(q, v, a, tau, ca.SX.sym("t"), warm, **given)
    p = ca.SX.sym("p", kind.size(joints))
    change, given = _expressions(kind, x, p, joints, EXACT)
    smooth, _ = _expressions(kind, x, p, joints, Smooth())
    inputs = [ca.vertcat(x.q, x.v, x.a, x.tau, x.t, warm, *past.values()), p]
    jacobian = ca.densify(ca.jacobian(change, p))
    function = ca.Function("f", inputs, [ca.densify(change), jacobian, ca.densify(given), ca.densify(smooth)])
    spread = np.array([1.0] * 3 * joints + [8.0] * joints + [0.0] + [10.0] * joints)
    states = rng.normal(size=(SAMPLES, 5 * joints + 1)) * spread
    states[:, joints : 2 * joints] *= rng.random((SAMPLES, joints)) > 0.3  # some joints stand still
    states[:, 4 * joints] = rng.uniform(0, 300.0, SAMPLES)  # [s]
    states[:, 4 * joints + 1 :] += 25.0  # [degC]
    added = [DRAWN[name](rng, (SAMPLES, symbol.numel())) for name, symbol in past.items()]
    states = np.column_stack([states, *added])
    rest = states.copy()
    rest[:, joints : 3 * joints] = 0

    def evaluate(which: int, at: np.ndarray, values: np.ndarray) -> list[np.ndarray]:
        return [np.array(function(state, values)[which]) for state in at]

    return SimpleNamespace(
        joints=joints,
        change=lambda values: np.concatenate([y.ravel() for y in evaluate(0, states, values)]),
        jacobian=lambda values: np.vstack(evaluate(1, states, values)),
        given=lambda values: np.concatenate([y.ravel() for y in evaluate(2, states, values)]),
        at_rest=lambda values: np.concatenate([y.ravel() for k in (0, 1, 3) for y in evaluate(k, rest, values)]),
    )


def _each_option(kind: type[Effect]) -> list[dict[str, str]]:
    """All combinations of an effect's options."""
    return [dict(zip(kind.options, words, strict=True)) for words in product(*kind.options.values())]


def _expressions(kind: type[Effect], x: Signals, p: ca.SX, joints: int, kinks: Kinks) -> tuple[ca.SX, ca.SX]:
    """What an effect adds (to torque, power, heat or gravity), and the power that it takes away, W.

    For an effect with options, the expressions for all combinations, one below the other.
    """
    added, given = [], []
    for words in _each_option(kind):
        effect = kind.neutral(joints, **words)
        added.append(_added(effect, x, effect.named(p, joints), joints, kinks))
        torque, rigid = isinstance(effect, stages.TorqueEffect), isinstance(effect, stages.RigidEffect)
        given.append(ca.dot(added[-1], x.v) if torque else ca.SX(0) if rigid else added[-1])
    return ca.vertcat(*added), ca.vertcat(*given)


def _added(effect: Effect, x: Signals, p: SimpleNamespace, joints: int, kinks: Kinks) -> ca.SX:
    """What one effect adds (M, 1), as its law states it."""
    power = ca.dot(x.tau, x.v)
    if isinstance(effect, stages.TorqueEffect):
        return _returned(effect, effect.torque(x, p, kinks))
    if isinstance(effect, stages.PowerEffect):
        return _returned(effect, effect.power(x, x.tau, p, kinks))
    if isinstance(effect, stages.HeatEffect):
        return _returned(effect, effect.heat(x, x.tau, p, kinks))
    if isinstance(effect, stages.WindingEffect):
        return _returned(effect, effect.factor(x, p)) - 1
    if isinstance(effect, stages.DriveEffect):
        return _returned(effect, effect.drawn(x.tau * x.v, p, kinks)) - power
    if isinstance(effect, stages.SupplyEffect):
        drawn = 100 + power**2
        return _returned(effect, effect.at_meter(drawn, p, kinks)) - drawn
    if isinstance(effect, stages.RigidEffect):
        links = effect.links([LINK] * joints, p)
        if links is not None:
            return ca.vertcat(*(ca.vertcat(m - LINK[0], c - LINK[1], ca.vec(i - LINK[2])) for m, c, i in links))
        mass, place = effect.point_mass(p) or (ca.SX(0), ca.SX.zeros(3))
        held = effect.changing_mass(x, p)
        if held is not None:
            mass, place = held[0] * held[2], held[1]
        changed = _returned(effect, effect.gravity(ca.SX(GRAVITY), p)) - GRAVITY
        return ca.vertcat(mass, mass * place, ca.vec(mass * place @ place.T), changed)
    raise NotImplementedError(f"{effect.name}: no check for an effect of stage {effect.stage!r}")


def _returned(effect: Effect, found: Any) -> Any:
    """What a law returned.

    Raises:
        BadInput: nothing.
    """
    if found is None:
        raise BadInput(f"effect {effect.name}: its law returns nothing (None); is its `return` missing?")
    return found


def refuse_unusable(kind: type[Effect], joints: int = 2) -> None:
    """Evaluate a law once, as a plan does; laws that follow signals of a recording are not tried.

    Raises:
        BadInput: it fails, has another shape than its stage needs, or is not finite at rest or in motion.
    """
    if issubclass(kind, MeterEffect) or kind.follows:
        return
    q, v, a, tau, t = (ca.SX.sym(name, size) for name, size in zip("qvaft", (joints,) * 4 + (1,), strict=True))
    for words in _each_option(kind):
        effect = kind.neutral(joints, **words)
        values = effect.full(joints)
        p = ca.SX.sym("p", len(values))
        try:
            found = ca.SX(_added(effect, Signals(q, v, a, tau, t), effect.named(p, joints), joints, EXACT))
            law = ca.Function("law", [ca.vertcat(q, v, a, tau, t), p], [ca.densify(found)])
        except BadInput:
            raise
        except Exception as fault:
            hint = "; a law has no `if`: use functions of k, such as k.below" if "truth value" in str(fault) else ""
            raise BadInput(f"effect {kind.name}: {one_line_of(fault, inspect.getfile(kind))}{hint}") from None
        sizes = {"torque": (joints,), "heat": (joints,), "winding": (1, joints), "rigid": (found.shape[0],)}
        lengths = sizes.get(kind.stage, (1,))
        if found.shape not in [(length, 1) for length in lengths]:
            expected = f"({lengths[0]}, 1) on an arm of {joints} joints"
            raise BadInput(f"effect {kind.name}: its law has shape {found.shape}; expected {expected}")
        for speed in (0.0, 0.3):
            if not np.isfinite(np.array(law(np.full(4 * joints + 1, speed), values))).all():
                raise BadInput(f"effect {kind.name}: its law is not finite {'in motion' if speed else 'at rest'}")


def _law_over_time(
    kind: type[MeterEffect] | type[stages.StoreEffect] | type[stages.HeatMemoryEffect], rng: np.random.Generator
) -> SimpleNamespace:
    """`_law` for an effect whose law runs over time, on a power over time."""
    time = np.arange(200) * 0.01
    wave = sum(5 * rng.normal() * np.sin(2 * np.pi * f * time + rng.uniform(0, 6)) for f in (0.7, 1.6, 2.9))
    step, still = np.full_like(time, 0.01), np.zeros_like(time)

    def run(values: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Change (M,) by the effect if the power, or the root of the heat, is x (M,)."""
        if issubclass(kind, MeterEffect):
            return kind.reading(time, 90 + x, float(values[0])) - 90 - x
        if issubclass(kind, stages.StoreEffect):
            return kind.supplied(step, x, float(values[0])) - x
        none, heated = ca.DM.zeros(1), ca.DM(kind.heated(50 * time, x[:, None] ** 2, values))
        signals = Signals(none, none, none, none, none, heated=heated)
        return np.array(kind.factor(signals, kind.split(ca.DM(values), 1))).ravel() - 1

    def slopes(values: np.ndarray) -> np.ndarray:
        if issubclass(kind, MeterEffect):
            return kind.sensitivity(time, 90 + wave, float(values[0]))[:, None]
        both = [run(values + h, wave) - run(values - h, wave) for h in 1e-6 * np.eye(len(values))]
        return np.column_stack(both) / 2e-6

    def given(values: np.ndarray) -> np.ndarray:
        if issubclass(kind, MeterEffect):
            return np.zeros(1)
        return np.cumsum(run(values, wave)) * 0.01 if issubclass(kind, stages.StoreEffect) else run(values, wave)

    return SimpleNamespace(
        joints=1, change=lambda values: run(values, wave), jacobian=slopes, given=given,
        at_rest=lambda values: run(values, still),
    )  # fmt: skip
