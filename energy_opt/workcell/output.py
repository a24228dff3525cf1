"""What a cell's schedule leaves: job.json and a page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from energy_opt.files import plain, write_json
from energy_opt.reports.workcell import page
from energy_opt.workcell.run import CellResult

FORMAT = "energy-opt/job-result/2"
SETTLED = 1e-2  # gap up to which a schedule counts as solved


def document(result: CellResult) -> dict[str, Any]:
    """job.json: energies in J, times in s; a step's start counts from the first step of the first robot."""
    schedule, cell = result.schedule, result.cell
    robots = [
        {
            "name": ring.name,
            "steps": [
                {
                    "name": step.name,
                    "start": schedule.starts[r][k],
                    "duration": schedule.durations[r][k],
                    "mode": schedule.modes[r][k] or None,
                    "energy_total": schedule.energies[r][k],
                }
                for k, step in enumerate(ring.steps)
            ],
        }
        for r, ring in enumerate(schedule.problem.rings)
    ]
    steps = result.levers.steps
    warnings = []
    if result.levers.relaxed:
        warnings.append("at full speed no schedule keeps the bounds of the waits: as_is lets waits last longer")
    if schedule.gap > SETTLED:
        warnings.append(f"a gap of {100 * schedule.gap:.2g} % to the bound is left; more seconds may close it")
    return {
        "format": FORMAT,
        "status": "solved",
        "cycle_time": cell.cycle_time,
        "energy_total": schedule.energy,
        "bound": schedule.bound,
        "optimality": {
            "kind": "global" if schedule.gap < 1e-3 else "local",
            "lower_bound": schedule.bound,
            "gap_percent": 100 * schedule.gap,
        },
        "robots": robots,
        "levers": [{"name": name, "energy_total": found.energy} for name, found in steps],
        "levers_alone": [{"name": name, "energy_total": found.energy} for name, found in result.levers.alone],
        "baselines": [
            {"name": "fastest_then_wait", "energy_total": found.energy} for name, found in steps if name == "as_is"
        ],
        "clearance": None,
        "jitter": cell.jitter,
        "peak_power": None,
        "warnings": warnings,
        "solve_seconds": schedule.seconds,
    }


def write(result: CellResult, request: Mapping[str, Any], out: Path) -> dict[str, Any]:
    """Write report.html and job.json, this last; returns the document."""
    found = {**document(result), "request": plain(request)}
    page(found).write(Path(out) / "report.html")
    write_json(Path(out) / "job.json", found)
    return found
