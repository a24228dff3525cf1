"""The work of `evaluate`: energies of given motions and of simple timings of their paths, under every model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.effects import Payload
from energy_opt.errors import Infeasible
from energy_opt.evaluations.source import Recorded, Stretch
from energy_opt.formats.controller_program import Load, Part
from energy_opt.formats.judging import CycleJudging, Judging
from energy_opt.motion.judge.certificate import ALLOWED, Certificate
from energy_opt.motion.judge.energy import Energy, Past, Scorer
from energy_opt.motion.limits.registry import joint_limits
from energy_opt.motion.path import of_trajectory
from energy_opt.motion.plan.choice import within_limits
from energy_opt.motion.plan.robust_models import Rival
from energy_opt.motion.retime.fastest import minimum_time
from energy_opt.motion.timing.spline_timing import Timing
from energy_opt.motion.trajectory import Trajectory, standing, whole
from energy_opt.robot import Robot

SHORT = 1e-7  # [s] shorter stretches are rounding errors, and belong to the next one
BESIDE = 0.03  # [s] longest time over which a cycle's accelerations are spread: two samples at 100 Hz, and a step
LOOKS = 121  # instants around the end of a step at which the speed is looked at
SPREAD = 0.02  # share of the top speed below which the arm stops there, with accelerations spread over milliseconds
AT_REST = 1e-6  # [rad/s] slower waits may be left to the servo by a program


@dataclass(frozen=True)
class Baseline:
    """The same paths in another timing, waits kept: "toppra", each motion at its fastest, or "scaled", slowed evenly.

    `energies`: J by model; `valid`: within all limits, and the motion, whose paths it has, is clear of all bodies.
    """

    name: str
    duration: float
    energies: dict[str, float]
    valid: bool


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Result for one motion.

    Attributes:
        energies: under each model, by its name.
        certificate: limits and clearance; its peak power is the first model's.
        baselines: where the paths have a timing within the limits; `remark` says why there are none.
        parts: the motion as parts of a program; judge: judges these parts.
    """

    motion: Recorded
    energies: dict[str, Energy]
    certificate: Certificate
    baselines: tuple[Baseline, ...]
    remark: str
    parts: tuple[Part, ...]
    judge: CycleJudging


def evaluate(
    robot: Robot, motion: Recorded, rivals: Sequence[Rival], cells: Callable[[Path | None], Cell | None],
    payload: bool = False,
) -> Evaluation:  # fmt: skip
    """Energy of a given motion by effect, under every model; limits, clearance and baselines.

    Args:
        rivals: the models, with the payload that holds if the motion's file states none.
        cells: obstacles that must not be touched in the scene of a file, or of the request; None to check nothing.
        payload: True to use the models' payload, whatever the file states.
    """
    limits = joint_limits(robot.limits)
    intervals = _intervals(motion, payload)
    scorers = {rival.name: _scorers(robot, rival) for rival in rivals}
    given = [(part_of(motion.trajectory, i.start, i.end), i) for i in intervals]
    energies = {name: _energy(of, given) for name, of in scorers.items()}
    first = scorers[rivals[0].name]
    ends = [0.0, *(i.end for i in intervals)]
    judge = CycleJudging.of(
        ((end - start, first(i), cells(i.scene)) for i, start, end in zip(intervals, ends, ends[1:], strict=False)),
        measured=True,
    )
    steps = motion.steps
    certificate = judge.of_motions(motion.trajectory) if steps is None else judge.at_steps(motion.trajectory, steps)
    if motion.unseen and certificate.clear:
        certificate = replace(certificate, clearance=None)
    # the motion's samples keep the position limits; the spline through them may exceed a limit that they only touch
    kept = (certificate.max_violation["position"] or 0.0) <= ALLOWED
    timed = tuple(limit for limit in limits if not (kept and limit.name == "position"))
    try:
        found = _baselines(robot, motion, intervals, scorers, timed)
        baselines, remark = tuple(replace(b, valid=b.valid and certificate.clear) for b in found), ""
    except Infeasible as error:
        baselines, remark = (), str(error)
    return Evaluation(motion, energies, certificate, baselines, remark, _parts(motion, intervals), judge)


def part_of(trajectory: Trajectory, start: float, end: float) -> Trajectory:
    """The part of a trajectory between two times, both included; its time starts at 0.

    If the acceleration jumps at an end, the part has the one on its own side of the jump.

    Args:
        trajectory: the whole. start, end: [s] from its first sample.
    """
    time = trajectory.time - trajectory.time[0]
    inner = time[(time > start + SHORT) & (time < end - SHORT)]
    begin = time[(time >= start) & (time <= start + SHORT)].max(initial=start)
    finish = time[(time >= end - SHORT) & (time <= end)].min(initial=end)
    q, v, a, _ = trajectory.sample(trajectory.time[0] + np.concatenate([[begin], inner, [finish]]))
    return Trajectory(trajectory.joints, whole(np.concatenate([[start], inner, [end]]) - start), q, v, a)


def _scorers(robot: Robot, rival: Rival) -> Callable[[Stretch], Scorer]:
    """Scorers of a model by load and brakes; each is built once."""
    kept: dict[tuple[Load | None, bool], Scorer] = {}

    def of(interval: Stretch) -> Scorer:
        load, brakes = key = interval.load, interval.brakes
        if key not in kept:
            model = rival.model.overhead if brakes else rival.model
            if load is not None and load[0] > 0:
                model = model.for_move(Payload(mass=load[0], com=list(load[1:])))
            kept[key] = Scorer(robot, model)
        return kept[key]

    return of


def _intervals(motion: Recorded, payload: bool) -> list[Stretch]:
    """Cut the motion where it starts or stops, and where the load changes.

    In a cycle with accelerations spread over milliseconds, motions start and stop slightly earlier or later than its
    steps state: changes of load are moved into the waits.
    """
    end = motion.trajectory.duration
    marks = {0.0, end, *motion.waits.ravel().tolist()}
    motion = replace(motion, stretches=_with_ends_in_waits(motion))
    top = float(np.abs(motion.trajectory.velocity).max())
    for before, after in zip(motion.stretches, motion.stretches[1:], strict=False):
        near = np.clip(after.start + np.linspace(-BESIDE, BESIDE, LOOKS), 0.0, end)
        speed = np.abs(motion.trajectory(motion.trajectory.time[0] + near, 1)).max(axis=1).min()
        if replace(before, start=after.start, end=after.end) != after or speed <= SPREAD * top:
            marks.add(after.start)
    points = [0.0]
    for mark in sorted(mark for mark in marks if mark < end - SHORT):
        points += [mark] if mark > points[-1] + SHORT else []
    out = []
    for a, b in pairwise([*points, end]):
        middle = (a + b) / 2
        stretch = next((s for s in motion.stretches if s.start <= middle <= s.end), motion.stretches[-1])
        resting = bool(((motion.waits[:, 0] < middle) & (middle < motion.waits[:, 1])).any())
        out.append(Stretch(a, b, None if payload else stretch.load, stretch.brakes and resting, resting, stretch.scene))
    return out


def _with_ends_in_waits(motion: Recorded) -> tuple[Stretch, ...]:
    """The stretches; their ends that lie a few milliseconds outside a wait are moved to its end."""
    edges = motion.waits.ravel()

    def moved(time: float) -> float:
        waits = bool(((motion.waits[:, 0] <= time) & (time <= motion.waits[:, 1])).any())
        if waits or not len(edges):
            return time
        nearest = float(edges[np.argmin(np.abs(edges - time))])
        return nearest if abs(nearest - time) < BESIDE else time

    return tuple(replace(s, start=moved(s.start), end=moved(s.end)) for s in motion.stretches)


def _energy(of: Callable[[Stretch], Scorer], parts: Sequence[tuple[Trajectory, Stretch]]) -> Energy:
    """Energy of the parts of a motion, in order."""
    past, energies = Past(), []
    for trajectory, interval in parts:
        energy, past = of(interval).energy_after(past, trajectory)
        energies.append(energy)
    names = dict.fromkeys(name for energy in energies for name in energy.by_effect)
    by_effect = {name: sum(energy.by_effect.get(name, 0.0) for energy in energies) for name in names}
    sums = {part: sum(getattr(e, part) for e in energies) for part in ("total", "standby", "stored", "loss")}
    return Energy(**sums, by_effect=by_effect)


def _baselines(
    robot: Robot,
    motion: Recorded,
    intervals: Sequence[Stretch],
    scorers: dict[str, Callable[[Stretch], Scorer]],
    limits: Sequence,
) -> tuple[Baseline, ...]:
    """The same paths at their fastest, and slowed evenly to the time that each motion takes.

    Raises:
        Infeasible: a path breaks limits at any timing.
    """
    first = next(iter(scorers.values()))
    timings = {
        i: minimum_time(robot, first(i).model, path, limits)
        for i in intervals
        if not i.resting and (path := of_trajectory(_stopping(motion.trajectory, i))).moves
    }
    out = []
    for name in ("toppra", "scaled"):
        parts, valid = [], True
        for i in intervals:
            seconds = i.end - i.start
            trajectory = part_of(motion.trajectory, i.start, i.end)
            if i in timings:
                judge = Judging(first(i), tuple(limits))
                fastest = within_limits(timings[i], partial(_judged, judge))
                timing = fastest if name == "toppra" else fastest.slowed(seconds)
                trajectory = timing.trajectory(robot.joints)
                valid = valid and judge(trajectory).within_limits
            parts.append((trajectory, i))
        duration = sum(trajectory.duration for trajectory, _ in parts)
        energies = {model: _energy(of, parts).total for model, of in scorers.items()}
        out.append(Baseline(name, duration, energies, valid))
    return tuple(out)


def _judged(judge: Judging, timing: Timing) -> Certificate:
    return judge(timing.trajectory(judge.scorer.robot.joints))


def _stopping(trajectory: Trajectory, interval: Stretch) -> Trajectory:
    """A part of a motion, at rest at the ends where it was cut."""
    part = part_of(trajectory, interval.start, interval.end)
    velocity = part.velocity.copy()
    velocity[0] *= interval.start <= 0
    velocity[-1] *= interval.end >= trajectory.duration
    return replace(part, velocity=velocity)


def _parts(motion: Recorded, intervals: Sequence[Stretch]) -> tuple[Part, ...]:
    """The motion as motions and waits of a program."""
    out = []
    for i in intervals:
        trajectory = part_of(motion.trajectory, i.start, i.end)
        waits = i.resting and bool(np.abs(trajectory.velocity).max() < AT_REST)
        if waits:
            trajectory = standing(trajectory.joints, trajectory.position[-1], i.end - i.start)
        out.append(Part(trajectory, "", waits, "brakes" if i.brakes else "", i.load))
    return tuple(out)
