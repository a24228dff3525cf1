"""A whole cycle as one file for a controller: moves, waits and payloads, read back and judged."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from energy_opt.formats import Format, urscript
from energy_opt.formats.controller_files import STEPS, Written, file_of, not_used, read_back
from energy_opt.formats.controller_program import Part, in_tool
from energy_opt.formats.judging import CycleJudging
from energy_opt.formats.resample import RATES, Sampled, broken, on_steps, resampled
from energy_opt.motion.judge.certificate import ALLOWED, Certificate
from energy_opt.motion.standstills import standstills
from energy_opt.motion.trajectory import NANOSECOND, Trajectory, joined, whole
from energy_opt.robot import Limits

ROOM = 1.05  # factor on the shortest time over which a jump of the acceleration is spread
WIDER = 1.1  # factor on this time until the jerk limits hold
DENSER = 8  # places in each step of the motion at which its jerk is checked
MISSED = 1e-3  # [rad, m] farther than this from the poses between its motions, a cycle is remarked
SAMPLES = 2  # least samples over which it is spread, if the cycle is sampled at a rate


def write_cycle(
    parts: Sequence[Part],
    judge: CycleJudging,
    form: Format,
    out: Path,
    rate: float | None = None,
    prefix: str = "",
    stem: str = "trajectory",
) -> Written:
    """Write a cycle in a format into a folder; the file is read back and judged.

    Args:
        rate: samples per second; None for the judged samples. A cycle keeps its time: where samples at a rate break a
            limit, the lowest of the usual rates that holds is taken.
        prefix: of the joints' names in the file.
        stem: of the file's name.
    """
    robot = judge.scorer.robot
    if form.name == "urscript":
        return _write_program(parts, judge, form, out / file_of(form, None, stem), rate, prefix)
    given, said = parts, ""
    ends = [part.trajectory.position[-1] for part in parts]
    parts, width = without_jumps(parts, robot.limits, None if form.name == "franka" else rate)
    cycle = joined([part.trajectory for part in parts])
    if form.name == "franka":
        pace = STEPS["franka"]
        got = Sampled(on_steps(cycle, pace, robot.limits), pace, not_used(rate, pace))
    elif rate is None:
        got = Sampled(cycle, None)
    else:
        found, why = _holding(rate, lambda r: judge(_at(parts, r)))
        got = Sampled(cycle if found is None else _at(parts, found), found, why)
        if found is not None and len(parts) > 1:
            said = "; each motion is sampled from its own start, a wait by three points"
        shorter = [p.trajectory.duration - end + begin for p, begin, end in _spans(given, got.trajectory) if p.waits]
        if found is not None and width > 0 and shorter:
            said = f"; jumps of the acceleration are spread: waits are up to {1e3 * max(shorter):.3g} ms shorter{said}"
    missed = missed_words(got.trajectory, ends)
    said = f"; {missed}{said}" if missed else said
    path = out / file_of(form, got.rate, stem)
    form.write(_named(got.trajectory, prefix), path)
    row = read_back(path, form, got, judge, prefix, cycle)
    return replace(row, text=row.text + said + _carried(given, got.trajectory))


def _write_program(
    parts: Sequence[Part], judge: CycleJudging, form: Format, path: Path, rate: float | None, prefix: str
) -> Written:
    """Write a program with all payloads; a single motion at the controller's own rate as positions, one by one."""
    robot, cycle = judge.scorer.robot, joined([part.trajectory for part in parts])
    pace = STEPS["urscript"]

    def at(r: float) -> list[Part]:
        if len(parts) > 1 or r != pace:
            return _each_at(parts, r)
        return [replace(parts[0], trajectory=on_steps(cycle, r, robot.limits))]

    def judged(r: float) -> Certificate:
        return judge.of_parts(at(r)) if len(parts) > 1 or r != pace else judge.at_steps(at(r)[0].trajectory, r)

    found, why = (None, "") if rate is None else _holding(rate, judged)
    sampled = parts if found is None else at(found)
    loads = [part.payload for part in parts if part.payload is not None]
    carries = any(load[0] > 0 for load in loads)
    followed = [
        replace(p, trajectory=_named(p.trajectory, prefix), payload=in_tool(robot, p.payload) if carries else None)
        for p in sampled
    ]
    urscript.write_program(followed, path)
    return read_back(path, form, Sampled(joined([p.trajectory for p in sampled]), found, why), judge, prefix, cycle)


def _holding(rate: float, judged: Callable[[float], Certificate]) -> tuple[float | None, str]:
    """The rate [Hz], or the lowest usual one above it, at which samples keep all limits; and why it is not the rate."""
    certificate = judged(rate)
    if certificate.valid:
        return rate, ""
    return next((r for r in RATES if r > rate and judged(r).valid), None), broken(certificate, rate)


def _named(trajectory: Trajectory, prefix: str) -> Trajectory:
    return replace(trajectory, joints=tuple(prefix + joint for joint in trajectory.joints))


def missed_words(cycle: Trajectory, poses: Sequence[np.ndarray]) -> str:
    """How far a cycle as one motion stays from poses (n,) that it passes or stops at; "" if nearer than `MISSED`."""
    far = max(cycle.distances_to(poses), default=0.0)
    said = f"the motion passes poses of steps at distances of up to {far:.2g} rad or m; stops with a wait reach theirs"
    return said if far > MISSED else ""


def certificates(
    parts: Sequence[Part], judge: CycleJudging, formats: Sequence[Format], rate: float | None
) -> list[Certificate]:
    """Certificates of the samples that formats write of a cycle; none if they write the judged samples.

    Args:
        parts: of the cycle, in order. judge: of the cycle. formats: that are asked for.
        rate: [Hz] of the samples; None: those of the plan.
    """
    limits, out = judge.scorer.robot.limits, []
    names = {form.name for form in formats}
    if "franka" in names:
        cycle = joined([part.trajectory for part in without_jumps(parts, limits)[0]])
        out.append(judge.at_steps(on_steps(cycle, STEPS["franka"], limits), STEPS["franka"]))
    if rate is not None and "urscript" in names:
        out.append(judge.of_parts(_each_at(parts, rate)))
    if rate is not None and names - {"franka", "urscript"}:
        out.append(judge(_at(without_jumps(parts, limits, rate)[0], rate)))
    return out


def without_jumps(parts: Sequence[Part], limits: Limits, rate: float | None = None) -> tuple[Sequence[Part], float]:
    """The cycle as one motion without jumps of the acceleration between motions, if a jerk limit forbids them.

    The motion is averaged over some milliseconds, at a rate [Hz] over at least two samples. The longest wait is
    shortened by this time; a cycle without a long enough wait runs faster instead.

    Returns:
        The parts, and the time [s] over which the motion is averaged; 0 if it is not.
    """
    ends = [(a.trajectory.acceleration[-1], b.trajectory.acceleration[0]) for a, b in pairwise(parts)]
    jumps = [float((np.abs(b - a) / limits.jerk).max()) for a, b in ends]  # [s] that each one needs
    if not any(jumps):
        return parts, 0.0
    if max(jumps) <= NANOSECOND:
        return _met(parts, limits), 0.0
    # at both ends of the cycle, where the arm rests
    both = parts[0].trajectory.acceleration[0], parts[-1].trajectory.acceleration[-1]
    shortest = max(*jumps, *(float((np.abs(a) / limits.jerk).max()) for a in both))
    least = max(ROOM * shortest, 0.0 if rate is None else SAMPLES / rate)
    waits = [k for k, part in enumerate(parts) if part.waits]
    longest = max(waits, key=lambda k: parts[k].trajectory.duration, default=None)
    width, moving = float(whole(least)), sum(part.trajectory.duration for part in parts if not part.waits)
    while True:  # beside a jump, the acceleration may change with all the jerk that is allowed
        mean = joined([part.trajectory for part in _shortened(parts, longest, width)]).averaged(width)
        jerk = np.maximum(*(np.abs(x).max(axis=0) for x in (mean.sample_denser(DENSER)[3], mean.jerk_before_samples())))
        if (jerk <= (1 + ALLOWED / 2) * limits.jerk).all() or WIDER * width > moving / 4:
            return [Part(mean)], width
        width = float(whole(WIDER * width))


def _shortened(parts: Sequence[Part], longest: int | None, width: float) -> list[Part]:
    """The parts in `width` s less: the longest wait is shorter, or all motions are faster if it is not long enough."""
    shorter = longest is not None and parts[longest].trajectory.duration > 2 * width
    moving = sum(part.trajectory.duration for part in parts if not part.waits)
    out = []
    for n, part in enumerate(parts):
        t = part.trajectory
        if shorter:
            seconds = t.duration - width if n == longest else t.duration
        else:
            seconds = t.duration if part.waits else t.duration * (1 - width / moving)
        out.append(part if seconds == t.duration else replace(part, trajectory=t.slowed(seconds).on_nanoseconds()))
    return out


def _met(parts: Sequence[Part], limits: Limits) -> Sequence[Part]:
    """Start each motion with the final acceleration of the one before: they differ only by rounding."""
    out = [parts[0]]
    for part in parts[1:]:
        t = part.trajectory
        acceleration = t.acceleration.copy()
        before = out[-1].trajectory.acceleration[-1]
        acceleration[0] = np.where(np.isfinite(limits.jerk), before, acceleration[0])
        out.append(replace(part, trajectory=replace(t, acceleration=acceleration)))
    return out


def _each_at(parts: Sequence[Part], rate: float) -> list[Part]:
    """The parts with every motion sampled at a rate from its own start; waits keep their three points."""
    return [part if part.waits else replace(part, trajectory=resampled(part.trajectory, rate)) for part in parts]


def _at(parts: Sequence[Part], rate: float) -> Trajectory:
    """The cycle with every motion sampled at a rate from its own start."""
    return joined([part.trajectory for part in _each_at(parts, rate)])


def _spans(parts: Sequence[Part], cycle: Trajectory) -> Iterator[tuple[Part, float, float]]:
    """Each part with its begin and end [s] in a file with the motion `cycle`; of a wait, those of its rest there."""
    at, rests = 0.0, standstills(cycle)
    for part in parts:
        begin, end = at, at + part.trajectory.duration
        if part.waits:  # a file without a rest there has one of 0 s
            within = [(max(at, first), min(end, last)) for first, last in rests.tolist()]
            begin, end = max(within, key=lambda span: span[1] - span[0], default=(at, at))
        yield part, begin, max(begin, end)
        at += part.trajectory.duration


def _carried(parts: Sequence[Part], cycle: Trajectory) -> str:
    """Text on data that a file with the motion `cycle` cannot contain: changes of payload, and modes of waits."""
    loads, modes, before = [], [], 0.0
    for part, begin, end in _spans(parts, cycle):
        mass = part.payload[0] if part.payload is not None else 0.0
        if mass != before:
            loads.append(f"{mass:g} kg from {begin:.6g} s on")
        if part.mode:
            modes.append(f"{part.mode} from {begin:.6g} to {end:.6g} s")
        before = mass
    out = f"; it cannot hold payloads, set them yourself: {', '.join(loads)}" if loads else ""
    return out + (f"; it cannot hold modes: {', '.join(modes)}" if modes else "")
