"""The output of a cell's schedule: job.json, and a page with all arms and the power of all over the cycle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.files import plain, write_json
from energy_opt.formats.controller_files import Written, warnings_on
from energy_opt.formats.cycle_file import missed_words
from energy_opt.jobs.job_files import divided
from energy_opt.motion.trajectory import joined
from energy_opt.power.per_year import PerYear
from energy_opt.reports.motion import Solid, cell_player, drawn
from energy_opt.reports.workcell import page
from energy_opt.reports.workcell import table as table
from energy_opt.results import interrupted_words
from energy_opt.robot import Link
from energy_opt.workcell.between import placed_links
from energy_opt.workcell.curves import zones_of
from energy_opt.workcell.programs import asked_of, unproven_words
from energy_opt.workcell.programs import write_programs as write_programs
from energy_opt.workcell.solve_cell import CellResult, near_zero
from energy_opt.workcell.supply import Supply

FORMAT = "energy-opt/job-result/2"
ABOUT = ("verdict", "lower_bound", "min_distance", "pair", "time", "late", "pairs")  # keys of a distance
SETTLED = 1e-2  # largest gap of a schedule that counts as solved


def document(result: CellResult) -> dict[str, Any]:
    """The content of job.json: energies in J, times in s; starts count from the first step of the first robot."""
    schedule, cell = result.schedule, result.cell
    starts = near_zero(schedule)
    robots = []
    for r, ring in enumerate(schedule.problem.rings):
        modes = [mode or None for mode in schedule.modes[r]]
        columns = {
            "name": [step.name for step in ring.steps], "start": starts[r], "duration": schedule.durations[r],
            "mode": modes, "zone": zones_of(cell.robot[r], ring), "energy_total": schedule.energies[r],
        }  # fmt: skip
        records = [dict(zip(columns, record, strict=True)) for record in zip(*columns.values(), strict=True)]
        steps = [part for record in records for part in _of_each_step(record, result, r)]
        robots.append({"name": ring.name, "steps": steps})
    levers = [_lever(name, found.energy, result) for name, found in result.levers.steps]
    warnings = [*interrupted_words(result.interrupted), *result.remarks]
    for arm, motion in zip(result.arms, result.planned.motions, strict=True):
        if arm is None or motion is None:
            continue
        said = () if arm.cell is None else arm.cell.warnings
        warnings += [f"robot {arm.name}: {remark}" for remark in (*arm.job.remarks, *said)]
        if replaced := ", ".join(arm.scoring.replaced):
            warnings.append(f"robot {arm.name}: [supply] replaces what a model assumes of braking ({replaced})")
        missed = missed_words(joined([part.trajectory for part in motion.parts]), [s.goal for s in arm.job.steps])
        warnings += [f"robot {arm.name}: {missed}"] if missed else []
        started = [e.name for e in arm.worker.scorers.model.effects if e.drifts or "idle" in e.follows]
        if started:
            warnings.append(f"robot {arm.name}: {', '.join(started)}: each step counts as if no motion came before it")
    arms = [robot.name for robot, arm in zip(cell.robot, result.arms, strict=True) if arm is not None]
    if len(arms) > 1 and len(result.clearance) < len(arms) * (len(arms) - 1) // 2:
        warnings.append(
            "not every two arms were checked against each other: self-collision is off, or an arm has no body"
        )
    warnings += [unproven_words(result, between) for between in result.clearance if between.verdict != "proven"]
    if result.levers.relaxed:
        warnings.append(
            "at full speed no schedule keeps the bounds of the waits: in the lever as_is, waits last longer"
        )
    if result.levers.steps[0][0] != "as_is":
        warnings.append(
            "at the durations of as_is, or at full speed, no schedule keeps lags and zones: the lever as_is is left out"
        )
    if cell.supply is None and result.left > SETTLED:
        warnings.append(f"a gap of {100 * result.left:.2g} % to the bound is left; more seconds may close it")
    for name, joint, share in result.overloads:
        warnings.append(
            f"{name}: under another model than the first {joint} takes {100 * share:.4g} % of its torque limit"
        )
    drawn = result.supply
    if drawn is not None and not drawn.valid:
        over = f"power reaches {drawn.peak:.5g} W, max_power = {drawn.bound} W"
        over = over if drawn.overflow == 0 else f"{drawn.lost:.4g} J of braking cannot be stored"
        if not result.interrupted:  # else they may not be held at all
            over = f"under the first model {over}: the supply's limits are held for the mean of the models"
        warnings.append(over)
    return {
        "format": FORMAT,
        "status": "solved" if result.solved else "not_converged",
        "cycle_time": cell.cycle_time,
        "energy_total": result.energy,
        "bound": result.bound,
        "optimality": {
            "kind": "global" if result.gap < 1e-3 else "local",
            "lower_bound": result.bound,
            "gap_percent": 100 * result.gap,
        },
        **({} if result.robust is None else {"robust": result.robust}),
        "robots": robots,
        "levers": levers,
        "levers_alone": [_lever(name, found.energy, result) for name, found in result.levers.alone],
        "baselines": [
            {"name": "fastest_then_wait", "energy_total": x["energy_total"]} for x in levers if x["name"] == "as_is"
        ],
        "clearance": _clearance(result),
        "around": list(result.planned.around),
        "jitter": cell.jitter,
        "peak_power": None if result.supply is None else result.supply.peak,
        "supply": _supply(result),
        "warnings": warnings,
        "interrupted": result.interrupted,
        "solve_seconds": schedule.seconds,
    }


def _of_each_step(record: dict[str, Any], result: CellResult, r: int) -> list[dict[str, Any]]:
    """The record of a motion of robot r that does several steps without stopping, one for each; else the record."""
    arm, motion = result.arms[r], result.planned.motions[r]
    move = None if arm is None else next((m for m in arm.moves if arm.names[m.place] == record["name"]), None)
    if arm is None or motion is None or move is None or len(move.leg.steps) < 2:
        return [record]
    part = next(part for part in motion.parts if part.name == record["name"])
    steps = arm.job.steps[move.place : move.place + len(move.leg.steps)]
    scorer = arm.scoring.of(True).of(steps[0])
    out, start = [], float(record["start"])
    for step, (t, energy) in zip(steps, divided(part.trajectory, record["energy_total"], steps, scorer), strict=True):
        out.append({**record, "name": step.name, "start": start, "duration": t.duration, "energy_total": energy})
        start += t.duration
    return out


def _lever(name: str, energy: float, result: CellResult) -> dict[str, Any]:
    """A lever; `moves` says for which moves: "curves", "evenly_slowed" (not kept apart) or "optimized"."""
    solved = name in ("paths", "supply")
    arms = any(arm is not None for arm in result.arms)
    return {"name": name, "energy_total": energy,
            "moves": "curves" if not arms else "optimized" if solved else "evenly_slowed"}  # fmt: skip


def _clearance(result: CellResult) -> dict[str, Any] | None:
    """The clearance between robots; None without two arms."""
    found = result.clearance
    if not found:
        return None
    verdicts = {between.verdict for between in found}
    verdict = next(name for name in ("colliding", "undecided", "proven") if name in verdicts)
    bounds = [between.lower_bound for between in found if between.lower_bound is not None]
    return {
        "verdict": verdict,
        "lower_bound": min(bounds) if verdict == "proven" and bounds else None,
        "jitter": result.cell.jitter,
        "robots": [
            {"robots": [result.cell.robot[k].name for k in between.robots],
             **{name: getattr(between, name) for name in ABOUT}}
            for between in found
        ],
    }  # fmt: skip


def _supply(result: CellResult) -> dict[str, Any] | None:
    """Energy and losses with each robot's own supply and with that of the file."""
    if result.own is None or result.supply is None:
        return None
    both = {f"{name}{of}": getattr(drawn, name) for name in ("energy", "lost", "peak")
            for of, drawn in (("_own", result.own), ("", result.supply))}  # fmt: skip
    return {**both, "max_power": result.supply.bound}


def found_of(
    result: CellResult, request: Mapping[str, Any], worth: PerYear | None = None, written: Sequence[Written] = ()
) -> dict[str, Any]:
    """The content of job.json.

    Args:
        worth: cycles per year, if the saving over the cycle as it is is to be stated per year.
        written: the files of `write_programs`.
    """
    found = {**document(result), "written": [row.document() for row in written], "request": plain(request)}
    asked = asked_of(written)
    found["warnings"] += warnings_on([row for row in written if row not in asked], None)
    found["warnings"] += warnings_on(asked, request.get("rate"))
    if worth is not None:
        first = found["levers"][0]["energy_total"]
        found["per_year"] = worth.of(first - found["energy_total"])
        for lever in (*found["levers"], *found["levers_alone"]):
            lever["per_year"] = worth.of(first - lever["energy_total"])
    return found


def write(
    result: CellResult,
    request: Mapping[str, Any],
    out: Path,
    worth: PerYear | None = None,
    written: Sequence[Written] = (),
) -> dict[str, Any]:
    """Write the files in `written`, report.html and, last, job.json; returns the document, that of `found_of`."""
    for row in written:
        row.put(Path(out))
    found = found_of(result, request, worth, written)
    page(found, power_of(result), scene_of(result)).write(Path(out) / "report.html")
    write_json(Path(out) / "job.json", found)
    return found


FRAMES = 300  # frames of the cycle; the player interpolates between them
COLOURS = ("#2f74c0", "#e07b28", "#2e9a60", "#8a5cc2", "#b0394f", "#5d7f8c")


def power_of(result: CellResult) -> tuple[np.ndarray, np.ndarray]:
    """Power (N,) [W] of all robots over the cycle, at times (N,) [s]; a robot with only curves draws its mean."""
    supplied = result.supply or Supply(result.cell, result.arms).drawn(result.schedule, False)
    return supplied.time, supplied.power


def scene_of(result: CellResult) -> dict[str, Any] | None:
    """All arms over the cycle, for the page's player; None if no arm has bodies."""
    time = np.linspace(0, result.cell.cycle_time, FRAMES)
    links: list[Link] = []
    positions: list[np.ndarray] = []
    tools: list[int] = []
    bodies: list[tuple[Solid, str]] = []
    scene: list[Solid] = []
    for arm, motion in zip(result.arms, result.planned.motions, strict=True):
        cell = None if arm is None else arm.cell
        if cell is None or motion is None:
            continue
        base, shift, colour = cell.request.base_pose, len(links), COLOURS[len(tools) % len(COLOURS)]
        own, around = drawn(cell)
        links += placed_links(cell, shift)
        positions.append(motion.at(time))
        tools.append(shift + cell.robot.body.last)
        bodies += [(_placed(solid, base, shift), colour) for solid in own]
        scene = scene or [_placed(solid, base, 0) for solid in around]
    if not positions:
        return None
    return cell_player(links, (time, np.hstack(positions)), tools, bodies, scene)


def _placed(solid: Solid, base: np.ndarray, shift: int) -> Solid:
    """A body of an arm in the common tree: a moving one by its joint's number, a fixed one by its base's pose."""
    if solid.joint >= 0:
        return replace(solid, joint=solid.joint + shift)
    return replace(solid, vertices=solid.vertices @ base[:3, :3].T + base[:3, 3])
