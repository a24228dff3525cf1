"""Laws of drives, bearings, cells and supplies that `energy_opt` has no effect for, from books and papers on physics.

Each law is a class. It sees a whole session, run after run in the order of time, as some of them remember what went
before. `torque` is what it adds to the motor's torque, `mains` what the mains give for the joints' drive power. `kin`
names the effects of the library that are the same mechanism in another form: to claim one of them is no false cause.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from misfit_drives import Drives

FRICTION = frozenset({"coulomb_friction", "friction_curve"})


@dataclass(frozen=True)
class Part:
    """A run: time on the session's clock (N,) s; q, v, a (N, n) rad, rad/s, rad/s^2; rigid-body torque (N, n) N m.

    `moment` (N, n) N m: what bends each joint's bearing, where a law asks for it.
    """

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    tau: np.ndarray
    moment: np.ndarray | None = None


@dataclass(frozen=True)
class Limits:
    """Of the arm's joints: speed (n,) rad/s, effort (n,) N m."""

    velocity: np.ndarray
    effort: np.ndarray


Rows = list[np.ndarray]


class Law:
    """Base of the laws: adds nothing.

    `size` multiplies what a law that `scales` adds.
    """

    kin: ClassVar[frozenset[str]] = frozenset()
    scales: ClassVar[bool] = True

    def __init__(self, drives: Drives, limits: Limits, rng: np.random.Generator) -> None:
        self.drives, self.limits = drives, limits
        self.drag, self.heat = np.array(drives.drag), np.array(drives.heat)
        self.n = len(self.drag)
        self.draw(rng)

    def draw(self, rng: np.random.Generator) -> None:
        """Draw what differs from arm to arm."""

    def torque(self, parts: list[Part], size: float) -> Rows:
        """What the law adds to the motor's torque in each run, (N, n) N m."""
        return [size * self.added(p) for p in parts]

    def mains(self, parts: list[Part], motor: Rows, bus: Rows, size: float) -> Rows:
        """What the mains give beside standby in each run, (N,) W, for joints that take `bus` W."""
        return [b + size * self.drawn(p, m, b) for p, m, b in zip(parts, motor, bus, strict=True)]

    def added(self, p: Part) -> np.ndarray:
        return np.zeros_like(p.q)

    def drawn(self, p: Part, motor: np.ndarray, bus: np.ndarray) -> np.ndarray:
        return np.zeros(len(p.t))


def sign(v: np.ndarray) -> np.ndarray:
    """Direction of motion; within 2 mrad/s of rest it turns smoothly."""
    return np.tanh(v / 0.002)


class Cogging(Law):
    """Slots and magnets attract each other: torque in sines of the position, a few to some dozen a turn."""

    def draw(self, rng: np.random.Generator) -> None:
        self.count, self.phase = rng.integers(6, 30, self.n), rng.uniform(0, 6.28, self.n)

    def added(self, p: Part) -> np.ndarray:
        return 0.9 * self.drag * np.sin(self.count * p.q + self.phase)


class MeshRipple(Law):
    """Stiffness and transmission error of a gear's mesh: a ripple in proportion to the load (Tuttle and Seering)."""

    def draw(self, rng: np.random.Generator) -> None:
        self.count, self.phase = rng.integers(15, 50, self.n), rng.uniform(0, 6.28, self.n)

    def added(self, p: Part) -> np.ndarray:
        return 0.12 * np.abs(p.tau) * np.sin(self.count * p.q + self.phase)


class Dahl(Law):
    """Dahl's presliding: friction is a spring that slips, dF/dx = s (1 - F / Fc sign(v))."""

    kin = FRICTION | {"asymmetric_friction"}

    def draw(self, rng: np.random.Generator) -> None:
        self.reach = rng.uniform(0.05, 0.25, self.n)  # rad until friction is whole

    def torque(self, parts: list[Part], size: float) -> Rows:
        z, out = np.zeros(self.n), []
        for p in parts:
            rows = np.empty_like(p.q)
            for k in range(len(p.t)):
                step = p.v[k] * (p.t[1] - p.t[0])
                z = np.clip(z + (step - np.abs(step) * z) / self.reach, -1, 1)
                rows[k] = z
            out.append(size * 1.2 * self.drag * rows)
        return out


class PlaceFriction(Law):
    """Friction that differs over the turn: a warped ring, a seal that is not round, a toothed belt."""

    kin = FRICTION | {"asymmetric_friction"}

    def draw(self, rng: np.random.Generator) -> None:
        self.phase = rng.uniform(0, 6.28, self.n)

    def added(self, p: Part) -> np.ndarray:
        return self.drag * (1 + 0.9 * np.sin(2 * p.q + self.phase)) * sign(p.v)


class CableDrag(Law):
    """A dress pack: slack at first, then a spring that stiffens, with losses in its sheath."""

    kin = frozenset({"gravity_spring", "viscous_friction"})

    def draw(self, rng: np.random.Generator) -> None:
        self.slack, self.rest = rng.uniform(0.2, 0.5, self.n), rng.uniform(-0.5, 0.5, self.n)

    def added(self, p: Part) -> np.ndarray:
        pull = np.maximum(np.abs(p.q - self.rest) - self.slack, 0)
        return 1.5 * self.drag * (pull**2 * np.sign(p.q - self.rest) + 0.8 * pull * p.v)


class GasSpring(Law):
    """A counterbalance by gas: p V^1.3 is constant, its volume falls with the lever's angle."""

    kin = frozenset({"gravity_spring"})

    def draw(self, rng: np.random.Generator) -> None:
        self.rest, self.stroke = rng.uniform(-0.5, 0.5), rng.uniform(0.25, 0.4)

    def added(self, p: Part) -> np.ndarray:
        out, angle = np.zeros_like(p.q), p.q[:, 1] - self.rest
        push = (1 - self.stroke * (1 - np.cos(angle))) ** -1.3
        out[:, 1] = -4 * self.drives.load * push * np.sin(angle)
        return out


class Belt(Law):
    """An elastic belt between motor and joint: the motor stretches it, and stretching it takes and loses work."""

    def draw(self, rng: np.random.Generator) -> None:
        self.give = rng.uniform(0.02, 0.06, self.n) / self.limits.effort  # rad/(N m)
        self.damping = rng.uniform(0.05, 0.15)  # s

    def drawn(self, p: Part, motor: np.ndarray, bus: np.ndarray) -> np.ndarray:
        rate = np.gradient(motor, p.t, axis=0)
        return np.sum(self.give * (motor * rate + self.damping * rate**2), axis=1)


class Saturation(Law):
    """Iron saturates: Kt falls with the current, so that heat grows faster than torque squared."""

    def draw(self, rng: np.random.Generator) -> None:
        self.knee = rng.uniform(0.3, 0.6) * self.limits.effort

    def drawn(self, p: Part, motor: np.ndarray, bus: np.ndarray) -> np.ndarray:
        return np.sum(self.heat * motor**2 * ((1 + (motor / self.knee) ** 2) ** 2 - 1), axis=1)


class FieldWeakening(Law):
    """Above its base speed a motor needs a current against its magnets, which heats and makes no torque."""

    def draw(self, rng: np.random.Generator) -> None:
        self.base = rng.uniform(0.12, 0.25) * self.limits.velocity

    def drawn(self, p: Part, motor: np.ndarray, bus: np.ndarray) -> np.ndarray:
        against = 0.3 * self.limits.effort * np.maximum(np.abs(p.v) / self.base - 1, 0)
        return np.sum(self.heat * against**2, axis=1)


class Conduction(Law):
    """Transistors conduct at a voltage that grows with the logarithm of the current."""

    kin = frozenset({"inverter_loss", "copper_loss"})  # as the square of small currents, as large ones' size

    def draw(self, rng: np.random.Generator) -> None:
        self.first = rng.uniform(0.01, 0.04) * self.limits.effort

    def drawn(self, p: Part, motor: np.ndarray, bus: np.ndarray) -> np.ndarray:
        part = np.abs(motor) / self.limits.effort
        return 12 * np.sum(part * np.log1p(np.abs(motor) / self.first), axis=1)


class CurrentOffset(Law):
    """A current sensor's offset: the motor carries a current beside its own, and heats by their sum squared."""

    def draw(self, rng: np.random.Generator) -> None:
        self.offset = 0.12 * self.limits.effort * rng.choice([-1, 1], self.n)

    def drawn(self, p: Part, motor: np.ndarray, bus: np.ndarray) -> np.ndarray:
        return np.sum(self.heat * ((motor + self.offset) ** 2 - motor**2), axis=1)


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
        runs, out = False, []
        for rows, b in zip(warm, bus, strict=True):
            state = np.empty(len(rows))
            for k, x in enumerate(rows):
                runs = x > on or (runs and x > off)
                state[k] = runs
            out.append(b + size * self.power * state)
        return out


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


class CoupledFriction(Law):
    """A differential wrist: two motors turn two axes together, and rub by the sum and difference of their speeds."""

    kin = FRICTION

    def draw(self, rng: np.random.Generator) -> None:
        self.first = self.n - 3

    def added(self, p: Part) -> np.ndarray:
        i, out = self.first, np.zeros_like(p.q)
        both = 2.0 * self.drag[i] * sign(p.v[:, i] + p.v[:, i + 1])
        apart = 2.0 * self.drag[i] * sign(p.v[:, i] - p.v[:, i + 1])
        out[:, i], out[:, i + 1] = (both + apart) / 2, (both - apart) / 2
        return out


class BearingLoad(Law):
    """A bearing rubs by the moment that bends it, which is not the joint's own torque (SKF's model, M1)."""

    kin = FRICTION | {"load_friction", "asymmetric_friction"}

    def added(self, p: Part) -> np.ndarray:
        assert p.moment is not None
        return 0.05 * p.moment * sign(p.v)


class Thixotropy(Law):
    """Grease that stiffens at rest and thins when worked: dl/dt = (1 - l) / T - |v| l / s, drag b v (1 + 3 l)."""

    kin = frozenset({"viscous_friction"})

    def draw(self, rng: np.random.Generator) -> None:
        self.rest, self.worked = rng.uniform(10, 30), rng.uniform(0.3, 1.0)

    def torque(self, parts: list[Part], size: float) -> Rows:
        stiff, at, out = np.ones(self.n), parts[0].t[0], []
        for p in parts:
            stiff = 1 - (1 - stiff) * np.exp(-max(p.t[0] - at, 0) / self.rest)
            rows, step = np.empty_like(p.q), p.t[1] - p.t[0]
            for k in range(len(p.t)):
                stiff = stiff + step * ((1 - stiff) / self.rest - np.abs(p.v[k]) * stiff / self.worked)
                rows[k] = stiff
            at = p.t[-1]
            out.append(size * 0.5 * self.drag * p.v * (1 + 3 * rows))
        return out


class Phases(Law):
    """A supply that switches a second stage on above a load, and off below a lower one."""

    def draw(self, rng: np.random.Generator) -> None:
        self.cost, self.at = rng.uniform(3, 7), rng.uniform(0.6, 0.85)

    def mains(self, parts: list[Part], motor: Rows, bus: Rows, size: float) -> Rows:
        off, on = np.quantile(np.concatenate(bus), [self.at - 0.15, self.at])
        runs, out = False, []
        for b in bus:
            state = np.empty(len(b))
            for k, x in enumerate(b):
                runs = x > on or (runs and x > off)
                state[k] = runs
            out.append(b + size * self.cost * state)
        return out


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


KINDS: dict[str, type[Law]] = {
    "cogging": Cogging,
    "mesh_ripple": MeshRipple,
    "dahl": Dahl,
    "place_friction": PlaceFriction,
    "cable_drag": CableDrag,
    "gas_spring": GasSpring,
    "belt": Belt,
    "saturation": Saturation,
    "field_weakening": FieldWeakening,
    "conduction": Conduction,
    "current_offset": CurrentOffset,
    "fan": Fan,
    "chopper": Chopper,
    "network": Network,
    "coupled_friction": CoupledFriction,
    "bearing_load": BearingLoad,
    "thixotropy": Thixotropy,
    "phases": Phases,
    "pump": Pump,
    "brakes": Brakes,
}  # fmt: skip


def bending(model: object, data: object, mujoco: object) -> Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]:
    """A function of q, v, a (N, n) that returns the moment (N, n) N m across each joint's axis, by MuJoCo."""

    def moments(q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        m, d, lib = model, data, mujoco
        out = np.empty_like(q)
        for k in range(len(q)):
            d.qpos[:], d.qvel[:], d.qacc[:] = q[k], v[k], a[k]  # type: ignore[attr-defined]
            lib.mj_inverse(m, d)  # type: ignore[attr-defined]
            lib.mj_rnePostConstraint(m, d)  # type: ignore[attr-defined]
            for j in range(q.shape[1]):
                body = m.jnt_bodyid[j]  # type: ignore[attr-defined]
                wrench, centre = d.cfrc_int[body], d.subtree_com[m.body_rootid[body]]  # type: ignore[attr-defined]
                moment = wrench[:3] + np.cross(centre - d.xanchor[j], wrench[3:])  # type: ignore[attr-defined]
                axis = d.xaxis[j]  # type: ignore[attr-defined]
                out[k, j] = np.linalg.norm(moment - axis * (axis @ moment))
        return out

    return moments
