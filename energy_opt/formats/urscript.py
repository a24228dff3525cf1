"""URScript: a program that runs motions and waits on an arm of Universal Robots.

The program refuses to begin unless the arm is at its start. It then follows the quintics between the points with
`servoj`, one command for every step of the controller (2 ms on the e-series, 8 ms on CB3), at the pace `speed`: 1.0 is
the trajectory as it was planned, and 0.1 a good first try. At 500 Hz the program contains the positions one by one, and
nothing is computed on the controller. The rest of a step at the end of a part is carried into the next, so that a cycle
keeps its time."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from string import Template

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.files import read_text, read_toml, write_text
from energy_opt.formats.controller_program import Part
from energy_opt.formats.resample import of_steps
from energy_opt.formats.waypoints import Samples
from energy_opt.motion.trajectory import Trajectory, joined, standing, whole
from energy_opt.names import commented

JOINTS = 6
NAMES = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")  # of joints in UR's descriptions
NEAR = 0.01  # [rad] largest distance of the arm from the start
LOOKAHEAD, GAIN = 0.03, 500  # [s] look-ahead of servoj, the least that it accepts; a firm but quiet gain
STREAM_RATE = 500.0  # [Hz] of positions that are streamed one by one
STOP = 4.0  # [rad/s^2] deceleration where the program ends or is refused
BRIEF = 0.05  # [s] shorter waits are written as motions at rest
LAST = 0.99  # share of a step: a target this close to a part's end is its end


def vector(values: np.ndarray) -> str:
    """Numbers (n,) as a list of URScript.

    It has fifteen decimals, because the controller's accelerations are differences over 10 us.
    """
    return "[" + ",".join(f"{x:.15f}" for x in values.tolist()) + "]"


@cache
def _texts() -> dict[str, str]:
    """The constant parts of programs by name."""
    return {name: str(text) for name, text in read_toml(Path(__file__).with_name("urscript.toml")).items()}


def lines_of(name: str, **values: object) -> list[str]:
    """Lines of a constant part of programs: "start" (with the arm's START), "quintic" or "rest"."""
    values |= {"JOINTS": JOINTS, "NEAR": NEAR, "LAST": LAST, "STOP": STOP}
    values["SERVO"] = f"servoj(q, 0, 0, dt, {LOOKAHEAD}, {GAIN})"
    return Template(_texts()[name]).substitute(values).splitlines()


def check_start(start: np.ndarray) -> list[str]:
    """Lines that stop the program if the arm is not at `start` (6,)."""
    return lines_of("start", START=vector(start))


def named_otherwise(joints: Sequence[str]) -> bool:
    """Whether the joints' names are not those of an arm of Universal Robots."""
    return not all(name in joint for name, joint in zip(NAMES, joints, strict=True))


def check_arm(joints: int) -> None:
    """Raise BadInput where the arm cannot be one of Universal Robots."""
    if joints != JOINTS:
        raise BadInput(f"--write urscript: for arms of six joints; this one has {joints}")


def streams(trajectory: Trajectory) -> bool:
    """True if the samples are steps of a controller at 500 Hz, to be sent one by one."""
    steps = np.diff(trajectory.time)
    return len(steps) > 1 and bool(np.allclose(steps, 1 / STREAM_RATE, rtol=1e-6))


def write(trajectory: Trajectory, path: Path) -> None:
    """Write a program that follows the samples of a trajectory; evenly spaced ones at 500 Hz are streamed.

    Raises:
        BadInput: the arm does not have six joints.
    """
    write_program([Part(trajectory)], path)


def write_program(parts: Sequence[Part], path: Path) -> None:
    """Write a program of motions and waits, with `set_payload` wherever the payload is another than before.

    Raises:
        BadInput: the arm does not have six joints.
    """
    first, last = parts[0].trajectory, parts[-1].trajectory
    check_arm(len(first.joints))
    streamed = len(parts) == 1 and streams(first)
    lines = [] if streamed else [*lines_of("quintic"), *(lines_of("rest") if any(map(_rests, parts)) else [])]
    payload, flows = None, True  # flows: `t` carries the rest of a step
    for number, part in enumerate(parts, start=1):
        if part.name:
            lines.append(f"  # {number}. {commented(part.name)}")
        if part.payload is not None and part.payload != payload:
            payload = part.payload
            mass, *centre = payload
            lines.append(f"  set_payload({mass:.6f}, {vector(np.array(centre))})")
        if streamed:
            # one servoj for every sample; a slower pace lasts longer at each
            command = f"servoj({{}}, 0, 0, {1 / STREAM_RATE:.9f} / speed, {LOOKAHEAD}, {GAIN})"
            lines += [f"  {command.format(vector(q))}" for q in part.trajectory.position[1:]]
        elif _rests(part):
            if part.mode:
                lines.append(f"  # waits in mode {commented(part.mode)}")
            lines.append(f"  rest({vector(part.trajectory.position[-1])},{part.trajectory.duration:.9f},t,dt,speed)")
            lines.append("  t = dt * speed")
        else:
            lines += _followed(part.trajectory)
        flows = not streamed and not _rests(part)
    goal = f"servoj({vector(last.position[-1])}, 0, 0, dt, {LOOKAHEAD}, {GAIN})"
    end = [f"  if t < {LAST} * dt * speed:", f"    {goal}", "  end"] if flows else []
    write_text(path, "\n".join([*_head(parts), *lines, *end, f"  stopj({STOP})", "end", ""]))


def _rests(part: Part) -> bool:
    """True for a wait in which the servo is left."""
    return part.waits and part.trajectory.duration >= BRIEF


def _head(parts: Sequence[Part]) -> list[str]:
    """The first lines of a program: joints, duration, pace, and the check of the start."""
    seconds = sum(part.trajectory.duration for part in parts)
    return [
        f"# {', '.join(map(commented, parts[0].trajectory.joints))}",
        f"# {seconds:.9f} s from start to end. Run it slowly first: speed = 0.1 in the line below.",
        "def energy_opt_motion():",
        "  local speed = 1.0",
        *check_start(parts[0].trajectory.position[0]),
        "  local dt = get_steptime()",
        "  local t = dt * speed",
    ]


def _followed(trajectory: Trajectory) -> list[str]:
    """Lines with a call of `quintic` for every two neighbouring samples."""
    samples = [(vector(q), vector(v), vector(a)) for q, v, a in zip(
        trajectory.position, trajectory.velocity, trajectory.acceleration, strict=True
    )]  # fmt: skip
    steps = np.diff(trajectory.time)
    return [
        f"  t = quintic({step:.9f},{','.join(before)},{','.join(after)},t,dt,speed)"
        for step, before, after in zip(steps, samples, samples[1:], strict=False)
    ]


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
        """Make a part of the collected samples."""
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
    parts = read_program(path)
    steps = STREAM_RATE if len(parts) == 1 and streams(parts[0].trajectory) else None
    t = joined([part.trajectory for part in parts])
    return Samples(str(path), t.joints, t.position, t.time, t.velocity, t.acceleration, planned=True, steps=steps)


def _numbers(words: str) -> list[float]:
    return [float(word) for word in _NUMBER.findall(words)]
