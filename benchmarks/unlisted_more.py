"""Nine more laws that `energy_opt` has no effect for, from books on physics (`unlisted.py --more`)."""

from __future__ import annotations

import numpy as np
from unlisted_law import Law, Part, Rows, sign
from unlisted_laws import KINDS


class SkinEffect(Law):
    """A winding's resistance grows with the square of the current's frequency."""

    def draw(self, rng: np.random.Generator) -> None:
        self.base = rng.uniform(0.15, 0.4) * self.limits.velocity

    def drawn(self, p: Part, motor: np.ndarray, bus: np.ndarray) -> np.ndarray:
        return np.sum(self.heat * motor**2 * (p.v / self.base) ** 2, axis=1)


class Preload(Law):
    """A long spring or hose pulls each joint one way with a constant torque."""

    kin = frozenset({"gravity_spring"})

    def draw(self, rng: np.random.Generator) -> None:
        self.pull = 2 * self.drag * rng.choice([-1, 1], self.n) * rng.uniform(0.5, 1.5, self.n)

    def added(self, p: Part) -> np.ndarray:
        return self.pull + np.zeros_like(p.q)


class Hunting(Law):
    """A servo hunts about its target at rest, the harder the more it holds."""

    kin = frozenset({"idle_hold"})

    def drawn(self, p: Part, motor: np.ndarray, bus: np.ndarray) -> np.ndarray:
        still = np.abs(p.v).max(axis=1) < 1e-4
        return still * np.sum(np.abs(motor) / self.limits.effort, axis=1) * 10


class RippleCurrent(Law):
    """A bridge's ripple current: its loss goes with (d (1 - d))^2 of the duty d, which follows the speed."""

    def draw(self, rng: np.random.Generator) -> None:
        self.top = rng.uniform(0.3, 0.6) * self.limits.velocity

    def drawn(self, p: Part, motor: np.ndarray, bus: np.ndarray) -> np.ndarray:
        duty = 0.5 + 0.5 * np.clip(p.v / self.top, -1, 1)
        return 8 * np.sum(np.linspace(1, 0.4, self.n) * (16 * (duty * (1 - duty)) ** 2 - 1), axis=1)


class CrossInertia(Law):
    """A motor sits on the link before: that link's acceleration turns its rotor, too."""

    def draw(self, rng: np.random.Generator) -> None:
        self.rotor = np.array(self.drives.rotor) * rng.uniform(0.6, 1.2, self.n)

    def added(self, p: Part) -> np.ndarray:
        return np.column_stack([np.zeros(len(p.t)), self.rotor[1:] * p.a[:, :-1]])


class BackDrive(Law):
    """A worm gear: a load that drives the motor loses a good part of its torque, a driven load none."""

    kin = frozenset({"load_friction", "gear_efficiency"})

    def draw(self, rng: np.random.Generator) -> None:
        self.part = rng.uniform(0.15, 0.4, self.n)

    def added(self, p: Part) -> np.ndarray:
        return self.part * np.abs(p.tau) * sign(p.v) * (p.tau * p.v < 0)


class Alignment(Law):
    """An encoder off its centre turns the commutation: copper loss differs over the turn."""

    kin = frozenset({"copper_loss"})

    def draw(self, rng: np.random.Generator) -> None:
        self.phase = rng.uniform(0, 6.28, self.n)

    def drawn(self, p: Part, motor: np.ndarray, bus: np.ndarray) -> np.ndarray:
        return np.sum(self.heat * motor**2 * (1 + np.sin(p.q + self.phase)), axis=1)


class ProportionalFan(Law):
    """A fan whose speed follows the drives' heat, its power with the cube."""

    def draw(self, rng: np.random.Generator) -> None:
        self.slow = rng.uniform(15, 50)

    def mains(self, parts: list[Part], motor: Rows, bus: Rows, size: float) -> Rows:
        heat = [np.sum(self.heat * m**2, axis=1) for m in motor]
        warm, at, most, out = heat[0][0], parts[0].t[0], np.quantile(np.concatenate(heat), 0.95), []
        for p, h, b in zip(parts, heat, bus, strict=True):
            warm *= np.exp(-max(p.t[0] - at, 0) / self.slow)
            rows, step = np.empty(len(h)), p.t[1] - p.t[0]
            for k, x in enumerate(h):
                warm += step / self.slow * (x - warm)
                rows[k] = warm
            at = p.t[-1]
            out.append(b + size * 10 * (rows / most) ** 3)
        return out


class Reversals(Law):
    """Iron that lags: a loss with every change of the torque, as the area of a loop."""

    def drawn(self, p: Part, motor: np.ndarray, bus: np.ndarray) -> np.ndarray:
        rate = np.abs(np.gradient(motor, p.t, axis=0))
        return np.sum(0.02 * rate * np.sqrt(np.abs(motor) + 0.1), axis=1)


MORE_KINDS: dict[str, type[Law]] = {
    "skin_effect": SkinEffect,
    "preload": Preload,
    "hunting": Hunting,
    "ripple_current": RippleCurrent,
    "cross_inertia": CrossInertia,
    "back_drive": BackDrive,
    "alignment": Alignment,
    "proportional_fan": ProportionalFan,
    "reversals": Reversals,
}
EVERY = {**KINDS, **MORE_KINDS}
