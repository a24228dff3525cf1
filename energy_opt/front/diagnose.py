"""The verb `diagnose`: what the declared model lacks, from measured data."""

from __future__ import annotations

import logging
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import numpy as np

from energy_opt.cell.load import load_cell
from energy_opt.cell.request import CellRequest
from energy_opt.diagnosis import Diagnosis
from energy_opt.diagnosis import diagnose as diagnosed
from energy_opt.diagnosis.report.words import next_step
from energy_opt.effects import CopperLoss, Standby
from energy_opt.errors import BadInput
from energy_opt.folders import written_whole
from energy_opt.formats import table
from energy_opt.front.desk import Desk, verb
from energy_opt.front.given import cell_of, model_from, on_arm, request_of_set, robot_of, robot_of_set
from energy_opt.front.moves import documents
from energy_opt.measured import MeasuredSet, read_set
from energy_opt.motion.plan.robust_models import Rival
from energy_opt.motion.trajectory import Trajectory
from energy_opt.next_motion.motion_search import propose
from energy_opt.next_motion.recordings import MOST, recordings
from energy_opt.next_motion.rival_models import rivals_of
from energy_opt.next_motion.worth import add_worth, worth_words
from energy_opt.passports.changes import changes_since
from energy_opt.power import PowerModel, load_model, source_method_2
from energy_opt.power.variants import of_joints
from energy_opt.power.warm import warmed
from energy_opt.requests.verbs import DiagnoseRequest
from energy_opt.results import Found

NEXT = "next_motion.csv"
ALIKE = (
    "Next: plan under all alternatives (optimize --model model.toml --robust mean); the proposed motion may still tell "
    "them apart."
)


@dataclass(frozen=True, repr=False, eq=False)
class Diagnosed(Found, Diagnosis):
    """A diagnosis: `verdict`, the claimed `effects`, the calibrated `model`, `next_motion`; by name, as `["usable"]`,
    the values of diagnosis.json.

    Attributes:
        request: the request; `run` repeats it.
        next_motion: the motion to record next, if one would help.
        interrupted: stopped early.
    """

    request: DiagnoseRequest | None = None
    next_motion: Trajectory | None = None
    interrupted: bool = False
    answer = "diagnosis.json"
    __str__ = Diagnosis.__str__

    @property
    def exit_code(self) -> int:
        """Exit code of the command line."""
        return 130 if self.interrupted else 0

    def kept(self, out: Path) -> Diagnosed:
        """Write the files of `Diagnosis.save` and the motion to record next into the folder `out`."""
        with written_whole(out, self.answer) as aside:
            if self.next_motion is not None:
                table.write(self.next_motion, aside / NEXT)
            Diagnosis.save(self, aside)
        return self


def run(request: DiagnoseRequest, desk: Desk) -> Diagnosed:
    """What the declared model lacks, from measured data, and what that is worth.

    Raises:
        BadInput: a fault of the set or of the model.
    """
    folder = Path(request.set)
    robot = robot_of_set(request, folder) if request.robot is None else robot_of(request)
    with desk.showing() as show:
        show.stage("reading", 0.0, 1.0)
        measured = read_set(folder, robot, allow_outside=request.allow_outside, meter=False)
    declared, given, words = _declared(request, measured)
    declared = on_arm(declared, request, robot)
    asked = request_of_set(request, robot, model=documents([Rival("declared", declared)])[0])
    surroundings = cell_of(request)  # for the motion to record next
    if not 0 < request.tolerance <= 100:
        raise BadInput(f"--tolerance {request.tolerance:g}: expected per cent of the energy, above 0 and at most 100")
    document = desk.take(Diagnosed.answer, asked)
    with desk.working() as (stopped, show):
        show.stage("searching", 0.0, 1.0)
        found = diagnosed(measured, declared, request.seed, request.tolerance, given, stopped)
    result = Diagnosed(**{f.name: getattr(found, f.name) for f in fields(Diagnosis)}, request=asked)
    result.document()["request"] = document
    since = changes_since(declared, result.model, measured.robot) if declared.uncertainty is not None else []
    result.document()["changes"] = [asdict(change) for change in since]
    if words:
        result.document()["remarks"].insert(0, words)
    motion = None
    with desk.working() as (pressed, _):
        result = desk.keep(result)
    if result.samples is not None and not result.document()["interrupted"] and not pressed():
        motion = _next_motion(result, request.seed, surroundings)
        with desk.working() as (pressed, show):
            show("benefit of the diagnosis: two plans of the set's longest move")
            add_worth(result, surroundings, seed=request.seed, stopped=pressed)
            result = desk.keep(replace(result, next_motion=motion))
    worth = [worth_words(result.document()["worth"])] if result.document().get("worth") else []
    models = "model.toml" + (", model_warm.toml" if warmed(result.model) is not None else "")
    where = [] if desk.out is None else [f"written: {desk.out / Diagnosed.answer}, {models}, report.html"]
    desk.say("\n".join([str(result), *worth, *where]))
    for change in (x for x in since if x.real):
        desk.say(f"changed since {request.model}: {change}")
    return replace(result, interrupted=bool(result.document().get("interrupted") or pressed()))


diagnose = verb(DiagnoseRequest, run)


def _declared(request: DiagnoseRequest, measured: MeasuredSet) -> tuple[PowerModel, tuple[str, ...], str]:
    """The model to start from, its effects that are fitted but not reported, and a remark on it."""
    if request.model is not None:
        return model_from(request.model, measured.robot), (), ""
    own = measured.path / "declared.toml"
    if own.is_file():
        return of_joints(load_model(own), measured.robot), (), f"No --model: starting from the set's own {own.name}."
    if not any(len(run.power) for run in measured.runs):
        return source_method_2(measured.robot), (), "No --model: standby and copper loss are source-method-2's."
    level = float(np.quantile(np.concatenate([run.power for run in measured.runs]), 0.2))
    # to start from, a usual copper loss [W/(N m)^2]: two watts at three tenths of the effort limit
    heat = CopperLoss(r_over_kt2=[2.0 / (0.3 * effort) ** 2 for effort in measured.robot.limits.effort])
    start = PowerModel(measured.robot.name, (Standby(power=max(level, 0.0)), heat))
    said = "No --model: starting from mechanical power; standby and copper loss are fitted and not reported as causes."
    return start, ("standby", "copper_loss"), said


def _next_motion(result: Diagnosis, seed: int, surroundings: CellRequest) -> Trajectory | None:
    """The motion to record next, if one would help; a diagnosis does not fail if none is found."""
    if result.verdict not in ("ambiguous", "insufficient") or result.inference is None:
        return None
    robot, remarks = result.measured.robot, result.document()["remarks"]
    try:
        cell = load_cell(robot, surroundings)
        motion = propose(rivals_of(result.inference, robot.n), robot, seed, cell)
        count: int | None = 1
        if motion is not None and result.verdict == "ambiguous":
            count = recordings(result.inference, motion.trajectory)
    except KeyboardInterrupt:  # the results so far are written
        result.document()["interrupted"] = True
        remarks.append("No motion to record next is proposed: the search for one was interrupted.")
        return None
    except Exception as error:  # the results exist already; an error of bodies, meshes or limits must not lose them
        logging.getLogger(__name__).debug("the search for the next motion failed", exc_info=True)
        remarks.append(f"No motion to record next is proposed: {error}.")
        return None
    if motion is None:
        remarks.append(
            "No motion distinguishes the alternatives: the meter would show the same power under all of them."
        )
        return None
    result.document()["next_motion"] = NEXT
    result.document()["next_step"] = next_step(result.document())
    usable = result.document()["usable"]
    text = f"Record {NEXT} next: on this motion the alternatives"
    text = f"To tell the alternatives apart, record {NEXT}: on this motion they" if usable else text
    text += f" predict powers that differ by {motion.difference:.3g} W (rms)."
    if result.verdict == "insufficient":
        text += " Record it at least once; each further recording lowers the noise."
    elif count is None:
        text += f" Even {MOST} recordings may not decide between them, because they are too similar."
        if not usable:
            result.document()["next_step"] = ALIKE
    else:
        text += f" Record it {count} times: one recording is hardly enough." if count > 1 else " Record it once."
    remarks.append(text)
    return motion.trajectory
