"""Laws of drives, bearings, cells and supplies that `energy_opt` has no effect for, from books and papers on physics.

Each law is a class. It sees a whole session, run after run in the order of time, as some of them remember what went
before. `torque` is what it adds to the motor's torque, `mains` what the mains give for the joints' drive power. `kin`
names the effects of the library that are the same mechanism in another form: to claim one of them is no false cause.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from unlisted_law import FRICTION, Law, Part, Rows, sign
from unlisted_supply import Brakes, Chopper, Conduction, Fan, Network, Phases, Pump


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


class CurrentOffset(Law):
    """A current sensor's offset: the motor carries a current beside its own, and heats by their sum squared."""

    def draw(self, rng: np.random.Generator) -> None:
        self.offset = 0.12 * self.limits.effort * rng.choice([-1, 1], self.n)

    def drawn(self, p: Part, motor: np.ndarray, bus: np.ndarray) -> np.ndarray:
        return np.sum(self.heat * ((motor + self.offset) ** 2 - motor**2), axis=1)


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
