"""Drives of the misfit worlds: motors with a current, and causes by other formulas than the library's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from misfit_motions import STEP

from energy_opt.robot import Robot
from energy_opt.virtual_arm.mujoco_arm import MujocoArm

if TYPE_CHECKING:
    from misfit_world import World

TURNS = 0.002  # [rad/s] speed within which friction turns about: no joint slides as slowly

LAWS = ("psu_loss", "asymmetric_friction", "power_law_friction", "thermal_viscous", "dc_link", "idle_hold")
CAUSES = (
    "coulomb_friction",
    "viscous_friction",
    "payload",
    "regeneration",
    "armature",
    "gravity_spring",
    "base_tilt",
    "supply_efficiency",
    "motion_power",
)
MORE = (
    "stribeck_friction",
    "load_friction",
    "gear_efficiency",
    "inverter_loss",
    "iron_loss",
    "standby_drift",
    "winding_temperature",
    "meter_delay",
    "meter_filter",
    "winding_self_heating",
    "temperature_friction",
    "signal_power",
    "payload_change",
)
UNSCALED = (
    "payload", "regeneration", "base_tilt", "supply_efficiency", "psu_loss", "dc_link", "idle_hold", "meter_delay",
    "meter_filter", "gear_efficiency", "payload_change",
)  # fmt: skip


@dataclass(frozen=True)
class Drives:
    """Standby [W]; R / Kt^2 [W/(N m)^2], usual friction [N m], rotor inertia [kg m^2] of each joint; payload [kg]."""

    standby: float
    heat: tuple[float, ...]
    drag: tuple[float, ...]
    rotor: tuple[float, ...]
    load: float


ARMS = {
    "panda": Drives(
        62.0, (0.005,) * 4 + (0.05,) * 3, (0.6, 0.7, 0.5, 0.8, 0.5, 0.2, 0.3), (0.25,) * 4 + (0.07,) * 3, 1.9
    ),
    "ur5": Drives(71.0, (0.006,) * 3 + (0.035,) * 3, (2.0, 2.4, 1.4, 0.6, 0.5, 0.5), (0.7,) * 3 + (0.1,) * 3, 2.4),
    "z1": Drives(24.0, (0.025,) * 3 + (0.05,) * 3, (0.5, 0.9, 0.8, 0.4, 0.4, 0.3), (0.14,) * 3 + (0.05,) * 3, 1.0),
    "xarm7": Drives(
        45.0, (0.012,) * 5 + (0.05,) * 2, (0.9, 1.0, 0.6, 0.7, 0.5, 0.4, 0.3), (0.3,) * 5 + (0.06,) * 2, 1.7
    ),
}


class Motors:
    """The drives as motors: current from torque, heat from current, and one further cause of size `size`."""

    def __init__(
        self,
        world: World,
        drives: Drives,
        robot: Robot,
        body: MujocoArm,
        loaded: MujocoArm | None,
        rng: np.random.Generator,
    ) -> None:
        self.cause, self.drives, self.loaded, self.body = world.cause, drives, loaded, body
        n = robot.n
        self.drag = np.array(drives.drag) * rng.uniform(0.7, 1.4) * rng.uniform(0.85, 1.15, n)
        self.rotor = np.array(drives.rotor) * rng.uniform(0.9, 1.6)
        self.side = rng.uniform(0.2, 0.4, n) * rng.choice([-1, 1], n)
        self.spring = np.zeros(n)
        self.spring[1] = drives.load * rng.uniform(5, 9)
        self.rest = rng.uniform(-0.4, 0.4)
        self.tilt = rng.uniform(0.05, 0.12), rng.uniform(0, 6.28)
        self.eta = rng.uniform(0.84, 0.92)
        self.constant = float(rng.uniform(0.8, 1.4))
        kt = rng.uniform(5.0, 15.0, n)  # N m/A at the joint side
        self.kt, self.resistance = kt, np.array(drives.heat) * kt**2
        self.scales = bool(world.cause) and world.cause not in UNSCALED
        more = np.random.default_rng([world.seed, 9])
        self.lag = more.uniform(0.06, 0.16)  # s
        self.soak = more.uniform(40.0, 90.0)  # s
        self.cold, self.warm = more.uniform(18.0, 26.0), more.uniform(8.0, 16.0, n)  # degC, K
        self.first = 1 + int(more.integers(2))  # dwell of a run at which a payload is picked up
        self.switches = more.uniform(0, 6.28, 2)
        self.share = more.uniform(0.08, 0.14, n)  # of the load, in friction

    def values(self, size: float) -> dict[str, list[float]]:
        """The cause's numbers by the parameter's name."""
        known = {
            "coulomb_friction": ("tau_c", size * self.drag),
            "viscous_friction": ("b", size * 1.2 * self.drag),
            "armature": ("inertia", size * self.rotor),
            "supply_efficiency": ("eta", np.array([self.eta])),
            "motion_power": ("power", np.array([size * self.constant * 4.0])),
            "load_friction": ("mu", size * self.share),
            "gear_efficiency": ("eta", 1 - self.share),
            "signal_power": ("power", np.array([size * 5 * self.constant])),
            "inverter_loss": ("c", np.array([size * 0.15 * self.constant])),
            "standby_drift": ("power", np.array([size * 5 * self.constant])),
            "meter_delay": ("delay", np.array([self.lag])),
            "meter_filter": ("time_constant", np.array([self.lag])),
        }
        return {known[self.cause][0]: known[self.cause][1].tolist()} if self.cause in known else {}

    def motor(
        self, t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, tau: np.ndarray, size: float
    ) -> np.ndarray:
        """Torque of the motors at the joints, N m, (N, n)."""
        c = self.cause if size else ""
        way = sign(v)
        if c == "payload" and self.loaded is not None:
            tau = self.loaded.inverse(q, v, a)
        if c == "base_tilt":
            g = self.body.model.opt.gravity.copy()
            angle, to = self.tilt
            self.body.model.opt.gravity[:] = 9.81 * np.array(
                [np.sin(angle) * np.cos(to), np.sin(angle) * np.sin(to), -np.cos(angle)]
            )
            tau = self.body.inverse(q, v, a)
            self.body.model.opt.gravity[:] = g
        if c == "coulomb_friction":
            tau = tau + size * self.drag * way
        if c == "viscous_friction":
            tau = tau + size * 1.2 * self.drag * v
        if c == "power_law_friction":
            tau = tau + size * 1.3 * self.drag * np.sqrt(np.abs(v)) * way
        if c == "asymmetric_friction":
            tau = tau + size * self.drag * (way + self.side * way**2)
        if c == "stribeck_friction":
            tau = tau + size * 2 * self.drag / np.exp((v / (0.25 * self.constant)) ** 2) * way
        if c == "temperature_friction":
            rubs = size * (self.drag * way + 0.6 * self.drag * v)
            tau = tau + rubs * 2.0 ** (-(self.temperature(t) - 30.0) / 25.0)  # halves every 25 K
        if c == "payload_change" and self.loaded is not None:
            tau = np.where(self.holds(t, v)[:, None], self.loaded.inverse(q, v, a), tau)
        if c == "load_friction":
            tau = tau + size * self.share * np.abs(tau) * way
        if c == "gear_efficiency":
            eta = 1 - self.share
            tau = np.where(tau * v > 0, tau / eta, np.where(tau * v < 0, tau * eta, tau * (eta + 1 / eta) / 2))
        if c == "thermal_viscous":
            tau = tau + size * 1.5 * self.drag * v * (0.5 + 0.5 * np.exp(-t / 90.0))[:, None]
        if c == "armature":
            tau = tau + size * self.rotor * a
        if c == "gravity_spring":
            tau = tau - size * self.spring * (q - self.rest)
        return tau

    def temperature(self, t: np.ndarray) -> np.ndarray:
        """Of the joints, degC, (N, n): they warm up with the session, each by its own amount."""
        return self.cold + self.warm * (1 - np.exp(-t / self.soak))[:, None] * (1 + 0.2 * np.sin(t / 37.0))[:, None]

    def gripper(self, t: np.ndarray) -> np.ndarray:
        """A digital output, (N,) 0 or 1, that follows nothing else."""
        return (np.sin(t / 2.3 + self.switches[0]) + np.sin(t / 5.1 + self.switches[1]) > 0.3).astype(float)

    def holds(self, t: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Is the payload held, (N,)? From the middle of the run's dwell number `first` on."""
        moves = np.abs(v).max(axis=1) > 1e-3
        stops = np.flatnonzero(moves[:-1] & ~moves[1:])
        starts = [k for k in np.flatnonzero(~moves[:-1] & moves[1:]) if stops.size and k > stops[0]]
        if len(starts) < self.first:
            return np.zeros(len(t), dtype=bool)
        return np.asarray(t >= (t[stops[self.first - 1]] + t[starts[self.first - 1]]) / 2)

    def columns(self, t: np.ndarray, joints: tuple[str, ...]) -> dict[str, np.ndarray]:
        """What the recorder logs beside, by the column's name, of causes that follow it."""
        if self.cause == "temperature_friction":
            return {f"{j}.temperature": x for j, x in zip(joints, self.temperature(t).T, strict=True)}
        return {"gripper": self.gripper(t)} if self.cause == "signal_power" else {}

    def bus(self, tau: np.ndarray, v: np.ndarray, t: np.ndarray, size: float) -> np.ndarray:
        """What the joints take, W, (N,), of motors at `tau` (N, n) N m."""
        heat = self.resistance * (tau / self.kt) ** 2
        if size and self.cause == "winding_self_heating":
            heat = heat * (1 + size * 0.05 * self.theta(t, heat))
        if size and self.cause == "winding_temperature":
            heat = heat * (1 + size * 0.4 * (1 - np.exp(-t / self.soak)))[:, None]
        return (heat + tau * v).sum(axis=1)

    def theta(self, t: np.ndarray, heat: np.ndarray) -> np.ndarray:
        """Rise of each winding's own heat, W, (N, n); what went before the run is carried over by `past`."""
        at, state = self.past
        state = state[1] + np.exp(-max(t[0] - at, 0.0) / self.soak) * (state[0] - state[1])
        out = np.empty_like(heat)
        for k, now in enumerate(heat):
            out[k] = state
            state = state + STEP / self.soak * (now - state)
        self.past = t[-1], (state, heat[-1])
        return out

    def begins(self) -> None:
        """A session begins: windings are cold."""
        self.past = 0.0, (np.zeros(len(self.kt)), np.zeros(len(self.kt)))

    def mains(self, t: np.ndarray, v: np.ndarray, tau: np.ndarray, bus: np.ndarray, size: float) -> np.ndarray:
        """Power at the mains, W, (N,), of motors at `tau` N m that take `bus` W; with size 0 without the cause."""
        c = self.cause if size else ""
        if c == "regeneration":
            bus = np.maximum(bus, 0.0)
        if c == "dc_link":
            bus = _buffered(bus, STEP, 6.0)
        total = self.drives.standby + bus
        if c == "motion_power":
            total = total + size * self.constant * 4.0 * (np.abs(v).max(axis=1) > 1e-4)
        if c == "signal_power":
            total = total + size * 5 * self.constant * self.gripper(t)
        if c == "inverter_loss":
            total = total + size * 0.15 * self.constant * np.abs(tau).sum(axis=1)
        if c == "iron_loss":
            total = total + size * (self.drag * (0.5 * np.abs(v) + 0.8 * v**2)).sum(axis=1)
        if c == "standby_drift":
            total = total + size * 5 * self.constant * (1 - np.exp(-t / self.soak))
        if c == "idle_hold":
            moving = np.abs(v).max(axis=1) > 1e-4
            since = np.full(len(v), 1e3)
            for k in range(1, len(v)):
                since[k] = 0.0 if moving[k] else since[k - 1] + STEP
            total = total + 7.0 * self.constant * ((since > 0) & (since < self.constant))
        if c == "supply_efficiency":
            total = total / self.eta
        if c == "psu_loss":
            total = total * (1 + 4e-4 * self.constant * total)
        return total

    def shown(self, power: np.ndarray) -> np.ndarray:
        """What the meter makes of the power of a run, W, (N,), at steps of the world."""
        time = np.arange(len(power)) * STEP
        if self.cause == "meter_delay":
            return np.interp(time - self.lag, time, power)
        if self.cause == "meter_filter":  # exact between steps where the power is linear
            out, kept = power.astype(float), np.exp(-STEP / self.lag)
            for k in range(1, len(power)):
                behind = self.lag * (power[k] - power[k - 1]) / STEP
                out[k] = power[k] - behind + kept * (out[k - 1] - power[k - 1] + behind)
            return out
        return power


def _buffered(bus: np.ndarray, step: float, capacity: float) -> np.ndarray:
    """What the supply gives where a capacitor of `capacity` J takes back what comes and gives it first."""
    out, held = np.maximum(bus, 0.0), 0.0
    for k, p in enumerate(bus):
        if p < 0:
            held = min(capacity, held - p * step)
        elif held > 0:
            used = min(held, p * step)
            held -= used
            out[k] = p - used / step
    return out


def sign(v: np.ndarray) -> np.ndarray:
    """Direction of motion; within `TURNS` of rest it turns smoothly."""
    return np.tanh(v / TURNS)
