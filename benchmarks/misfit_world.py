"""Measured sets of an arm that is not the library's: links off their URDF, laws by other formulas, noise with memory.

Nothing here comes from `energy_opt.effects` or Pinocchio: torque is MuJoCo's, from a URDF whose masses, centres of mass
and inertias were changed; drives are written as motors with a current; motions are blended trapezoids, not quintics;
the meter drifts, rounds and remembers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from misfit_motions import STEP, hand_torque, session
from misfit_urdf import write_changed, write_loaded

from energy_opt.effects import CopperLoss, Standby
from energy_opt.files import write_toml
from energy_opt.power import PowerModel
from energy_opt.robot import Robot, load_robot
from energy_opt.virtual_arm.mujoco_arm import MujocoArm
from energy_opt.virtual_arm.plant import Plant

NOISES = ("white", "ar1", "drift", "quantised")
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

SCALED = (
    "coulomb_friction", "viscous_friction", "armature", "gravity_spring", "motion_power", "asymmetric_friction",
    "power_law_friction", "thermal_viscous",
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


@dataclass(frozen=True)
class World:
    """What is true of a set.

    Attributes:
        spread: by how much links are off, as (low, high) shares; (0, 0): as in the URDF.
        noise: one of NOISES. cause: one of CAUSES or LAWS, or "" for none.
        stronger: the cause adds at least this many times the misfit's RMS.
        currents: the joints' currents are logged. metered: the power is. pushed: runs in which a hand pushes the arm.
    """

    arm: str
    seed: int
    spread: tuple[float, float] = (0.05, 0.10)
    noise: str = "white"
    cause: str = ""
    stronger: float = 3.0
    motions: int = 9
    poses: int = 6
    currents: bool = False
    metered: bool = True
    pushed: tuple[int, ...] = ()


@dataclass(frozen=True)
class Truth:
    """A set's folder, robot and declared model, and the RMS [W] that misfit and cause add to its power.

    `values`: the cause's true numbers by parameter, where its law has the same ones.
    """

    folder: Path
    robot: Robot
    declared: PowerModel
    misfit: float
    added: float
    start: float
    values: dict[str, list[float]]


def write_world(world: World, folder: Path, fresh: bool = False) -> Truth:
    """Simulate and write a set; `fresh`: further motions of the same arm, from another part of its workspace."""
    folder.mkdir(parents=True, exist_ok=True)
    robot, drives = load_robot(world.arm), ARMS[world.arm]
    rng = np.random.default_rng([world.seed, 5])
    urdf = folder / "true.urdf"
    mass = drives.load * rng.uniform(0.5, 1.1) if world.cause == "payload" else 0.0
    com = rng.uniform([-0.04, -0.04, 0.03], [0.04, 0.04, 0.12])
    write_changed(robot, world.spread, rng, urdf)
    body, nominal = (
        MujocoArm(replace(robot, urdf=urdf), Plant(PowerModel("", ()))),
        MujocoArm(robot, Plant(PowerModel("", ()))),
    )
    level = rng.uniform(0.3, 0.03 * drives.standby)
    moves = np.random.default_rng([world.seed, 6, int(fresh)])
    runs = session(robot, moves, 5 if fresh else world.motions, 0 if fresh else world.poses, shifted=fresh)
    start = 300.0 if fresh else 0.0
    parts, gaps = [], np.cumsum([start, *(len(r[0]) * STEP + moves.uniform(6, 18) for r in runs)])
    for (q, v, a), begin in zip(runs, gaps[:-1], strict=True):
        tau = body.inverse(q, v, a)
        t = begin + np.arange(len(q)) * STEP
        parts.append((t, q, v, a, tau, nominal.inverse(q, v, a)))
    weighed = replace(robot, urdf=write_loaded(urdf, robot, mass, com)) if mass else None
    law = _Law(world, drives, robot, body, MujocoArm(weighed, Plant(PowerModel("", ()))) if weighed else None, rng)
    misfit = np.concatenate(
        [law.power(t, q, v, a, tau, 0) - law.power(t, q, v, a, bare, 0) for t, q, v, a, tau, bare in parts]
    )
    added = np.concatenate(
        [law.power(t, q, v, a, tau, 1) - law.power(t, q, v, a, tau, 0) for t, q, v, a, tau, _ in parts]
    )
    size = 1.0
    wanted = world.stronger * float(np.sqrt(np.mean(misfit**2)))
    if world.cause and law.scales and not fresh:
        have = float(np.sqrt(np.mean(added**2)))
        size = float(np.clip(wanted / max(have, 1e-9), 1.0, 3.0))
        (folder / "size.txt").write_text(repr(size))
    if fresh and (folder.parent / "set" / "size.txt").is_file():
        size = float((folder.parent / "set" / "size.txt").read_text())
    entries, total = [], []
    seen = np.random.default_rng([world.seed, 7, int(fresh)])
    rounding = float(seen.choice([0.5, 1.0])) if world.noise == "quantised" else 0.05
    memory, share = float(np.exp(seen.uniform(np.log(0.2), np.log(2.0)))), seen.uniform(0.5, 1.2)
    wander = seen.uniform(0.3, 1.0) * seen.normal(size=3)
    hand = np.random.default_rng([world.seed, 8])
    for k, (t, q, v, a, tau, _) in enumerate(parts):
        if k in world.pushed:
            tau = tau - hand_torque(t - t[0], robot, hand)
        true = law.power(t, q, v, a, tau, size)
        total.append(true - law.power(t, q, v, a, tau, 0))
        every = 2 if world.seed % 2 else 3  # 125 or 83 Hz
        rows = slice(None, None, every)
        time, shown = t[rows] - t[0], true[rows]
        shown = shown + level * seen.normal(size=len(time))
        if world.noise == "ar1":
            keep = np.exp(-every * STEP / memory)
            e = np.empty(len(time))
            e[0] = seen.normal()
            for i, x in enumerate(np.sqrt(1 - keep**2) * seen.normal(size=len(time) - 1)):
                e[i + 1] = keep * e[i] + x
            shown = shown + share * level * e
        if world.noise == "drift":
            shown = shown + wander[0] * np.sin(t[rows] / 70 + wander[1]) + wander[2] * t[rows] / 200
        shown = np.round(shown / rounding) * rounding
        position = np.round((q[rows] + 5e-6 * seen.normal(size=q[rows].shape)) / 2e-5) * 2e-5
        header, table = ["time", *(f"{j}.position" for j in robot.joints)], [time, *position.T]
        if world.currents:
            current = law.motor(t, q, v, a, tau, size)[rows] / law.kt
            table += [*(current + 0.01 * np.abs(current).max(axis=0) * hand.normal(size=current.shape)).T]
            header += [f"{j}.current" for j in robot.joints]
        if world.metered:
            header, table = [*header, "power"], [*table, shown]
        name = f"run{k + 1:02d}.csv"
        np.savetxt(folder / name, np.column_stack(table), "%.6f", ",", header=",".join(header), comments="")
        entries.append({"file": name, "kind": "static" if not v.any() else "motion", "start": float(t[0])})
    write_toml(folder / "log.toml", {"format": "energy-opt/log/1", "robot": world.arm, "run": entries})
    declared = PowerModel(world.arm, (Standby(power=drives.standby), CopperLoss(r_over_kt2=list(drives.heat))))
    declared.save(folder / "declared.toml")
    rms = float(np.sqrt(np.mean(misfit**2)))
    added_rms = float(np.sqrt(np.mean(np.concatenate(total) ** 2)))
    values = {**law.values(size), **({"mass": [mass]} if mass else {})}
    return Truth(folder, robot, declared, rms, added_rms, start, values)


class _Law:
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
        self.scales = world.cause in SCALED

    def values(self, size: float) -> dict[str, list[float]]:
        """The cause's numbers by the parameter's name."""
        known = {
            "coulomb_friction": ("tau_c", size * self.drag),
            "viscous_friction": ("b", size * 1.2 * self.drag),
            "armature": ("inertia", size * self.rotor),
            "supply_efficiency": ("eta", np.array([self.eta])),
            "motion_power": ("power", np.array([size * self.constant * 4.0])),
        }
        return {known[self.cause][0]: known[self.cause][1].tolist()} if self.cause in known else {}

    def motor(
        self, t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, tau: np.ndarray, size: float
    ) -> np.ndarray:
        """Torque of the motors at the joints, N m, (N, n)."""
        c = self.cause if size else ""
        way = np.tanh(v / 0.002)
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
        if c == "thermal_viscous":
            tau = tau + size * 1.5 * self.drag * v * (0.5 + 0.5 * np.exp(-t / 90.0))[:, None]
        if c == "armature":
            tau = tau + size * self.rotor * a
        if c == "gravity_spring":
            tau = tau - size * self.spring * (q - self.rest)
        return tau

    def power(
        self, t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, tau: np.ndarray, size: float
    ) -> np.ndarray:
        """Power at the mains, W, (N,); with size 0 without the cause."""
        c = self.cause if size else ""
        tau = self.motor(t, q, v, a, tau, size)
        current = tau / self.kt
        joint = self.resistance * current**2 + tau * v
        bus = joint.sum(axis=1)
        if c == "regeneration":
            bus = np.maximum(bus, 0.0)
        if c == "dc_link":
            bus = _buffered(bus, STEP, 6.0)
        total = self.drives.standby + bus
        if c == "motion_power":
            total = total + size * self.constant * 4.0 * (np.abs(v).max(axis=1) > 1e-4)
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
