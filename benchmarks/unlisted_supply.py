"""Laws of drives' electronics, cells and supplies outside the library: they change what the mains give."""

from __future__ import annotations

import numpy as np
from unlisted_law import Law, Part, Rows


def switched(runs: Rows, on: float, off: float) -> Rows:
    """A switch with hysteresis over runs that follow each other: 1 from above `on` until below `off`, else 0."""
    closed, out = False, []
    for values in runs:
        state = np.empty(len(values))
        for k, x in enumerate(values):
            closed = bool(x > on or (closed and x > off))
            state[k] = closed
        out.append(state)
    return out


class Conduction(Law):
    """Transistors conduct at a voltage that grows with the logarithm of the current."""

    kin = frozenset({"inverter_loss", "copper_loss"})  # as the square of small currents, as large ones' size

    def draw(self, rng: np.random.Generator) -> None:
        self.first = rng.uniform(0.01, 0.04) * self.limits.effort

    def drawn(self, p: Part, motor: np.ndarray, bus: np.ndarray) -> np.ndarray:
        part = np.abs(motor) / self.limits.effort
        return 12 * np.sum(part * np.log1p(np.abs(motor) / self.first), axis=1)


class Fan(Law):
    """A fan that a thermostat switches: on above a temperature, off below a lower one."""

    def draw(self, rng: np.random.Generator) -> None:
        self.slow, self.power = rng.uniform(25, 70), rng.uniform(5, 9)

    def mains(self, parts: list[Part], motor: Rows, bus: Rows, size: float) -> Rows:
        heat = [np.sum(self.heat * m**2, axis=1) for m in motor]
        warm, last, at = [], heat[0][0], parts[0].t[0]
        for p, h in zip(parts, heat, strict=True):
            last *= np.exp(-max(p.t[0] - at, 0) / self.slow)
            rows, step = np.empty(len(h)), p.t[1] - p.t[0]
            for k, x in enumerate(h):
                last += step / self.slow * (x - last)
                rows[k] = last
            warm.append(rows)
            at = p.t[-1]
        off, on = np.quantile(np.concatenate(warm), [0.4, 0.7])
        return [b + size * self.power * state for b, state in zip(bus, switched(warm, on, off), strict=True)]


class Chopper(Law):
    """No feed-back: a link capacitor fills, a resistor switches on above a voltage and off below a lower one."""

    kin = frozenset({"regeneration", "dc_link"})
    scales = False

    def draw(self, rng: np.random.Generator) -> None:
        self.on, self.burn = rng.uniform(3, 8), rng.uniform(60, 150)  # J above the nominal charge; W

    def mains(self, parts: list[Part], motor: Rows, bus: Rows, size: float) -> Rows:
        if not size:
            return bus
        out = []
        for p, b in zip(parts, bus, strict=True):
            held, burning, step, rows = 0.0, False, p.t[1] - p.t[0], np.empty(len(b))
            for k, x in enumerate(b):
                burning = held > self.on or (burning and held > 0.4 * self.on)
                held -= (x + self.burn * burning) * step
                rows[k] = max(-held, 0.0) / step
                held = max(held, 0.0)
            out.append(rows)
        return out


class Network(Law):
    """The mains' voltage wanders by some per cent, and what the cabinet draws goes with its square."""

    kin = frozenset({"run_offset"})

    def draw(self, rng: np.random.Generator) -> None:
        self.rates, self.phases = rng.uniform(0.02, 0.2, 3), rng.uniform(0, 6.28, 3)

    def drawn(self, p: Part, motor: np.ndarray, bus: np.ndarray) -> np.ndarray:
        swing = 0.012 * np.sin(np.outer(p.t, self.rates) + self.phases).sum(axis=1)
        return self.drives.standby * ((1 + swing) ** 2 - 1)


class Phases(Law):
    """A supply that switches a second stage on above a load, and off below a lower one."""

    def draw(self, rng: np.random.Generator) -> None:
        self.cost, self.at = rng.uniform(3, 7), rng.uniform(0.6, 0.85)

    def mains(self, parts: list[Part], motor: Rows, bus: Rows, size: float) -> Rows:
        off, on = np.quantile(np.concatenate(bus), [self.at - 0.15, self.at])
        return [b + size * self.cost * state for b, state in zip(bus, switched(bus, on, off), strict=True)]


class Pump(Law):
    """A vacuum pump that its own pressure switch turns on, whatever the arm does."""

    def draw(self, rng: np.random.Generator) -> None:
        self.period, self.lasts, self.phase = rng.uniform(9, 17), rng.uniform(1.5, 3), rng.uniform(0, 10)

    def drawn(self, p: Part, motor: np.ndarray, bus: np.ndarray) -> np.ndarray:
        return 8.0 * ((p.t + self.phase) % self.period < self.lasts)


class Brakes(Law):
    """Brakes fall in a moment after the arm stands still, and the motors are switched off."""

    kin = frozenset({"idle_hold"})
    scales = False

    def draw(self, rng: np.random.Generator) -> None:
        self.after = rng.uniform(0.15, 0.3)

    def drawn(self, p: Part, motor: np.ndarray, bus: np.ndarray) -> np.ndarray:
        still = np.zeros(len(p.t))
        step = p.t[1] - p.t[0]
        for k in range(1, len(p.t)):
            still[k] = still[k - 1] + step if np.abs(p.v[k]).max() < 1e-4 else 0.0
        return -bus * (still > self.after)
