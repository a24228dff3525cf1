"""The programs of `urscript` read back: what the commands in them come to, whatever was meant to be written."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.files import read_text
from energy_opt.formats.program import Part, joined, standing
from energy_opt.formats.steps import of_steps
from energy_opt.formats.urscript import JOINTS, STREAM_RATE
from energy_opt.formats.waypoints import Samples
from energy_opt.motion.trajectory import Trajectory, whole

_CALL = re.compile(r"^  (?:t = )?(quintic|rest|servoj|set_payload|movej)\((.*)\)$", re.M)
_NUMBER = re.compile(r"-?\d+\.?\d*(?:e-?\d+)?")
_NAMES = re.compile(r"^# (.*)$", re.M)


def read_program(path: Path) -> list[Part]:
    """The parts of a program: motions, and waits with what is carried; joint names from its first line.

    Raises:
        BadInput: it is no program that `urscript` writes.
    """
    text = read_text(path)
    named = _NAMES.search(text)
    joints = tuple((named[1] if named else "").split(", "))
    start = re.search(r"local start = (\[.*\])", text)
    if len(joints) != JOINTS or start is None:
        raise BadInput(f"{path}: not a program of this package: no line with six joints, or no start")
    out: list[Part] = []
    at, payload = np.array(_numbers(start[1])), None
    samples: list[np.ndarray] = []
    times: list[float] = []
    stream: list[np.ndarray] = []

    def end() -> None:
        """What was collected becomes a part."""
        nonlocal samples, times, stream
        if samples:
            block = np.array(samples)  # (N, 3, n)
            out.append(Part(Trajectory(joints, whole(np.array(times)), *block.transpose(1, 0, 2)), payload=payload))
        elif stream:
            out.append(Part(of_steps(joints, np.array(stream), STREAM_RATE), payload=payload))
        samples, times, stream = [], [], []

    for name, words in _CALL.findall(text):
        numbers = _numbers(words)
        if name == "quintic" and len(numbers) == 1 + 6 * JOINTS:
            step, (first, last) = numbers[0], np.reshape(numbers[1:], (2, 3, JOINTS))
            if samples and np.abs(first - samples[-1]).max() > 0:
                end()
            if not samples:
                samples, times = [first], [0.0]
            samples.append(last)
            times.append(times[-1] + step)
            at = last[0]
        elif name == "servoj":
            stream = stream or [at]
            stream.append(np.array(numbers[:JOINTS]))
        elif name == "rest":
            end()
            out.append(Part(standing(joints, at, numbers[JOINTS]), waits=True, payload=payload))
        elif name == "set_payload":
            end()
            mass, x, y, z = numbers
            payload = (mass, x, y, z)
        else:
            raise BadInput(
                f"{path}: {name}({words[:40]}...): not a command of a followed motion; expected quintic, servoj, rest "
                "or set_payload (of standard moves, give the trajectory.csv beside the program)"
            )
    end()
    if not out:
        raise BadInput(f"{path}: no motion in it")
    return out


def read(path: Path) -> Samples:
    """All motions and waits of a program as one."""
    t = joined([part.trajectory for part in read_program(path)])
    return Samples(str(path), t.joints, t.position, t.time, t.velocity, t.acceleration)


def _numbers(words: str) -> list[float]:
    return [float(word) for word in _NUMBER.findall(words)]
