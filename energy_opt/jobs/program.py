"""A job's whole cycle as one program for a controller."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from energy_opt.formats import Format, room
from energy_opt.formats.cycle import certificates, without_jumps, write_cycle
from energy_opt.formats.judging import CycleJudging, Judging
from energy_opt.formats.output import Written
from energy_opt.formats.program import Part, joined
from energy_opt.formats.room import Files, Shares
from energy_opt.jobs.run import JobResult
from energy_opt.motion.judge.certificate import Certificate
from energy_opt.motion.limits.registry import joint_limits
from energy_opt.motion.trajectory import Trajectory


def parts_of(result: JobResult) -> list[Part]:
    """The motions and waits of a solved job, in order, with what is carried in the last joint's frame."""
    out, payload = [], result.job.steps[0].payload
    for piece in result.pieces:
        step = result.job.steps[piece.steps[0]] if piece.steps else None
        payload = payload if step is None else step.payload
        waits = piece.source == "wait"
        brakes = waits and (result.plan.rest.brakes if step is None else step.brakes)
        out.append(Part(piece.trajectory, piece.name, waits, "brakes" if brakes else "", payload))
    return out


def whole_cycle(result: JobResult) -> Trajectory:
    """The cycle as one motion; where a jerk limit forbids that the acceleration jumps between steps, it does not."""
    return joined([part.trajectory for part in without_jumps(parts_of(result), result.job.robot.limits)])


def judging_of(result: JobResult) -> CycleJudging:
    """What judges a job's cycle: every stretch under the payload and in the scene of its steps."""
    limits = joint_limits(result.job.robot.limits)
    step, stretches = result.job.steps[0], []
    for piece in result.pieces:
        step = result.job.steps[piece.steps[0]] if piece.steps else step
        judge = Judging(result.scorer(step), limits, result.cells.of(step))
        stretches.append((piece.trajectory.duration, judge))
    return CycleJudging.of(stretches)


def with_room(result: JobResult, files: Files, again: Callable[[Shares], JobResult]) -> JobResult:
    """The job, or one that is planned again so that its cycle as one motion, and what `files` get, hold all limits.

    Args:
        again: plans the job with these shares of the limits' bounds.
    """

    def certificates_of(found: JobResult) -> list[Certificate]:
        judge = judging_of(found)
        return [judge(whole_cycle(found)), *certificates(parts_of(found), judge, files.formats, files.rate)]

    found, shares = room.with_room(result, certificates_of, again)
    if not shares or not found.solved:
        return result
    said = room.said(shares, found.energy - result.energy)
    return replace(found, baselines=result.baselines, bound=result.bound, warnings=(*result.warnings, said))


def write_programs(
    result: JobResult, formats: Sequence[Format], out: Path, rate: float | None = None, prefix: str = ""
) -> list[Written]:
    """Write the cycle in several formats into a folder, as `write_cycle` does."""
    return write_cycle(parts_of(result), judging_of(result), formats, out, rate, prefix)
