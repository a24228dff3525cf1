"""Programs for a controller: motions and waits, and changes of payload."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel
from energy_opt.robot import Robot

Load = tuple[float, float, float, float]  # mass [kg] and its centre [m]


@dataclass(frozen=True)
class Part:
    """A motion from rest to rest, or a wait.

    Attributes:
        trajectory: its samples, from any time on; of a wait, standing ones.
        waits: True for a wait; mode: of the wait, if the motors do not hold the arm.
        payload: mass [kg] and its centre [m] in the last joint's frame, from its beginning on; None: not known.
    """

    trajectory: Trajectory
    name: str = ""
    waits: bool = False
    mode: str = ""
    payload: Load | None = None


def load_of(model: PowerModel) -> Load | None:
    """Payload of a model, with its centre in the last joint's frame; None without a payload."""
    payload = model.get("payload")
    return None if payload is None else (float(payload.values["mass"][0]), *payload.values["com"].tolist())


def in_tool(robot: Robot, load: Load | None) -> Load | None:
    """A payload with its centre in the frame of the link `tool0`, which controllers use; unchanged without it."""
    found = robot.body.link_frames().get("tool0")
    if found is None or load is None:
        return load
    mass, *centre = load
    x, y, z = (np.linalg.inv(found[1]) @ [*centre, 1.0])[:3].tolist()
    return mass, x, y, z
