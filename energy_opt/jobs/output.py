"""What `job` writes: job.json, a trajectory for every step, and the cycle as one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt import formats
from energy_opt.cell.load import own_body
from energy_opt.files import plain, write_json
from energy_opt.formats.output import Written, unchanged
from energy_opt.jobs.cycle import Piece
from energy_opt.jobs.program import judging_of, whole_cycle
from energy_opt.jobs.run import JobResult
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.trajectory import Trajectory
from energy_opt.poses.judge import pose_document
from energy_opt.power.worth import PerYear
from energy_opt.reports.job import page
from energy_opt.reports.solids import drawn

FORMAT = "energy-opt/job-result/1"


def document(result: JobResult) -> dict[str, Any]:
    """job.json: energies in J, times in s from the cycle's begin."""
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
        "steps": rows(result),
        "baselines": [
            {"name": b.name, "energy_total": b.energy, "valid": b.energy is not None} for b in result.baselines
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
        "warnings": list(result.warnings),
        "interrupted": result.interrupted,
    }


def _chosen(result: JobResult) -> dict[str, Any]:
    """Of steps that end at poses of the tool: the positions chosen, what they miss, and what the nearest would cost."""
    choice = result.choice
    if choice is None:
        return {}
    names = {k: str(k) for k in choice.ends}
    poses, ends = ({names[k]: x for k, x in choice.poses.items()}, {names[k]: q for k, q in choice.ends.items()})
    missed = pose_document(result.job.robot, choice.tool, poses, ends)
    steps = result.job.steps
    return {
        "poses": [
            {"step": k + 1, "name": steps[k].name, "goal": q, "looked_at": choice.branches[k], **missed[names[k]]}
            for k, q in choice.ends.items()
        ],
        "choice": {"energy_total": result.energy, "greedy_nearest": choice.greedy, "solves": choice.solves},
    }


def rows(result: JobResult) -> list[dict[str, Any]]:
    """A row for every step and for time that is left over; their durations add up to the cycle."""
    out, at, k, rest = [], 0.0, 0, result.plan.rest
    for piece in result.pieces:
        k = piece.steps[0] if piece.steps else k
        for part in split(piece, result):
            row = {
                "name": part.name,
                "kind": _kind(part, result),
                "start": at,
                "duration": part.trajectory.duration,
                "energy_total": part.energy,
                "payload": part.payload,
                "centre": list(result.job.steps[k].payload[1:]),
                "brakes": part.source == "wait" and (result.job.steps[k].brakes if piece.steps else rest.brakes),
                "source": part.source,
                "first_path": part.begins or None,
                "status": part.status,
            }
            out.append(row)
            at += part.trajectory.duration
    return out


def _kind(piece: Piece, result: JobResult) -> str:
    """ "move", "wait" (held by the motors) or "standby" (held by brakes)."""
    if piece.source != "wait":
        return "move"
    brakes = result.job.steps[piece.steps[0]].brakes if piece.steps else result.plan.rest.brakes
    return "standby" if brakes else "wait"


def split(piece: Piece, result: JobResult) -> list[Piece]:
    """A motion that does several steps, cut where it passes between them; else the piece itself."""
    if len(piece.steps) < 2:
        return [piece]
    steps, t = [result.job.steps[k] for k in piece.steps], piece.trajectory
    cuts = [0]
    for step in steps[:-1]:
        after = np.abs(t.position[cuts[-1] + 1 : -1] - step.goal).max(axis=1)
        cuts.append(cuts[-1] + 1 + int(np.argmin(after)))
    cuts.append(len(t.time) - 1)
    scorer = result.scorer(steps[0])
    parts = [_rows(t, a, b) for a, b in zip(cuts[:-1], cuts[1:], strict=True)]
    energies = np.array([scorer.energy(part).total for part in parts])
    energies += (piece.energy - energies.sum()) * energies / energies.sum()  # of kinks between samples
    return [
        Piece(step.name, (k,), part, float(energy), piece.payload, piece.source, piece.status, piece.begins)
        for k, step, part, energy in zip(piece.steps, steps, parts, energies, strict=True)
    ]


def _rows(t: Trajectory, first: int, last: int) -> Trajectory:
    records = slice(first, last + 1)
    return Trajectory(
        t.joints, t.time[records] - t.time[first], t.position[records], t.velocity[records], t.acceleration[records]
    )


def power_of(result: JobResult) -> tuple[np.ndarray, np.ndarray]:
    """Electrical power over the cycle: time (N,) [s], power (N,) [W]; of a wait its mean, brakes included."""
    times, powers, at = [], [], 0.0
    for piece in result.pieces:
        t = piece.trajectory
        power = np.full(len(t.time), piece.energy / max(t.duration, 1e-9))
        if piece.source != "wait" and piece.steps:
            filled = result.scorer(result.job.steps[piece.steps[0]]).filled(t).power
            power = power if filled is None else filled
        times.append(at + t.time - t.time[0])
        powers.append(power)
        at += t.duration
    return np.concatenate(times), np.concatenate(powers)


def write(
    result: JobResult,
    request: Mapping[str, Any],
    out: Path,
    worth: PerYear | None = None,
    written: Sequence[Written] = (),
) -> dict[str, Any]:
    """Write step_01.csv ..., cycle.csv, report.html and job.json, this last; returns the document.

    Args:
        worth: how often the cycle runs in a year, where its saving is to be stated for one.
        written: programs of the cycle that are there already, read back and judged.
    """
    number = 0
    for piece in result.pieces:
        scorer: Scorer = result.scorer(result.job.steps[piece.steps[0]] if piece.steps else result.job.steps[0])
        for part in split(piece, result):
            number += 1
            formats.write(scorer.filled(part.trajectory), Path(out) / f"step_{number:02d}.csv")
    cycle, csv = whole_cycle(result), formats.FORMATS["csv"]
    csv.write(cycle, Path(out) / "cycle.csv")
    own = unchanged(Path(out) / "cycle.csv", csv, cycle, judging_of(result)(cycle))
    records = [own.document(), *(row.document() for row in written)]
    found = {**document(result), "written": records, "request": plain(request)}
    if not own.valid:
        found["warnings"].append(f"cycle.csv: {own}")
    if worth is not None:
        beside = next((b.energy for b in result.baselines[::-1] if b.energy is not None), None)  # evenly slowed first
        found["per_year"] = worth.of(None if beside is None else beside - result.energy)
    bodies, scene = drawn(result.cell or own_body(result.job.robot))
    page(found, cycle, result.job.robot, bodies, scene, power_of(result)).write(Path(out) / "report.html")
    write_json(Path(out) / "job.json", found)
    return found
