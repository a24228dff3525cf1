"""A format of your own: plain text with the joints' names in the first line, then one sample a line."""

from pathlib import Path

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.formats import FORMATS, Format, Samples
from energy_opt.motion.trajectory import Trajectory


def read(path: Path) -> Samples:
    """Samples of n named joints: a line has the time [s], and n positions, velocities and accelerations each."""
    names, *lines = path.read_text(encoding="utf-8").splitlines()
    joints = tuple(names.split())
    try:
        numbers = [[float(word) for word in line.split()] for line in lines]
        table = np.array(numbers).reshape(len(lines), 1 + 3 * len(joints))
    except ValueError as error:
        raise BadInput(f"{path}: {error}") from None
    position, velocity, acceleration = np.split(table[:, 1:], 3, axis=1)
    return Samples(str(path), joints, position, table[:, 0], velocity, acceleration)


def write(trajectory: Trajectory, path: Path) -> None:
    """Every sample, with every digit: the file is read back and judged."""
    blocks = trajectory.position, trajectory.velocity, trajectory.acceleration
    table = np.column_stack([trajectory.time, *blocks])
    lines = [" ".join(f"{x:.17g}" for x in row) for row in table]
    path.write_text("\n".join([" ".join(trajectory.joints), *lines]) + "\n", encoding="utf-8")


FORMATS["text"] = Format("text", ".joints", "samples as plain text", read, write)
