"""The cycle as one motion that is judged and written as programs, and all files of a job."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt import formats
from energy_opt.files import plain, write_json
from energy_opt.formats import Format, controller_files
from energy_opt.formats.controller_files import Shares, Written, files_from, unchanged, warnings_on
from energy_opt.formats.cycle_file import certificates, missed_words, without_jumps, write_cycle
from energy_opt.formats.judging import CycleJudging
from energy_opt.jobs.cycle import Piece
from energy_opt.jobs.legs import Step
from energy_opt.jobs.solve_job import JobResult
from energy_opt.motion.judge.certificate import Certificate
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.trajectory import Trajectory, joined, whole
from energy_opt.poses.given import pose_document
from energy_opt.power.per_year import PerYear
from energy_opt.reports.job import page
from energy_opt.reports.job import table as table
from energy_opt.results import interrupted_words

CYCLE = "cycle.csv"


def whole_cycle(result: JobResult) -> tuple[Trajectory, str]:
    """The cycle as one motion, and how it differs from the steps; "" if it does not.

    If a jerk limit forbids jumps of the acceleration between steps, they are spread.
    """
    parts, width = without_jumps(result.pieces, result.job.robot.limits)
    cycle = joined([part.trajectory for part in parts])
    if width == 0:
        return cycle, ""
    steps = joined([piece.trajectory for piece in result.pieces])
    far = float(np.abs(cycle.position - steps.sample(np.minimum(cycle.time, steps.time[-1]))[0]).max())
    return cycle, (
        f"one motion: the jerk limits forbid the jumps of acceleration between steps, which are spread over "
        f"{1e3 * width:.3g} ms; motions begin and end up to {1e3 * width:.3g} ms earlier or later than the steps, and "
        f"positions differ by up to {far:.2g} rad or m"
    )


def judging_of(result: JobResult) -> CycleJudging:
    """The judge of a job's cycle: every part under the payload and in the scene of its steps."""
    steps = ((piece.trajectory.duration, result.job.steps[piece.at]) for piece in result.pieces)
    return CycleJudging.of((seconds, result.scorers.of(step), result.cells.of(step)) for seconds, step in steps)


def with_room(
    result: JobResult, formats: Sequence[Format], rate: float | None, again: Callable[[Shares], JobResult]
) -> JobResult:
    """The job, or one planned again so that its cycle as one motion, and its programs, hold all limits.

    Args:
        result: the solved job. formats: of the programs. rate: [Hz] of their samples; None: those of the plan.
        again: plans the job with these shares of the limits' bounds.
    """

    def certificates_of(found: JobResult) -> list[Certificate]:
        judge = judging_of(found)
        return [judge(whole_cycle(found)[0]), *certificates(found.pieces, judge, formats, rate)]

    found, shares = controller_files.with_room(result, certificates_of, again)
    if not shares or not found.solved:
        return result
    said = controller_files.said(shares, found.energy - result.energy)
    return replace(found, baselines=result.baselines, bound=result.bound, warnings=(*result.warnings, said))


def write_programs(
    result: JobResult, forms: Sequence[Format], out: Path, rate: float | None = None, prefix: str = ""
) -> list[Written]:
    """Write cycle.csv, and the cycle in several formats, into a folder; each is read back and judged.

    Args:
        result: the solved job. forms: the formats. out: the folder. rate: [Hz] of samples; None: those of the plan.
        prefix: of the joints' names in these files.
    """
    judge, (cycle, _), csv = judging_of(result), whole_cycle(result), formats.FORMATS["csv"]
    csv.write(cycle, out / CYCLE)
    own = unchanged(out / CYCLE, csv, cycle, judge(cycle), judge.scorer.robot)
    return [own, *(write_cycle(result.pieces, judge, form, out, rate, prefix) for form in forms)]


FORMAT = "energy-opt/job-result/1"


def document(result: JobResult) -> dict[str, Any]:
    """The content of job.json: energies in J, times in s from the cycle's begin."""
    least = result.robust or {"total": result.energy, "lower_bound": result.bound}
    gap = None
    if least["lower_bound"] is not None:
        gap = 100 * (least["total"] - least["lower_bound"]) / max(abs(least["total"]), 1e-12)
    return {
        "format": FORMAT,
        "status": "solved" if result.solved else "not_converged",
        "robot": result.job.robot.name,
        "joints": list(result.job.robot.joints),
        "cycle_time": result.job.cycle_time,
        "energy_total": result.energy,
        "steps": steps_of(result),
        "baselines": [
            {"name": name, "energy_total": energy, "valid": energy is not None}
            for name, energy in result.energies.items()
        ],
        **_chosen(result),
        "optimality": {
            "kind": "global" if gap is not None and gap < 0.1 else "local",
            "lower_bound": result.bound,
            "gap_percent": gap,
        },
        **({} if result.robust is None else {"robust": result.robust}),
        "models": list(result.models),
        "assumptions": [asdict(row) for row in result.assumptions],
        "break_even_friction": result.break_even_friction,
        "travel": [dict(row) for row in result.travel],
        "warnings": [*interrupted_words(result.interrupted, "; --resume continues it"), *result.warnings],
        "interrupted": result.interrupted,
    }


def _chosen(result: JobResult) -> dict[str, Any]:
    """For steps that end at poses of the tool: the chosen positions, their errors, and the cost of the nearest ones."""
    choice = result.choice
    if choice is None:
        return {}
    names = {k: str(k) for k in choice.ends}
    poses, ends = ({names[k]: x for k, x in choice.poses.items()}, {names[k]: q for k, q in choice.ends.items()})
    missed = pose_document(result.job.robot, choice.tool, poses, ends)
    steps = result.job.steps
    return {
        "poses": [
            {
                "step": k + 1,
                "name": steps[k].name,
                "goal": q.tolist(),
                "looked_at": choice.branches[k],
                **missed[names[k]],
            }
            for k, q in choice.ends.items()
        ],
        "choice": {"energy_total": choice.energy, "greedy_nearest": choice.greedy, "solves": choice.solves},
    }


def steps_of(result: JobResult) -> list[dict[str, Any]]:
    """An entry for every step and for remaining time; their durations add up to the cycle."""
    out, at = [], 0.0
    for piece in result.pieces:
        for part in split(piece, result):
            mass, *centre = result.job.steps[part.at].payload
            row = {
                "name": part.name,
                "kind": "move" if not part.waits else "standby" if part.mode else "wait",
                "start": at,
                "duration": part.trajectory.duration,
                "energy_total": part.energy,
                "payload": mass,
                "centre": centre,
                "brakes": bool(part.mode),
                "source": part.source,
                "first_path": part.begins or None,
                "status": part.status,
            }
            out.append(row)
            at += part.trajectory.duration
    return out


def split(piece: Piece, result: JobResult) -> list[Piece]:
    """A motion of several steps, divided where it passes between them; else the piece itself."""
    if len(piece.steps) < 2:
        return [piece]
    steps = [result.job.steps[k] for k in piece.steps]
    parts = divided(piece.trajectory, piece.energy, steps, result.scorers.of(steps[0]))
    return [
        replace(piece, name=step.name, steps=(k,), trajectory=part, energy=energy)
        for k, step, (part, energy) in zip(piece.steps, steps, parts, strict=True)
    ]


def divided(t: Trajectory, energy: float, steps: Sequence[Step], scorer: Scorer) -> list[tuple[Trajectory, float]]:
    """The parts of a motion of `energy` [J] that does several steps, from time 0 each, and their energies [J]."""
    at = [float(t.time[0])]
    for step in steps[:-1]:
        at.append(float(whole(t.time_nearest_to(step.goal, at[-1]))))
    parts = [t.between(a, b) for a, b in zip(at, [*at[1:], float(t.time[-1])], strict=True)]
    energies = np.array([scorer.energy(part).total for part in parts])
    # distribute the error of kinks between samples
    energies += (energy - energies.sum()) * energies / energies.sum()
    return list(zip(parts, energies.tolist(), strict=True))


def power_of(result: JobResult) -> tuple[np.ndarray, np.ndarray]:
    """Electrical power over the cycle: time (N,) [s], power (N,) [W]; for a wait its mean, with brakes."""
    times, powers, at = [], [], 0.0
    for piece in result.pieces:
        t = piece.trajectory
        power = np.full(len(t.time), piece.energy / max(t.duration, 1e-9))
        if not piece.waits:
            filled = result.scorers.of(result.job.steps[piece.at]).filled(t, piece.past).power
            power = power if filled is None else filled
        times.append(at + t.time - t.time[0])
        powers.append(power)
        at += t.duration
    return np.concatenate(times), np.concatenate(powers)


def found_of(
    result: JobResult, request: Mapping[str, Any], worth: PerYear | None = None, written: Sequence[Written] = ()
) -> dict[str, Any]:
    """job.json.

    Args:
        worth: how often the cycle runs in a year, where its saving is to be stated for one: against the cycle slowed
            evenly, or where that is not possible, done fastest.
        written: the files of `write_programs`.
    """
    found = {**document(result), "written": [row.document() for row in written], "request": plain(request)}
    cycle, spread = whole_cycle(result)
    missed = missed_words(cycle, [step.goal for step in result.job.steps])
    bad = [str(row) for row in written if row.file == CYCLE and not row.valid]
    found["warnings"] += [f"{CYCLE}: {fault}" for fault in (*bad, spread, missed) if fault]
    found["warnings"] += warnings_on([row for row in written if row.file != CYCLE], request.get("rate"))
    if worth is not None:
        found["per_year"] = worth.of(None if result.slowed is None else result.slowed - result.energy)
    return found


def write(
    result: JobResult, request: Mapping[str, Any], out: Path, worth: PerYear | None = None,
    written: Sequence[Written] | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Write step_01.csv ..., report.html and job.json, this last, and the files in `written`.

    Args:
        result: the solved job. request: its document. out: the folder. worth: as that of `found_of`.
        written: the files of `write_programs`; None: cycle.csv alone.

    Returns:
        The document of `found_of`.
    """
    parts = [part for piece in result.pieces for part in split(piece, result)]
    for number, part in enumerate(parts, start=1):
        filled = result.scorers.of(result.job.steps[part.at], part.mode == "brakes").filled(part.trajectory, part.past)
        formats.write(filled, Path(out) / f"step_{number:02d}.csv")
    written = files_from(partial(write_programs, result, ())) if written is None else written
    for row in written:
        row.put(Path(out))
    found = found_of(result, request, worth, written)
    cycle, _ = whole_cycle(result)
    page(found, cycle, result.job.robot, result.cell, power_of(result)).write(Path(out) / "report.html")
    write_json(Path(out) / "job.json", found)
    return found
