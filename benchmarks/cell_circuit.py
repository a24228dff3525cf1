"""Cells on one supply, at a meter: MuJoCo arms on a capacitor and a resistor; nothing of energy_opt is imported.

    python benchmarks/cell_circuit.py [--out FOLDER] [--only NAME]

Each arm of an answer follows its `cycle_<robot>.csv` in a forward simulation. Its drives take tau . v + r tau^2 from
the link that all arms share: a capacitor that a rectifier feeds from its lowest voltage on, and a resistor that is
switched on at its highest. What else the robots take (standby, modes) comes from the mains directly. Printed are
energy, peak and lost energy at the meter, beside what `job.json` says.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time as clock
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import tomli_w
from cell_judge import URDF, base_of, motion

STEP = 5e-4  # [s] of the arms' simulation
FINE = 1e-5  # [s] of the circuit's
MEAN = 1e-3  # [s] over which a peak is taken
LOW, HIGH = 560.0, 700.0  # [V] lowest voltage of the link, and that at which the resistor is switched on
SOURCE, BRAKE = 0.1, 20.0  # [ohm] of the rectifier and of the resistor
CYCLES = 3  # after which the link's voltage repeats
FREQUENCY, DAMPING = 60.0, 1.0  # [rad/s] of the arms' position control
CLOSE = 0.01  # of the energy

Law = tuple[list[float], float]  # [W/(N m)^2] of every joint, and standby [W]


@dataclass(frozen=True)
class Measured:
    """A cycle at the meter: energy [J], peak power [W], energy in the resistor [J], largest error [rad]."""

    energy: float
    peak: float
    lost: float
    error: float


class SimulatedArm:
    """An arm of MuJoCo on its base, held by fixed fingers, that carries a point mass at its last joint's frame."""

    def __init__(self, robot: str, joints: list[str], base: list[float], mass: float) -> None:
        root = ET.parse(URDF[robot]).getroot()
        for link in root.findall("link"):
            for shape in (*link.findall("visual"), *link.findall("collision")):
                link.remove(shape)
        for joint in root.findall("joint"):
            if joint.get("name") not in joints:
                joint.set("type", "fixed")
        last = next(j for j in root.findall("joint") if j.get("name") == joints[-1])
        held = ET.SubElement(ET.SubElement(root, "link", name="held"), "inertial")
        ET.SubElement(held, "mass", value=repr(max(mass, 1e-9)))
        ET.SubElement(held, "inertia", dict.fromkeys(("ixx", "iyy", "izz"), "1e-9"), ixy="0", ixz="0", iyz="0")
        weld = ET.SubElement(root, "joint", name="holds", type="fixed")
        ET.SubElement(weld, "parent", link=last.find("child").get("link"))
        ET.SubElement(weld, "child", link="held")
        compiler = ET.SubElement(ET.SubElement(root, "mujoco"), "compiler")
        compiler.attrib |= {"fusestatic": "true", "balanceinertia": "false", "boundmass": "0", "boundinertia": "0"}
        self.model = mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))
        self.model.opt.gravity[:] = base_of(*base).rotation.T @ np.array([0, 0, -9.81])
        self.model.opt.timestep = STEP
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        self.model.dof_damping[:] = self.model.dof_frictionloss[:] = 0.0
        self.data = mujoco.MjData(self.model)
        names = [mujoco.mj_id2name(self.model, mujoco.mjtObj.mjOBJ_JOINT, k) for k in range(self.model.njnt)]
        self.order = [joints.index(str(name)) for name in names]

    def follow(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Torque and velocity (N, n) at the joints while they follow q, v, a (N, n); the largest error [rad]."""
        data, back = self.data, np.argsort(self.order)
        data.qpos[:], data.qvel[:] = q[0][self.order], v[0][self.order]
        torque, speed, error = np.zeros_like(q), np.zeros_like(q), 0.0
        stiff = FREQUENCY**2, 2 * DAMPING * FREQUENCY
        for k in range(len(q)):
            off, fast = q[k][self.order] - data.qpos, v[k][self.order] - data.qvel
            error = max(error, float(np.abs(off).max()))
            data.qacc[:] = a[k][self.order] + stiff[0] * off + stiff[1] * fast
            mujoco.mj_inverse(self.model, data)
            data.qfrc_applied[:] = data.qfrc_inverse
            torque[k], before = data.qfrc_inverse[back], data.qvel.copy()
            mujoco.mj_step(self.model, data)
            speed[k] = ((before + data.qvel) / 2)[back]
        return torque, speed, error


def cycle_of(cell: dict, folder: Path, laws: dict[str, Law]) -> Measured:
    """What the meter shows for a cell's answer.

    Args:
        cell: the job file as it was asked for; folder: what the answer was written into.
        laws: of every robot's drives, by the robot's name.
    """
    found = json.loads((folder / "job.json").read_text())
    length, count = cell["cycle_time"], round(cell["cycle_time"] / STEP)
    time = np.arange(count) * length / count
    link, mains, error = np.zeros(count), np.zeros(count), 0.0
    for robot, answer in zip(cell["robot"], found["robots"], strict=True):
        resistance, standby = laws[robot["name"]]
        mass, held = carried(robot, answer, time, length), kept(cell, robot, answer, time, length)
        joints, curve, total = motion(folder / f"cycle_{robot['name']}.csv")
        at = np.clip((time - answer["steps"][0]["start"]) % length, 0, total)
        q, v, a = (curve.derivative(k)(at) if k else curve(at) for k in range(3))
        power = np.zeros(count)
        for part in np.split(np.arange(count), np.flatnonzero(np.diff(mass)) + 1):
            arm = SimulatedArm(robot["robot"], joints, robot.get("base", [0.0] * 6), float(mass[part[0]]))
            torque, speed, off = arm.follow(q[part], v[part], a[part])
            power[part] = np.sum(torque * speed + np.array(resistance) * torque**2, axis=1)
            error = max(error, off)
        link += np.where(np.isnan(held), power, 0.0)
        mains += np.where(np.isnan(held), standby, held)
    drawn, lost = circuit(link, length / count, cell["supply"].get("capacity", 0.0))
    whole = drawn + mains
    width = max(round(MEAN / (length / count)), 1)
    mean = np.convolve(np.concatenate([whole, whole[: width - 1]]), np.full(width, 1 / width), "valid")
    return Measured(float(whole.mean() * length), float(mean.max()), lost, error)


def carried(robot: dict, answer: dict, time: np.ndarray, length: float) -> np.ndarray:
    """Mass (N,) [kg] at the arm's end."""
    loads = {step["name"]: step["payload"] for step in robot["step"] if "payload" in step}
    names = [step["name"] for step in answer["steps"]]
    now = next((loads[name] for name in reversed(names) if name in loads), robot.get("payload", 0.0))
    out = np.zeros(len(time))
    for step in answer["steps"]:
        now = loads.get(step["name"], now)
        out[(time - step["start"]) % length < step["duration"]] = now
    return out


def kept(cell: dict, robot: dict, answer: dict, time: np.ndarray, length: float) -> np.ndarray:
    """Power (N,) [W] from the mains while a robot waits in a mode; nan while its drives are on."""
    modes = {mode["name"]: mode for mode in (*cell.get("mode", ()), *robot.get("mode", ()))}
    out = np.full(len(time), np.nan)
    for step in answer["steps"]:
        if step["mode"] in modes:
            mode = modes[step["mode"]]
            (t_in, e_in), (t_out, e_out) = mode.get("enter", (0, 0)), mode.get("leave", (0, 0))
            energy = mode["power"] * (step["duration"] - t_in - t_out) + e_in + e_out
            out[(time - step["start"]) % length < step["duration"]] = energy / step["duration"]
    return out


def circuit(power: np.ndarray, step: float, capacity: float) -> tuple[np.ndarray, float]:
    """Power (N,) [W] from the rectifier under drives' power (N,) [W]; energy in the resistor over a cycle [J].

    The capacitor stores `capacity` [J] between its two voltages: c u du/dt = u (rectifier - resistor) - power.
    """
    c = 2 * max(capacity, 0.05) / (HIGH**2 - LOW**2)
    fine = max(round(step / FINE), 1)
    dt, volts, lost = step / fine, LOW, 0.0
    drawn = np.zeros(len(power))
    for _ in range(CYCLES):
        lost = 0.0
        for k, watts in enumerate(power.tolist()):
            source = 0.0
            for _ in range(fine):
                amps = max(LOW - volts, 0.0) / SOURCE
                braked = volts / BRAKE if volts > HIGH else 0.0
                source += LOW * amps
                lost += volts * braked * dt
                volts += dt * (amps - braked - watts / volts) / c
            drawn[k] = source / fine
    return drawn, lost


PANDA: Law = ([0.0036] * 7, 88.04)
UR: Law = ([0.001, 0.001, 0.002, 0.006, 0.006, 0.006], 120.0)


def two_pandas() -> tuple[dict, dict[str, Law]]:
    """Two Pandas that pick over one table."""
    near, far = [0.0, 0.5, 0.0, -1.6, 0.0, 2.1, 0.7], [1.5, 0.0, 0.0, -1.9, 0.0, 2.2, 0.7]
    steps = [
        {"name": "pick", "to": near, "payload": 0.0},
        {"name": "grip", "wait": 0.5},
        {"name": "place", "to": far, "payload": 2.0},
    ]
    robots = [
        {"name": "a", "robot": "panda", "base": [0.0] * 6, "step": steps},
        {"name": "b", "robot": "panda", "base": [0.9, 0.0, 0.0, 0.0, 0.0, float(np.pi)], "step": steps},
    ]
    supply = {"shared": True, "capacity": 20.0, "max_power": 600.0}
    return {"cycle_time": 6.0, "supply": supply, "robot": robots}, {"a": PANDA, "b": PANDA}


def lifters() -> tuple[dict, dict[str, Law]]:
    """A UR10e and a Panda that lift loads quickly: much is braked; brakes to wait in."""
    robots = [
        {"name": "a", "robot": "ur10e", "base": [0.0] * 6, "step": [
            {"name": "up", "to": [0.0, -1.9, 1.2, -0.9, -1.57, 0.0], "payload": 6.0, "max_duration": 1.3},
            {"name": "down", "to": [0.4, -0.7, 1.5, -2.3, -1.57, 0.0], "max_duration": 1.3},
        ]},
        {"name": "b", "robot": "panda", "base": [2.2, 0.0, 0.0, 0.0, 0.0, 1.0], "step": [
            {"name": "up", "to": [0.0, -0.5, 0.0, -1.6, 0.0, 1.7, 0.7], "payload": 2.0, "max_duration": 1.2},
            {"name": "down", "to": [0.5, 0.7, 0.0, -1.5, 0.0, 2.2, 0.7], "max_duration": 1.2},
        ]},
    ]  # fmt: skip
    brakes = {"name": "brakes", "power": 60.0, "least": 0.8, "enter": [0.2, 10.0], "leave": [0.3, 20.0]}
    supply = {"shared": True, "capacity": 10.0, "max_power": 900.0}
    return {"cycle_time": 5.0, "supply": supply, "mode": [brakes], "robot": robots}, {"a": UR, "b": PANDA}


CELLS = {"two-pandas": two_pandas, "lifters": lifters}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path(tempfile.gettempdir()) / "cell_circuit")
    parser.add_argument("--only", choices=CELLS)
    args = parser.parse_args()
    good = True
    for name in [args.only] if args.only else CELLS:
        cell, laws = CELLS[name]()
        folder = args.out / name
        folder.mkdir(parents=True, exist_ok=True)
        for robot in cell["robot"]:
            robot["model"] = write_model(folder, robot, laws[robot["name"]])
        file, out = folder / "cell.toml", folder / "out"
        file.write_bytes(tomli_w.dumps({"format": "energy-opt/job/2", **cell}).encode())
        begin = clock.monotonic()
        command = [sys.executable, "-m", "energy_opt", "job", file, "--out", out, "--starts", "1", "--force", "--quiet"]
        done = subprocess.run(command, check=False)
        print(f"{name}: exit {done.returncode}, {clock.monotonic() - begin:.0f} s")
        if done.returncode:
            good = False
            continue
        found, meter = json.loads((out / "job.json").read_text()), cycle_of(cell, out, laws)
        supply = found["supply"]
        off = meter.energy / found["energy_total"] - 1
        print(f"  each its own supply {supply['energy_own']:.1f} J, lost {supply['lost_own']:.1f} J, "
              f"peak {supply['peak_own']:.1f} W")  # fmt: skip
        print(f"  one supply {supply['energy']:.1f} J, lost {supply['lost']:.1f} J, peak {supply['peak']:.1f} W")
        print(f"  at the meter {meter.energy:.1f} J ({100 * off:+.2f} %), lost {meter.lost:.1f} J, "
              f"peak {meter.peak:.1f} of {supply['max_power']:.0f} W; arms off by {meter.error:.1e} rad")  # fmt: skip
        good &= abs(off) < CLOSE and meter.peak <= supply["max_power"]
    return 0 if good else 1


def write_model(folder: Path, robot: dict, law: Law) -> str:
    """Write a robot's power model beside the job file; returns the file's name."""
    effects = [{"name": "standby", "power": law[1]}, {"name": "copper_loss", "r_over_kt2": law[0]}]
    document = {"format": "energy-opt/model/1", "robot": robot["robot"], "effect": effects}
    (folder / f"{robot['name']}.toml").write_bytes(tomli_w.dumps(document).encode())
    return f"{robot['name']}.toml"


if __name__ == "__main__":
    sys.exit(main())
