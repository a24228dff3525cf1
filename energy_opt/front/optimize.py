"""The verb `optimize`: one move to minimum energy; its answer, the files of this, and the table that is printed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt import formats
from energy_opt.cell.cell import Cell
from energy_opt.cell.load import load_cell
from energy_opt.errors import BadInput, Infeasible
from energy_opt.files import write_json
from energy_opt.folders import written_whole
from energy_opt.formats.controller_files import Written, files_from, unchanged, warnings_on
from energy_opt.front.controllers import Controllers, check_written, kept_words
from energy_opt.front.desk import Answered, Desk, verb
from energy_opt.front.given import cell_of, robot_of
from energy_opt.front.models import compared, members, rivals_of
from energy_opt.front.moves import ends_of, move_of, resolved, settings_of, unused
from energy_opt.motion import Move, Planner, Result, Settings
from energy_opt.motion.judge.energy import Scorer, loss_by_joint
from energy_opt.motion.move import LONGEST, SHORTEST
from energy_opt.motion.plan.robust import RobustPlanner
from energy_opt.motion.timing.toppra import INTERVALS
from energy_opt.poses.cheapest_move import solve_to
from energy_opt.poses.chosen import Chosen
from energy_opt.poses.given import Ends, pose_document
from energy_opt.poses.pose import Pose
from energy_opt.power.assumptions import assumptions_line, until
from energy_opt.power.model import model_from_document
from energy_opt.power.per_year import per_year_words
from energy_opt.reports.optimize import page
from energy_opt.reports.words import INVALID, energy_records, goals_words, input_words, limits_words
from energy_opt.requests.moves import OptimizeRequest
from energy_opt.results import exit_of
from energy_opt.robot import Robot

UNCHECKED = "self-collision is off: whether the arm touches itself was not checked"
FORMAT = "energy-opt/result/1"
STILL = 1e-6  # [rad, m] a joint whose ends are nearer to each other stays where it is


@dataclass(frozen=True, repr=False, kw_only=True, eq=False)
class Answer(Result, Answered):
    """A planned move: `status`, `trajectory`, `energy` [J], `saving`, `baseline(name)`, `certificate`; by name, as
    `["peak_power"]`, the values of result.json.

    Attributes:
        arm: the robot.
        move: as solved; if the goal is a set, with the chosen ends.
        cell: the arm's body and its surroundings; None without collision checks.
        goals: if the goal is a set, the candidates, the nearest one, and the errors of the ends at their poses.
        files: those that `--write` and `--as` ask for, made, read back and judged in the call; `save` writes them.
    """

    arm: Robot
    move: Move
    request: OptimizeRequest
    cell: Cell | None = None
    goals: Mapping[str, Any] = field(default_factory=dict)
    files: tuple[Written, ...] = ()
    answer = "result.json"

    @property
    def per_year(self) -> dict[str, float | None] | None:
        """The saving per year; None if it was not requested."""
        saving, worth = self.saving, self.request.worth
        return None if worth is None else worth.of(None if saving is None else saving["joules"])

    @property
    def year(self) -> str:
        """`per_year` in words; empty if it was not requested."""
        found = self.per_year
        return "" if found is None else per_year_words(found, self.request.cycles_per_year or 0.0)

    @property
    def exit_code(self) -> int:
        """Exit code of the command line."""
        return exit_of(self.interrupted, self.status == "solved" and all(row.valid for row in self.files))

    def document(self) -> dict[str, object]:
        """Content of result.json."""
        worth = {} if self.request.worth is None else {"per_year": self.per_year}
        return {"format": FORMAT, **super().document(), **worth, **self.goals, "request": self.asked}

    def text(self, out: Path) -> str:
        """The short table for a terminal, of an answer that was saved into `out`."""
        return table(self, out, self.arm, self.year)

    def kept(self, out: Path) -> Answer:
        """Write result.json, trajectory.csv, trajectory.yaml, plot.png and report.html into the folder `out`.

        Beside them the files for controllers that the request asks for.
        """
        with written_whole(out, self.answer) as aside:
            own: dict[str, object] = {}
            for name in ("csv", "yaml"):
                form = formats.FORMATS[name]
                path = aside / f"trajectory{form.suffix}"
                form.write(self.trajectory, path)
                own[path.name] = unchanged(path, form, self.trajectory, self.certificate, self.arm).document()
            for row in self.files:  # at a rate, or with a prefix of the joints' names, one may replace trajectory.yaml
                own.pop(row.file, None)
                row.put(aside)
            document = {**self.document(), "written": [*own.values(), *self.written]}
            motions = {b.name: b.trajectory for b in self.baselines}
            lost = _lost(self, self.arm, document)
            report = page(document, self.trajectory, motions, self.arm, self.cell, lost)
            report.write(aside / "report.html", aside / "plot.png")
            write_json(aside / self.answer, document)
        return self


def with_files(answer: Answer, write: Callable[[Result, Path], list[Written]]) -> Answer:
    """The answer with its files, read back and judged.

    Args:
        answer: the answer. write: writes the files that `--write` and `--as` ask for into a folder.
    """
    files = files_from(partial(write, answer))
    bad = "; ".join(f"{row.file}: {row.broken}" for row in files if not row.valid)
    return replace(
        answer, files=files, written=tuple(row.document() for row in files),
        message=answer.message or (bad and f"not every file keeps the limits; {bad}"),
        warnings=(*answer.warnings, *warnings_on(files, answer.request.rate)),
    )  # fmt: skip


def _lost(result: Result, robot: Robot, document: Mapping[str, Any]) -> dict[str, dict[str, np.ndarray]]:
    """Losses (n,) [J] by joint and effect of the result and of a valid "scaled", under the model of the request."""
    model = (document.get("request") or {}).get("model")
    if model is None:
        return {}
    scorer, scaled = Scorer(robot, model_from_document(model, "request")), result.baseline("scaled")
    motions = {"result": result.trajectory, **({"scaled": scaled.trajectory} if scaled and scaled.valid else {})}
    return {name: loss_by_joint(scorer, motion) for name, motion in motions.items()}


def _why_less(result: Result) -> list[str]:
    """Line on why the fastest timing takes less energy than the result, if it does: the overhead lasts less long."""
    fastest, duration = result.baseline("toppra"), result.trajectory.duration
    if fastest is None or fastest.energy.total >= result.energy.total or fastest.duration >= duration:
        return []
    power, own, least = result.energy.standby / duration, f"{duration:.4g}", f"{fastest.duration:.4g}"
    if own == least:
        return []
    rest = duration - fastest.duration
    return [
        f"The fastest timing takes {least} s. In the remaining {rest:.3g} s, standby ({power:.3g} W) takes "
        f"{power * rest:.4g} J."
    ]


def _under(row: Mapping[str, Any]) -> str:
    """Line on the move's energy under one of several models."""
    joules, share = row["saving_joules"], row["saving_loss_percent"]
    if joules is None:
        return f"  under {row['name']}: {row['total']:.3f} J"
    of_loss = "" if share is None else f", {share:.2f} % of the loss"
    uncertainty = ""
    if "saving_joules_interval" in row:
        low, high = row["saving_joules_interval"]
        uncertainty = f"; between {low:.3f} and {high:.3f} J (95 %) by the uncertainty of its data"
    return f"  under {row['name']}: {row['total']:.3f} J, saves {joules:.3f} J{of_loss}{uncertainty}"


def table(result: Result, out: Path, robot: Robot, year: str = "") -> str:
    """The short table for the terminal.

    Args:
        result: the solved move. out: the folder of its files. robot: for the units of joints.
        year: the line on the saving per year, or empty.
    """
    columns = [("result", result.trajectory.duration, result.energy)]
    columns += [(b.marked, b.duration, b.energy) for b in result.baselines]
    lines = [f"{'energy [J]':<22}" + "".join(f"{name:>12}" for name, _, _ in columns)]
    for name, *values in energy_records([(duration, vars(energy)) for _, duration, energy in columns], "{}", "  {}"):
        cells = "".join(f"{value:>12.4f}" if isinstance(value, float) else f"{'-':>12}" for value in values)
        lines.append(f"{name:<22}{cells}")
    lines += [] if all(b.valid for b in result.baselines) else [INVALID]
    beside = input_words(result.document())
    lines += [beside] if beside else _why_less(result)
    several = len(result.models) > 1
    under = f" (under {result.models[0]['name']})" if several and result.saving is not None else ""
    lines.append(result.saved + under)
    lines += [_under(row) for k, row in enumerate(result.models) if (several and k) or "saving_interval" in row]
    goals = goals_words(result.document())
    lines += [goals] if goals else []
    if result.saving is not None and result.saving.joules > 0:
        lines.append(until(result.break_even_friction))
    lines += [year] if year else []
    certificate = result.certificate.document()
    lines.append(limits_words(certificate, robot.unit))
    for row in result.travel:
        joint, units = str(row["joint"]), robot.unit("position", str(row["joint"]))
        k = robot.joints.index(joint)
        at = float(result.trajectory.position[0, k])
        remedy = f"; --lock {joint}={at:.6g} holds it" if abs(result.trajectory.position[-1, k] - at) < STILL else ""
        lines.append(
            f"{joint} travels {row['path']:.3g} {units}, its goal is only {row['straight']:.3g} {units} away{remedy}"
        )
    if result.certificate.clearance is not None:
        lines.append(str(result.certificate.clearance))
    if result.bound:
        lines.append(
            f"no timing of this path takes less than {result.bound} (proven on a grid of {INTERVALS} intervals; gap "
            f"{result.optimality.gap_percent:.1e} %)"
        )
    lines.append(f"files: {out}/result.json, trajectory.csv, trajectory.yaml, plot.png, report.html")
    return "\n".join(lines)


def with_goals(result: Answer, chosen: Chosen, ends: Ends, settings: Settings) -> Answer:
    """The answer with the goals that were considered, and the errors of its ends at their poses.

    It is `not_converged` if an end misses the tolerance of its pose.

    Args:
        result: the solved move. chosen: the goals that were compared.
        ends: as asked for; of several goals, the pose that the motion ends nearest to counts. settings: with the tool.
    """
    positions = result.trajectory.position
    at = {"start": positions[0]}
    for k, q in enumerate(chosen.move.via, start=1):
        at[f"via {k}"] = result.trajectory(np.array([result.trajectory.time_nearest_to(q)]))[0]
    said = pose_document(result.arm, settings.tool, ends.poses, at)
    if chosen.candidates[0].pose is not None:
        goals = {str(k): goal for k, goal in enumerate(ends.goals) if isinstance(goal, Pose)}
        missed = pose_document(result.arm, settings.tool, goals, dict.fromkeys(goals, positions[-1]))
        said["goal"] = min(missed.values(), key=lambda end: (not end["valid"], end["distance"], end["angle"]))
    status = result.status
    if not all(end["valid"] for end in said.values()):
        status = "not_converged"
    warnings = (*result.warnings, *chosen.warnings)
    return replace(result, status=status, goals={**chosen.document(), "poses": said}, warnings=warnings)


def solved(solve: Callable[[Move], Result], move: Move, asked: Move) -> tuple[Result, Move]:
    """Solve a move. If the given trajectory is too fast for the limits, the duration becomes free.

    Args:
        solve: the planner. move: at the duration of the given trajectory. asked: the move as asked for.

    Returns:
        The result, and the move that was solved.

    Raises:
        Infeasible: no motion keeps the limits.
    """
    try:
        return solve(move), move
    except Infeasible as error:
        if move == asked or error.shortest_duration is None:
            raise
        said = f"the {move.duration:.4g} s of the given trajectory are too short ({error}); the duration is free"
    result = solve(asked)
    if move.duration is not None and abs(result.duration - move.duration) <= 1e-9:  # the given trajectory itself
        return result, asked
    return replace(result, warnings=(*result.warnings, said)), asked


def run(request: OptimizeRequest, desk: Desk) -> Answer:
    """One move to minimum energy, judged, beside its baselines.

    Raises:
        BadInput: an argument is not usable; the message names it and what is expected.
        Infeasible: no motion keeps the limits; the message names the limit, the place, and what would work.
    """
    robot, _ = robot_of(request), request.worth
    check_written(request, robot)
    if request.vias is not None and request.standard is None:
        raise BadInput("--vias belongs to --as moves; give --as moves, too")
    rivals, kind = rivals_of(request, robot)
    settings, around = settings_of(request), cell_of(request)
    ends = ends_of(request, robot, around, desk.say)
    given = move_of(request, robot, ends, desk.say, duration=request.duration, max_duration=request.max_duration)
    move, free = given, given.duration is None and given.max_duration is None and settings.objective != "time"
    if free and given.input is not None and SHORTEST <= given.input.duration <= LONGEST:
        move = replace(given, duration=given.input.duration)
    asked = resolved(request, robot, rivals, kind, given, ends)
    document = desk.take(Answer.answer, asked)
    with desk.working() as (stopped, _):
        cell = load_cell(robot, around)
        known: dict[str, Any] = {"cell": cell, "stopped": stopped}
        planner = Planner(robot, rivals[0].model, settings, **known)
        robust = None if kind is None else RobustPlanner(robot, rivals, kind, settings, **known)
        controllers, chosen = Controllers(request, planner, robust), None
        try:
            if ends is None:
                found, move = solved(controllers.solver.solve, move, given)
            else:
                chosen = solve_to(
                    ends, move, robot, members(rivals), cell, settings, controllers.solver, kind == "worst"
                )
                found, move = chosen.result, chosen.move
            found, moves = controllers.with_room(move, *controllers.moves(move, found))
            found = compared(found, rivals, robot)
            said = [*(remark for rival in rivals for remark in rival.remarks), *unused(request)]
            if request.self_collision is False:
                said.append(UNCHECKED)
            found = replace(found, warnings=(*found.warnings, *said))
            answer = Answer(
                **{f.name: getattr(found, f.name) for f in fields(Result)},
                arm=robot, move=move, request=asked, stamp=desk.stamp, cell=cell,
            )  # fmt: skip
            if ends is not None and chosen is not None:
                answer = with_goals(answer, chosen, ends, settings)
        except Infeasible as fault:
            error = fault if ends is not None else replace(controllers, request=asked).with_duration(move, fault)
            desk.failed(
                Answer.answer, error, robot=robot.name, joints=list(robot.joints), mode=move.mode,
                duration=move.duration, request=document,
            )  # fmt: skip
            raise error from None
        answer = desk.keep(with_files(answer, partial(controllers.write, move, moves)))
    desk.report(answer.files, assumptions_line(answer.assumptions), answer.warnings)
    if moves is not None:
        desk.say(kept_words(moves))
    if answer.message:
        desk.say(f"{answer.status}: {answer.message}")
    return answer


optimize = verb(OptimizeRequest, run)
