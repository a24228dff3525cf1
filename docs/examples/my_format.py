"""A format of your own: plain text with the joints' names in the first line, then the positions of one row a line."""

from pathlib import Path

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.formats import FORMATS, Format, Samples
from energy_opt.motion.trajectory import Trajectory


def read(path: Path) -> Samples:
    """Waypoints of named joints."""
    names, *lines = path.read_text(encoding="utf-8").splitlines()
    try:
        position = np.array([[float(word) for word in line.split()] for line in lines])
    except ValueError as error:
        raise BadInput(f"{path}: {error}") from None
    return Samples(str(path), tuple(names.split()), position)


def write(trajectory: Trajectory, path: Path) -> None:
    """The positions of every row."""
    lines = [" ".join(f"{x:.9g}" for x in row) for row in trajectory.position]
    path.write_text("\n".join([" ".join(trajectory.joints), *lines]) + "\n", encoding="utf-8")


FORMATS["text"] = Format("text", ".joints", "positions as plain text", read, write)
