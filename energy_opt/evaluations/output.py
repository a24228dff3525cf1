"""Output of `evaluate`: evaluate.json, files in other formats, and a table of all motions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from energy_opt.evaluations.run import Evaluation
from energy_opt.files import plain, write_json
from energy_opt.folders import written_whole
from energy_opt.formats import Format
from energy_opt.formats.cycle import write_cycle
from energy_opt.formats.output import Written
from energy_opt.robot import Robot

FORMAT = "energy-opt/evaluation/1"
ANSWER = "evaluate.json"
WIDTH = 14  # [characters] least width of a column


def document(robot: Robot, found: Sequence[Evaluation], request: Mapping[str, Any]) -> dict[str, Any]:
    """evaluate.json: energies in J, times in s from each motion's beginning."""
    return {
        "format": FORMAT,
        "status": "done",
        "robot": robot.name,
        "joints": list(robot.joints),
        "motions": [_row(evaluation) for evaluation in found],
        "written": [],
        "request": plain(request),
    }


def _row(evaluation: Evaluation) -> dict[str, Any]:
    motion, certificate = evaluation.motion, evaluation.certificate
    return {
        "file": motion.name,
        "duration": motion.trajectory.duration,
        "waits": [{"start": a, "duration": b - a} for a, b in motion.waits.tolist()],
        "models": [{"name": name, "energy": energy.document()} for name, energy in evaluation.energies.items()],
        "valid": certificate.valid,
        "certificate": certificate.document(),
        "peak_power": certificate.peak_power,
        "baselines": [
            {"name": b.name, "duration": b.duration, "valid": b.valid, "energy_total": b.energies}
            for b in evaluation.baselines
        ],
        "remark": evaluation.remark or None,
        "notes": list(motion.notes),
    }


def write(
    robot: Robot, found: Sequence[Evaluation], request: Mapping[str, Any], out: Path,
    formats: Sequence[Format] = (), rate: float | None = None, prefix: str = "",
) -> tuple[dict[str, Any], list[Written]]:  # fmt: skip
    """Write evaluate.json, and every motion in the formats asked for (trajectory, or trajectory_01 and so on)."""
    result = document(robot, found, request)
    with written_whole(out, ANSWER) as aside:
        records = []
        for number, evaluation in enumerate(found, start=1):
            stem = "trajectory" if len(found) == 1 else f"trajectory_{number:02d}"
            records += write_cycle(evaluation.parts, evaluation.judge, formats, aside, rate, prefix, stem)
        result["written"] = [row.document() for row in records]
        write_json(aside / ANSWER, result)
    return result, records


def table(found: Sequence[Evaluation]) -> str:
    """Table of all motions, one column each, for the terminal."""
    files = [Path(evaluation.motion.name) for evaluation in found]
    alike = len({file.name for file in files}) < len(files)
    names = ["/".join(file.parts[-2:]) if alike else file.name for file in files]
    width = max(WIDTH, *(len(name) + 2 for name in names))
    lines = [f"{'':<28}" + "".join(f"{name:>{width}}" for name in names)]

    def line(name: str, values: Sequence[float | None], digits: int = 3) -> None:
        cells = "".join(f"{'-' if x is None else f'{x:.{digits}f}':>{width}}" for x in values)
        lines.append(f"{name:<28}{cells}")

    line("duration [s]", [e.motion.trajectory.duration for e in found], 4)
    line("standing still [s]", [float((e.motion.waits[:, 1] - e.motion.waits[:, 0]).sum()) for e in found], 4)
    for model in found[0].energies:
        lines.append(f"under {model} [J]")
        energies = [e.energies[model] for e in found]
        for part in ("total", "standby", "stored", "loss"):
            line(f"  {part}", [getattr(energy, part) for energy in energies])
        for effect in dict.fromkeys(name for energy in energies for name in energy.by_effect):
            if effect not in ("standby", "mechanical"):
                line(f"    {effect}", [energy.by_effect.get(effect) for energy in energies])
        for name in ("toppra", "scaled"):
            known = [next((b for b in e.baselines if b.name == name), None) for e in found]
            line(f"  {name}", [None if b is None else b.energies[model] for b in known])
    line("peak power [W]", [e.certificate.peak_power for e in found], 1)
    for evaluation in found:
        lines.append(f"{evaluation.motion.name}: {_judged(evaluation)}")
    return "\n".join(lines)


def _judged(evaluation: Evaluation) -> str:
    certificate = evaluation.certificate
    worst = certificate.worst
    what = f"{worst['joint']} {worst['limit']} is {worst['value']:.6g} at {worst['time']:.4g} s"
    what += f", bound {worst['bound']:.6g}"
    text = f"all limits kept; tightest: {what}" if certificate.within_limits else f"breaks a limit: {what}"
    if certificate.clearance is not None:
        text += f"; {certificate.clearance}"
    return f"{text}; no baselines: {evaluation.remark}" if evaluation.remark else text
