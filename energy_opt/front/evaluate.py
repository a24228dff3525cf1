"""The verb `evaluate`: given motions, under one or several models; evaluate.json, other formats, and a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from os import PathLike
from pathlib import Path
from typing import Any

from energy_opt.cell.cell import Cell
from energy_opt.cell.load import load_cell
from energy_opt.errors import BadInput
from energy_opt.evaluations.evaluated import Evaluation
from energy_opt.evaluations.evaluated import evaluate as evaluated
from energy_opt.evaluations.source import Recorded, is_set, load, load_set, stated
from energy_opt.files import plain, write_json
from energy_opt.folders import written_whole
from energy_opt.formats.controller_files import Written, files_from, warnings_on
from energy_opt.formats.cycle_file import write_cycle
from energy_opt.front.controllers import check_written
from energy_opt.front.desk import Answered, Desk, verb, warn_of
from energy_opt.front.given import as_loaded, cell_of, payload_document, robot_of, robot_of_files
from energy_opt.front.models import rivals_of
from energy_opt.front.motion_files import motion_files, put_motions
from energy_opt.front.moves import documents
from energy_opt.reports.words import INVALID
from energy_opt.requests.verbs import EvaluateRequest
from energy_opt.results import exit_of
from energy_opt.robot import Robot
from energy_opt.robot.degrees import doubted_units

FORMAT = "energy-opt/evaluation/1"
IN_CELL = ("base", "tool", "floor", "scene")
WIDTH = 14  # [characters] least width of a column


@dataclass(frozen=True, repr=False, kw_only=True, eq=False)
class Answers(Answered):
    """Evaluations of all motions: `found`, each with `energies` by model, `certificate` and `baselines`; by name, as
    `["motions"]`, the values of evaluate.json.

    Attributes:
        given: the motions as given; `save` writes those that are no files, so that the request can be repeated.
        files: those for controllers, made, read back and judged in the call; `save` writes them.
    """

    robot: Robot
    request: EvaluateRequest
    found: tuple[Evaluation, ...]
    given: tuple[Any, ...] = ()
    files: tuple[Written, ...] = ()
    answer = "evaluate.json"

    @property
    def exit_code(self) -> int:
        """Exit code of the command line."""
        return exit_of(False, all(row.valid for row in self.files))

    def document(self) -> dict[str, Any]:
        """evaluate.json: energies in J, times in s from each motion's beginning."""
        return {
            "format": FORMAT,
            "status": "done",
            "robot": self.robot.name,
            "joints": list(self.robot.joints),
            "motions": [_row(evaluation) for evaluation in self.found],
            "written": [row.document() for row in self.files],
            "warnings": warnings_on(self.files, self.request.rate),
            "request": plain(self.asked),
        }

    def text(self, out: Path) -> str:
        """Table of all motions, for a terminal."""
        return table(self.found)

    def __repr__(self) -> str:
        return f"Answers({self.robot.name!r}, {len(self.found)} motions)"

    def save(
        self, out: str | PathLike[str], write: Sequence[str] = (), rate: float | None = None, prefix: str = "",
        *, force: bool = False,
    ) -> Path:  # fmt: skip
        """Write evaluate.json, and every motion in the formats asked for, into `out`.

        Args:
            write, rate, prefix: in place of the request's `write`, `rate` [Hz] and `joint_prefix`.
            force: replace all files that are in the way.
        """
        given: dict[str, Any] = {"write": tuple(write) or None, "rate": rate, "joint_prefix": prefix or None}
        if not any(given.values()):
            return super().save(out, force=force)
        asked = replace(self.request, **{name: value for name, value in given.items() if value is not None})
        files = files_of(asked, self.robot, self.found)
        warn_of(files)
        return super(Answers, replace(self, request=asked, files=files)).save(out, force=force)

    def kept(self, out: Path) -> Answers:
        """Write evaluate.json, and every motion in the formats that the request asks for, into the folder `out`."""
        with written_whole(out, self.answer) as aside:
            names = put_motions(self.given, aside, self.request.joint_prefix)
            for row in self.files:
                row.put(aside)
            write_json(aside / self.answer, replace(self, request=replace(self.request, files=names)).document())
        return self


def files_of(request: EvaluateRequest, robot: Robot, found: Sequence[Evaluation]) -> tuple[Written, ...]:
    """Every motion in the formats that a request asks for: trajectory, or trajectory_01 and so on."""
    forms, rate, prefix = check_written(request, robot), request.rate, request.joint_prefix
    stems = ["trajectory"] if len(found) == 1 else [f"trajectory_{k:02d}" for k in range(1, len(found) + 1)]

    def write(out: Path) -> list[Written]:
        return [
            write_cycle(each.parts, each.judge, form, out, rate, prefix, stem)
            for each, stem in zip(found, stems, strict=True)
            for form in forms
        ]

    return files_from(write)


def run(request: EvaluateRequest, desk: Desk) -> Answers:
    """Energy by effect of given trajectories, cycles or recordings under every model; limits, clearance, baselines.

    Raises:
        BadInput: a file holds no motion, or the robot is not known from it.
    """
    given: Any = request.files
    if not given:
        raise BadInput("no FILE; give a trajectory, a cycle or a recording")
    with motion_files(given, request.joint_prefix) as (folder, names, files):
        request = _as_stated(request, files, desk)
        robot = robot_of(request, None if request.robot is not None else robot_of_files(files, request.joint_prefix))
        check_written(request, robot)
        read = [_motions(path, robot, request.joint_prefix) for path in files]
        motions = [_of_caller(motion, folder) for of_file in read for motion in of_file]
    rivals, _ = rivals_of(request, robot, desk)
    surroundings = cell_of(request)

    @cache
    def loaded(scene: Path | None) -> Cell | None:
        """The robot in the request's scene, else in one that a result states for a step."""
        return load_cell(robot, replace(surroundings, scene=surroundings.scene or scene))

    def cells(scene: Path | None) -> Cell | None:
        """The same; None to check nothing."""
        cell = loaded(scene)
        return cell if cell is not None and cell.checks else None

    def warned(motion: Recorded) -> Recorded:
        """The motion with the warnings of the cells that it is judged in."""
        used = filter(None, map(loaded, {stretch.scene: None for stretch in motion.stretches}))
        return replace(motion, warnings=(*motion.warnings, *dict.fromkeys(w for cell in used for w in cell.warnings)))

    motions = [_on_base(motion, surroundings.base) for motion in motions]
    motions = motions if surroundings.scene is None else [replace(motion, unseen="") for motion in motions]
    found = tuple(evaluated(robot, warned(motion), rivals, cells, request.payload is not None) for motion in motions)
    asked = replace(
        request, files=names, model=documents(rivals), payload=payload_document(request.payload),
        **as_loaded(robot, request.robot),
    )  # fmt: skip
    desk.take(Answers.answer, asked)
    written = files_of(asked, robot, found)
    answers = desk.keep(Answers(robot=robot, request=asked, stamp=desk.stamp, found=found, given=given, files=written))
    for evaluation in answers.found:
        for note in evaluation.motion.notes:
            desk.say(f"note: {note}")
    warnings = dict.fromkeys(said for each in answers.found for said in each.motion.warnings)
    desk.report(answers.files, warnings=warnings)
    return answers


evaluate = verb(EvaluateRequest, run)


def _as_stated(request: EvaluateRequest, files: Sequence[Path], desk: Desk) -> EvaluateRequest:
    """The request with limits, locked joints and cell that the results state, where it does not state other ones.

    A value is taken only if all files belong to results that state the same one: all motions are in one cell. A `Robot`
    has its own limits and locked joints.
    """
    found = [stated(path) for path in files]
    same = {name: value for name, value in found[0][0].items() if all(values.get(name) == value for values, _ in found)}
    names = IN_CELL if isinstance(request.robot, Robot) else ("limits", "lock", *IN_CELL)
    taken = {name: same[name] for name in names if name in same and getattr(request, name) in (None, ())}
    for note in (note for _, notes in found for note in notes):
        desk.say(f"note: {note}")
    for name, value in taken.items():
        words = ",".join(f"{x:g}" for x in value) if isinstance(value, list) else value
        words = ",".join(f"{joint}={x:g}" for joint, x in value.items()) if isinstance(value, Mapping) else words
        desk.say(f"note: --{name} {words}, as the result states")
    return replace(request, **taken)


def _motions(path: Path, robot: Robot, prefix: str) -> list[Recorded]:
    """The motion of a file, or those of a measured set."""
    if is_set(path):
        return load_set(path, robot)
    found = load(path, robot.joints, prefix, robot.followers)
    t = found.trajectory
    warnings = doubted_units(robot, None if found.timed else t.time, t.position, found.name)
    return [replace(found, notes=(*found.notes, *warnings))]


def _of_caller(motion: Recorded, folder: Path) -> Recorded:
    """The motion, named without the `folder` where it was written for the call."""
    name, *said = (text.replace(f"{folder}/", "") for text in (motion.name, *motion.notes, *motion.warnings))
    count = len(motion.notes)
    return replace(motion, name=name, notes=tuple(said[:count]), warnings=tuple(said[count:]))


def _on_base(motion: Recorded, base: Sequence[float] | None) -> Recorded:
    """The motion, with a remark if it was planned for another base: its torques were others."""
    own = (0.0,) * 6 if base is None else tuple(base)
    if motion.base is None or motion.base == own:
        return motion
    planned = ",".join(f"{value:g}" for value in motion.base)
    return replace(
        motion, notes=(*motion.notes, f"{motion.name}: planned with --base {planned}, which is not given now")
    )


def _row(evaluation: Evaluation) -> dict[str, Any]:
    """The record of a motion in evaluate.json."""
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
        "notes": [*motion.warnings, *motion.notes],
    }


def table(found: Sequence[Evaluation]) -> str:
    """Table of all motions, one column each, for the terminal."""
    files = [Path(evaluation.motion.name) for evaluation in found]
    alike = len({file.name for file in files}) < len(files)
    names = ["/".join(file.parts[-2:]) if alike else file.name for file in files]
    width = max(WIDTH, *(len(name) + 2 for name in names))
    lines = [f"{'':<28}" + "".join(f"{name:>{width}}" for name in names)]

    def line(name: str, values: Sequence[float | str | None], digits: int = 3) -> None:
        words = ("-" if x is None else x if isinstance(x, str) else f"{x:.{digits}f}" for x in values)
        cells = "".join(f"{word:>{width}}" for word in words)
        lines.append(f"{name:<28}{cells}")

    line("duration [s]", [e.motion.trajectory.duration for e in found], 4)
    line("standing still [s]", [float((e.motion.waits[:, 1] - e.motion.waits[:, 0]).sum()) for e in found], 4)
    for model in found[0].energies:
        lines.append(f"under {model} [J]")
        energies = [e.energies[model] for e in found]
        for part in ("total", "standby", "stored", "loss"):
            line(f"  {part}", [getattr(energy, part) for energy in energies])
        lines.append("  the total by effect")
        for effect in dict.fromkeys(name for energy in energies for name in energy.by_effect):
            line(f"    {effect}", [energy.by_effect.get(effect) for energy in energies])
        for name in ("toppra", "scaled"):
            known = [next((b for b in e.baselines if b.name == name), None) for e in found]
            line(
                f"  {name}", [None if b is None else f"{b.energies[model]:.3f}{'' if b.valid else '*'}" for b in known]
            )
    line("peak power [W]", [e.certificate.peak_power for e in found], 1)
    if not all(b.valid for e in found for b in e.baselines):
        lines.append(INVALID)
    for evaluation in found:
        lines.append(f"{evaluation.motion.name}: {_judged(evaluation)}")
    return "\n".join(lines)


def _judged(evaluation: Evaluation) -> str:
    """One sentence on the limits of a motion: the tightest, or the one that is broken."""
    certificate = evaluation.certificate
    worst = certificate.worst
    what = f"{worst['joint']} {worst['limit']} is {worst['value']:.6g} at {worst['time']:.4g} s"
    what += f", bound {worst['bound']:.6g}"
    text = f"all limits kept; tightest: {what}" if certificate.within_limits else f"breaks a limit: {what}"
    if certificate.clearance is not None:
        text += f"; {certificate.clearance}"
    elif evaluation.motion.unseen:
        text += f"; contact is not judged: {evaluation.motion.unseen}"
    return f"{text}; no baselines: {evaluation.remark}" if evaluation.remark else text
