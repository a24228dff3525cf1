"""Measured sets of an arm that is not the library's: links off their URDF, laws by other formulas, noise with memory.

Nothing here comes from `energy_opt.effects` or Pinocchio: torque is MuJoCo's, from a URDF whose masses, centres of mass
and inertias were changed; drives are written as motors with a current; motions are blended trapezoids, not quintics;
the meter drifts, rounds and remembers. `misfit_drives.py` has the listed causes, `unlisted_laws.py` those that the
library has no effect for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from misfit_drives import ARMS, CAUSES, LAWS, MORE, Motors
from misfit_motions import STEP, hand_torque, session
from misfit_urdf import with_urdf, write_changed, write_loaded
from unlisted_law import Limits, Part
from unlisted_laws import bending
from unlisted_more import EVERY

from energy_opt.effects import CopperLoss, Standby
from energy_opt.files import write_toml
from energy_opt.power import PowerModel
from energy_opt.robot import Robot, load_robot
from energy_opt.virtual_arm.mujoco_arm import MujocoArm
from energy_opt.virtual_arm.plant import Plant

__all__ = ["ARMS", "CAUSES", "LAWS", "MORE", "NOISES", "Motors", "Truth", "World", "write_world"]

NOISES = ("white", "ar1", "drift", "quantised")
Motion = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class World:
    """What is true of a set.

    Attributes:
        spread: by how much links are off, as (low, high) shares; (0, 0): as in the URDF.
        noise: one of NOISES. cause: one of CAUSES, LAWS or MORE, or "" for none.
        stronger: the cause adds at least this many times the misfit's RMS.
        currents: the joints' currents are logged. metered: the power is. pushed: runs in which a hand pushes the arm.
        unlisted: one of `unlisted_more.EVERY`, or "" for none. repeats: how often every motion is recorded.
        sharp: the acceleration jumps, as in trapezoids of speed that are not blended.
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
    unlisted: str = ""
    repeats: int = 1
    sharp: bool = False


@dataclass(frozen=True)
class Truth:
    """A set's folder, robot and declared model, and the RMS [W] that misfit and cause add to its power.

    `values`: the cause's true numbers by parameter, where its law has the same ones. `start`: of the session, s.
    `noise`: measured less true power of each file, W. `at_rows`: the true q, v, a and set time at the file's rows.
    `plant`: the true power of further motions, (N,) W each, one after another from `end` [s] on.
    `sharp`: smoothing makes the motion inexact, so that no error equals that at the true motion.
    """

    folder: Path
    robot: Robot
    declared: PowerModel
    misfit: float
    added: float
    start: float
    values: dict[str, list[float]]
    noise: dict[str, np.ndarray]
    at_rows: dict[str, tuple[np.ndarray, ...]]
    measured: dict[str, np.ndarray]
    plant: Callable[[list[Motion]], list[np.ndarray]]
    sharp: bool = False


def write_world(world: World, folder: Path, fresh: bool = False) -> Truth:
    """Simulate and write a set; `fresh`: further motions of the same arm, from another part of its workspace."""
    folder.mkdir(parents=True, exist_ok=True)
    robot, drives = load_robot(world.arm), ARMS[world.arm]
    rng = np.random.default_rng([world.seed, 5])
    urdf = folder / "true.urdf"
    mass = drives.load * rng.uniform(0.5, 1.1) if world.cause in ("payload", "payload_change") else 0.0
    com = rng.uniform([-0.04, -0.04, 0.03], [0.04, 0.04, 0.12])
    write_changed(robot, world.spread, rng, urdf)
    body, nominal = (
        MujocoArm(with_urdf(robot, urdf), Plant(PowerModel("", ()))),
        MujocoArm(robot, Plant(PowerModel("", ()))),
    )
    level = rng.uniform(0.3, 0.03 * drives.standby)
    moves = np.random.default_rng([world.seed, 6, int(fresh)])
    runs = session(robot, moves, 5 if fresh else world.motions, 0 if fresh else world.poses, fresh, world.sharp)
    if world.repeats > 1:
        runs = runs * world.repeats
    start = 300.0 if fresh else 0.0
    gaps = np.cumsum([start, *(len(r[0]) * STEP + moves.uniform(6, 18) for r in runs)])
    weighed = with_urdf(robot, write_loaded(urdf, robot, mass, com)) if mass else None
    law = Motors(world, drives, robot, body, MujocoArm(weighed, Plant(PowerModel("", ()))) if weighed else None, rng)
    limits = Limits(robot.limits.velocity, robot.limits.effort)
    wild = EVERY[world.unlisted](drives, limits, np.random.default_rng([world.seed, 10])) if world.unlisted else None
    moments = bending(body.model, body.data, body.mujoco) if world.unlisted == "bearing_load" else None

    def part(motion: Motion, begin: float, arm: MujocoArm = body) -> Part:
        q, v, a = motion
        bent = moments(q, v, a) if moments else None
        return Part(begin + np.arange(len(q)) * STEP, q, v, a, arm.inverse(q, v, a), bent)

    def powers(parts: list[Part], size: float, unlisted: float) -> list[np.ndarray]:
        motor = [law.motor(p.t, p.q, p.v, p.a, p.tau, size) for p in parts]
        if wild and unlisted:
            motor = [m + x for m, x in zip(motor, wild.torque(parts, unlisted), strict=True)]
        law.begins()
        bus = [law.bus(m, p.v, p.t, size) for m, p in zip(motor, parts, strict=True)]
        if wild and unlisted:
            bus = wild.mains(parts, motor, bus, unlisted)
        return [law.mains(p.t, p.v, m, b, size) for p, m, b in zip(parts, motor, bus, strict=True)]

    parts = [part(motion, begin) for motion, begin in zip(runs, gaps[:-1], strict=True)]
    off = [replace(p, tau=nominal.inverse(p.q, p.v, p.a)) for p in parts] if any(world.spread) else parts
    bare = powers(parts, 0, 0)
    misfit = np.concatenate(bare) - np.concatenate(powers(off, 0, 0))
    added = np.concatenate(powers(parts, 1, 0)) - np.concatenate(bare)
    size = strength = 1.0
    wanted = world.stronger * float(np.sqrt(np.mean(misfit**2)))
    if world.cause and law.scales and not fresh:
        have = float(np.sqrt(np.mean(added**2)))
        size = float(np.clip(wanted / max(have, 1e-9), 1.0, 3.0))
        (folder / "size.txt").write_text(repr(size))
    if fresh and (folder.parent / "set" / "size.txt").is_file():
        size = float((folder.parent / "set" / "size.txt").read_text())
    if wild and wild.scales:
        brought = float(np.std(np.concatenate(powers(parts, size, 1)) - np.concatenate(powers(parts, size, 0))))
        strength = float(np.clip(level * rng.uniform(1.5, 5.0) / max(brought, 1e-9), 0.3, 3.0))
    truly = powers(parts, size, strength)
    entries, total = [], np.concatenate(truly) - np.concatenate(bare)
    noise: dict[str, np.ndarray] = {}
    at_rows: dict[str, tuple[np.ndarray, ...]] = {}
    measured: dict[str, np.ndarray] = {}
    seen = np.random.default_rng([world.seed, 7, int(fresh)])
    rounding = float(seen.choice([0.5, 1.0])) if world.noise == "quantised" else 0.05
    memory, share = float(np.exp(seen.uniform(np.log(0.2), np.log(2.0)))), seen.uniform(0.5, 1.2)
    wander = seen.uniform(0.3, 1.0) * seen.normal(size=3)
    hand = np.random.default_rng([world.seed, 8])
    for k, (p, true) in enumerate(zip(parts, truly, strict=True)):
        if k in world.pushed:
            p = replace(p, tau=p.tau - hand_torque(p.t - p.t[0], robot, hand))
            true = powers([p], size, strength)[0]
        every = 2 if world.seed % 2 else 3  # 125 or 83 Hz
        rows = slice(None, None, every)
        time, shown = p.t[rows] - p.t[0], law.shown(true)[rows]
        shown = shown + level * seen.normal(size=len(time))
        if world.noise == "ar1":
            keep = np.exp(-every * STEP / memory)
            e = np.empty(len(time))
            e[0] = seen.normal()
            for i, x in enumerate(np.sqrt(1 - keep**2) * seen.normal(size=len(time) - 1)):
                e[i + 1] = keep * e[i] + x
            shown = shown + share * level * e
        if world.noise == "drift":
            shown = shown + wander[0] * np.sin(p.t[rows] / 70 + wander[1]) + wander[2] * p.t[rows] / 200
        shown = np.round(shown / rounding) * rounding
        position = np.round((p.q[rows] + 5e-6 * seen.normal(size=p.q[rows].shape)) / 2e-5) * 2e-5
        header, table = ["time", *(f"{j}.position" for j in robot.joints)], [time, *position.T]
        if world.currents:
            current = law.motor(p.t, p.q, p.v, p.a, p.tau, size)[rows] / law.kt
            table += [*(current + 0.01 * np.abs(current).max(axis=0) * hand.normal(size=current.shape)).T]
            header += [f"{j}.current" for j in robot.joints]
        for column, values in law.columns(p.t[rows], robot.joints).items():
            header, table = [*header, column], [*table, values]
        if world.metered:
            header, table = [*header, "power"], [*table, shown]
        name = f"run{k + 1:02d}.csv"
        np.savetxt(folder / name, np.column_stack(table), "%.6f", ",", header=",".join(header), comments="")
        entries.append({"file": name, "kind": "static" if not p.v.any() else "motion", "start": float(p.t[0])})
        noise[name], measured[name] = shown - law.shown(true)[rows], shown
        at_rows[name] = (p.q[rows], p.v[rows], p.a[rows], p.t[rows])
    write_toml(folder / "log.toml", {"format": "energy-opt/log/1", "robot": world.arm, "run": entries})
    declared = PowerModel(world.arm, (Standby(power=drives.standby), CopperLoss(r_over_kt2=list(drives.heat))))
    declared.save(folder / "declared.toml")
    rms, added_rms = float(np.sqrt(np.mean(misfit**2))), float(np.sqrt(np.mean(total**2)))
    values = {**law.values(size), **({"mass": [mass]} if mass else {})}

    def plant(motions: list[Motion]) -> list[np.ndarray]:
        begins = np.cumsum([gaps[-1], *(len(m[0]) * STEP + 10.0 for m in motions)])
        return powers([part(m, b) for m, b in zip(motions, begins[:-1], strict=True)], size, strength)

    return Truth(folder, robot, declared, rms, added_rms, start, values, noise, at_rows, measured, plant, world.sharp)
