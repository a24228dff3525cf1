"""A circuit that supplies the arms of a cell, by Pinocchio alone: nothing of energy_opt is imported.

Each arm's drives take tau . v + r |tau|^2 from a common link: a capacitor that a rectifier keeps at its lowest voltage
at least, and a braking resistor at its highest at most. The motions are those of `cycle_<robot>.csv`; what else the
robots take (standby, modes) comes from the mains directly.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
from cell_judge import Body, motion

STEP = 2.5e-4  # [s] of the integration
MEAN = 1e-3  # [s] over which a peak is taken
VOLTS = 560.0  # lowest voltage of the link; what it is does not matter
CYCLES = 3  # after which the link's voltage repeats


@dataclass(frozen=True)
class Measured:
    """A cycle at the meter: energy [J], peak power [W], energy in the resistor [J]."""

    energy: float
    peak: float
    lost: float


def cycle_of(cell: dict, folder: Path, r: float, standby: float) -> Measured:
    """What the meter shows for a cell's answer, whose arms have r [W/(N m)^2] and standby [W]."""
    found = json.loads((folder / "job.json").read_text())
    length = cell["cycle_time"]
    time = (np.arange(round(length / STEP)) + 0.5) * length / round(length / STEP)
    step = time[1] - time[0]
    link, mains = np.zeros_like(time), np.zeros_like(time)
    modes = {mode["name"]: mode for mode in cell.get("mode", ())}
    for robot, answer in zip(cell["robot"], found["robots"], strict=True):
        joints, curve, total = motion(folder / f"cycle_{robot['name']}.csv")
        body = Body(robot["robot"], joints, robot.get("base", [0.0] * 6))
        begin = answer["steps"][0]["start"]
        at = np.clip((time - begin) % length, 0, total)
        q, v, a = (curve.derivative(k)(at) if k else curve(at) for k in range(3))
        held, load = np.zeros_like(time), np.zeros_like(time)
        loads = {step["name"]: step["payload"] for step in robot["step"] if "payload" in step}
        mass = next(
            (loads[s["name"]] for s in reversed(answer["steps"]) if s["name"] in loads), robot.get("payload", 0)
        )
        off = np.zeros(len(time), dtype=bool)
        for done in answer["steps"]:
            inside = (time - done["start"]) % length < done["duration"]
            mass = loads.get(done["name"], mass)
            load[inside] = mass
            if done["mode"] not in (None, "motors"):
                mode = modes[done["mode"]]
                (t_in, e_in), (t_out, e_out) = mode.get("enter", (0, 0)), mode.get("leave", (0, 0))
                energy = mode["power"] * (done["duration"] - t_in - t_out) + e_in + e_out
                held[inside] = energy / done["duration"]
                off |= inside
        power = drives(body, load, q[:, body.order], v[:, body.order], a[:, body.order], r)
        link += np.where(off, 0.0, power)
        mains += np.where(off, held, standby)
    supply = cell["supply"]
    low = 0.5 * VOLTS**2  # of a link of one farad; only differences of energy matter
    stored, lost, drawn = low, 0.0, np.zeros_like(time)
    for _ in range(CYCLES):
        lost = 0.0
        for k, power in enumerate(link.tolist()):
            stored -= power * step
            drawn[k] = max(low - stored, 0.0) / step
            stored = max(stored, low)
            over = max(stored - low - supply.get("capacity", 0.0), 0.0)
            lost, stored = lost + over, stored - over
    whole = drawn + mains
    width = max(round(MEAN / step), 1)
    mean = np.convolve(np.concatenate([whole, whole[: width - 1]]), np.full(width, 1 / width), "valid")
    return Measured(float(whole.sum() * step), float(mean.max()), lost)


def drives(body: Body, mass: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, r: float) -> np.ndarray:
    """Power (N,) [W] at the drives of an arm that carries point masses (N,) [kg] at its last joint's frame."""
    model = body.model.copy()
    bare, out = model.inertias[model.njoints - 1].copy(), np.zeros(len(q))
    model.gravity.linear = body.base.rotation.T @ np.array([0, 0, -9.81])
    for carried in np.unique(mass):
        model.inertias[model.njoints - 1] = bare + pin.Inertia(float(carried), np.zeros(3), np.zeros((3, 3)))
        data = model.createData()
        for k in np.flatnonzero(mass == carried):
            torque = pin.rnea(model, data, q[k], v[k], a[k])
            out[k] = torque @ v[k] + r * torque @ torque
    return out
