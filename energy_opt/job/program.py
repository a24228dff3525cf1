"""A job's whole cycle as one program for a controller: moves, waits and payloads, read back and judged step by step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from energy_opt.formats import Format, urscript
from energy_opt.formats.output import STEPS, Judging, Written, file_of, read_back
from energy_opt.formats.program import Part, in_tool, joined
from energy_opt.formats.resample import Sampled, broken, lowest, resampled
from energy_opt.formats.steps import on_steps
from energy_opt.job.run import JobResult
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
        out.append(Part(piece.trajectory, piece.name, waits, brakes, payload))
    return out


@dataclass(frozen=True)
class Window:
    """A stretch of the cycle in which payload and scene stay, from `start` to `end` s, and what judges it."""

    start: float
    end: float
    judge: Judging


class CycleJudging(Judging):
    """Judges a whole cycle: every stretch under the payload and in the scene of its steps."""

    windows: tuple[Window, ...]

    @classmethod
    def of(cls, result: JobResult) -> CycleJudging:
        """What judges a job's cycle."""
        limits = joint_limits(result.job.robot.limits)
        windows: list[Window] = []
        at, key, step = 0.0, None, result.job.steps[0]
        for piece in result.pieces:
            step = result.job.steps[piece.steps[0]] if piece.steps else step
            end = at + piece.trajectory.duration
            if windows and key == (step.payload, step.scene):
                windows[-1] = replace(windows[-1], end=end)
            else:
                windows.append(Window(at, end, Judging(result.scorer(step), limits, result.cells.of(step))))
            at, key = end, (step.payload, step.scene)
        out = cls(windows[0].judge.scorer, limits)
        object.__setattr__(out, "windows", tuple(windows))
        return out

    def __call__(self, trajectory: Trajectory) -> Certificate:
        return self._over(trajectory, lambda judge, part: judge(part))

    def at_steps(self, trajectory: Trajectory, rate: float) -> Certificate:
        return self._over(trajectory, lambda judge, part: judge.at_steps(part, rate))

    def joules(self, trajectory: Trajectory) -> float:
        return sum(window.judge.joules(_part(trajectory, window)) for window in self.windows)

    def _over(self, trajectory: Trajectory, look: Callable[[Judging, Trajectory], Certificate]) -> Certificate:
        """The worst of all stretches under each limit."""
        found: dict[str, list] = {}
        certificates = []
        for window in self.windows:
            part = _part(trajectory, window)
            certificates.append(look(window.judge, part))
            for violation in certificates[-1].found:
                later = replace(violation, time=violation.time + float(part.time[0] - trajectory.time[0]))
                found.setdefault(violation.limit, []).append(later)
        worst = tuple(max(places, key=lambda v: float("inf") if v.excess is None else v.excess)
                      for places in found.values())  # fmt: skip
        clearances = [c.clearance for c in certificates if c.clearance is not None]
        clearance = next((c for c in clearances if not c.proven), clearances[0] if clearances else None)
        samples, power = sum(c.samples for c in certificates), max(c.peak_power for c in certificates)
        return Certificate(samples, worst, power, clearance)


def _part(trajectory: Trajectory, window: Window) -> Trajectory:
    """The rows of a stretch, with those just outside of it."""
    time = trajectory.time - trajectory.time[0]
    first = max(int(time.searchsorted(window.start + 1e-9, side="right")) - 1, 0)
    last = int(time.searchsorted(window.end - 1e-9))
    return trajectory.part(slice(min(first, len(time) - 2), min(max(last, first + 1), len(time) - 1) + 1))


def write_programs(
    result: JobResult, formats: Sequence[Format], out: Path, rate: float | None = None, prefix: str = ""
) -> list[Written]:
    """Write the cycle in several formats into a folder; each file is read back and judged.

    Args:
        rate: samples per second; None for the judged rows. A cycle keeps its time: where samples at a rate break a
            limit, the lowest of the usual rates that holds is taken.
        prefix: what stands before the joints' names in the files.
    """
    parts, judge = parts_of(result), CycleJudging.of(result)
    cycle = joined([part.trajectory for part in parts])
    return [_written(form, parts, cycle, judge, out, rate, prefix) for form in formats]


def _written(
    form: Format, parts: Sequence[Part], cycle: Trajectory, judge: CycleJudging, out: Path, rate: float | None,
    prefix: str,
) -> Written:  # fmt: skip
    robot = judge.scorer.robot

    def named(trajectory: Trajectory) -> Trajectory:
        return replace(trajectory, joints=tuple(prefix + joint for joint in trajectory.joints))

    if form.name == "urscript":
        loads = [part.payload for part in parts if part.payload is not None]
        carries = any(load[0] > 0 for load in loads)
        followed = [
            replace(
                part,
                trajectory=named(part.trajectory if part.waits or rate is None else resampled(part.trajectory, rate)),
                payload=in_tool(robot, part.payload) if carries and part.payload is not None else None,
            )
            for part in parts
        ]
        got = Sampled(cycle, rate)
        path = out / file_of(form, None)
        urscript.write_program(followed, path)
        row = read_back(path, form, got, judge, prefix, cycle)
        if row.valid or rate is None:
            return row
        why = broken(judge(resampled(cycle, rate)), rate)
        again = _written(form, parts, cycle, judge, out, None, prefix)
        return replace(again, text=f"{again.text}; {why}")
    if form.name == "franka":
        got = Sampled(on_steps(cycle, STEPS["franka"], robot.limits), STEPS["franka"])
    elif rate is None:
        got = Sampled(cycle, None)
    else:
        certificate = judge(resampled(cycle, rate))
        found = rate if certificate.valid else lowest(cycle, judge, above=rate)
        why = "" if certificate.valid else broken(certificate, rate)
        got = Sampled(cycle if found is None else resampled(cycle, found), found, why)
    path = out / file_of(form, got.rate)
    form.write(named(got.trajectory), path)
    row = read_back(path, form, got, judge, prefix, cycle)
    return replace(row, text=row.text + _carried(parts))


def _carried(parts: Sequence[Part]) -> str:
    """What such a file cannot say: when which payload is to be set."""
    out, at, before = [], 0.0, 0.0
    for part in parts:
        mass = part.payload[0] if part.payload is not None else 0.0
        if mass != before:
            out.append(f"{mass:g} kg from {at:.6g} s on")
        at, before = at + part.trajectory.duration, mass
    return f"; it holds no payloads, set them yourself: {', '.join(out)}" if out else ""
