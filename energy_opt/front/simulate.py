"""The verb `simulate`: measured sets of a virtual arm."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.cell.load import load_cell
from energy_opt.errors import BadInput, Infeasible
from energy_opt.files import path_of, read_toml, to_json
from energy_opt.folders import no_other_verb, take_folder, written_whole
from energy_opt.formats import read
from energy_opt.formats.recording import motion_of
from energy_opt.front.desk import Desk, verb
from energy_opt.front.given import as_loaded, cell_of, model_from, of_another_arm, on_arm, payload_document, robot_of
from energy_opt.front.motion_files import motion_files, trajectory_of
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel
from energy_opt.power.known import is_named, named_model
from energy_opt.power.variants import of_joints
from energy_opt.requests.verbs import SimulateRequest
from energy_opt.results import FoundSet
from energy_opt.robot import Robot, robot_named
from energy_opt.robot.degrees import doubted_units
from energy_opt.virtual_arm.plant import Plant, load_plant
from energy_opt.virtual_arm.simulate import Instruments, Reference, Run, pose
from energy_opt.virtual_arm.simulate import simulate as simulated

MOST_REPEATS = 100_000
BRIEFEST = 0.1  # [s] shortest pose that is held, so that a meter has some readings
MOST_SECONDS = 3600.0  # [s] longest motion: 4 million steps, some minutes and 2 GB


@dataclass(frozen=True, repr=False, eq=False)
class Simulation(FoundSet):
    """A measured set of a virtual arm, in the folder `out`: `runs`, each with its true `energy` [J].

    Attributes:
        robot: the arm. plant: its true effects.
        runs: what was played and measured. sources: the file that each comes from. request: what was asked.
    """

    out: Path
    robot: Robot
    plant: Plant
    runs: tuple[Run, ...]
    sources: tuple[str, ...]
    request: SimulateRequest

    def document(self) -> dict[str, Any]:
        """Folder, robot, effects of the plant, and the runs, with start and duration [s] and energy [J]."""
        records = [
            {"file": r.file, "trajectory": s, "start": r.start, "duration": r.duration, "energy": r.energy}
            for r, s in zip(self.runs, self.sources, strict=True)
        ]
        plant = [*(each.name for each in self.plant.model.effects), *(each.name for each in self.plant.specials)]
        return {"out": str(self.out), "robot": self.robot.name, "plant": plant, "runs": records}

    def __repr__(self) -> str:
        return f"Simulation({str(self.out)!r}, {self.robot.name!r}, {len(self.runs)} runs)"


def run(request: SimulateRequest, desk: Desk) -> Simulation:
    """Play trajectories on a virtual arm with the effects of a plant, and write a measured set into the folder `out`.

    Raises:
        BadInput: a value that no arm or instrument has, or `out` holds other data.
        Infeasible: a trajectory touches the arm's own body or its cell.
    """
    if not request.trajectories:
        raise BadInput("no TRAJECTORY; give one or more to play")
    if not 1 <= request.repeat <= MOST_REPEATS:
        raise BadInput(f"--repeat {request.repeat}: expected 1 to {MOST_REPEATS}")
    for name in ("resolution", "encoder"):
        if not getattr(request, name) > 0:
            raise BadInput(f"--{name} {getattr(request, name)}: expected a number above 0")
    if request.seed < 0:
        raise BadInput(f"--seed {request.seed}: expected 0 or more")
    out, given = Path(request.out), request.plant
    if isinstance(given, str) and is_named(given):
        given = named_model(given, robot_of(request))
    file = Path("plant") if isinstance(given, PowerModel) else path_of(given, "--plant")
    plant = Plant(given) if isinstance(given, PowerModel) else load_plant(file)
    named = None if request.robot is not None else robot_named(plant.model.robot, file.parent, request.allow_outside)
    robot = robot_of(request, named)
    if said := of_another_arm(str(file), plant.model, robot):
        desk.say(f"warning: {said}")
    plant = replace(plant, model=on_arm(of_joints(plant.model, robot), request, robot))
    declared = None if request.model is None else model_from(request.model, robot)
    same = {name: getattr(request, name) for name in ("rate", "meter_rate", "noise", "jitter", "rest")}
    resolutions = {"power_resolution": request.resolution, "position_resolution": request.encoder}
    instruments = Instruments(**same, **resolutions, extra=tuple(request.log))
    motions: Any = request.trajectories
    with motion_files(map(trajectory_of, motions), request.joint_prefix) as (_, names, files):
        played = [_played(path, robot, request.joint_prefix, desk) for path in files]
    request = replace(request, trajectories=names)
    references, sources = _references(request, robot, list(zip(played, map(Path, names), strict=True)), desk)
    asked = replace(
        request, **as_loaded(robot, request.robot), payload=payload_document(request.payload),
        model=None if declared is None else declared.to_document(),
    )  # fmt: skip
    truth = {"request": to_json({key: value for key, value in asked.document().items() if key != "out"})}
    _guard(request, truth["request"], desk.force or request.force)
    with desk.showing(), written_whole(out, "log.toml", simulated_files(out)) as aside:
        runs = simulated(references, plant, robot, aside, seed=request.seed, instruments=instruments, truth=truth)
        if declared is not None:
            declared.save(aside / "declared.toml")
    for j, joint in enumerate(robot.joints):
        worst, limit = max(float(abs(r.played.torque[:, j]).max()) for r in runs), robot.limits.effort[j]
        if worst > limit:
            unit = robot.unit("effort", joint)
            desk.say(f"warning: {joint}: needed {worst:.3g} {unit}, its limit is {limit:.3g} {unit}")
    used, duration = sum(r.energy for r in runs), sum(r.duration for r in runs)
    desk.say(f"{out}: {len(runs)} runs, {duration:.1f} s, {used:.1f} J true energy")
    return Simulation(out, robot, plant, tuple(runs), tuple(sources), request)


simulate = verb(SimulateRequest, run)


def simulated_files(out: Path) -> list[str]:
    """Files of the runs in a folder if it holds a simulated set, not a measured one."""
    if not (out / "truth.toml").is_file() or not (out / "log.toml").is_file():
        return []
    try:
        records = read_toml(out / "log.toml").get("run", [])
    except BadInput:
        return []
    names = [str(row[key]) for row in records for key in ("file", "power_file") if key in row]
    return ["declared.toml", *(name for name in names if Path(name).name == name and (out / name).is_file())]


def _guard(request: SimulateRequest, asked: str, force: bool) -> None:
    """Refuse to overwrite measured data, results, or the simulation of another request, unless forced.

    Args:
        asked: the request as truth.toml has it.
    """
    out = Path(request.out)
    take_folder(out)
    if not force:
        no_other_verb(out, "log.toml")
    if force or not (out / "log.toml").exists():
        return
    truth = out / "truth.toml"
    if not truth.is_file() or read_toml(truth).get("request") != asked:
        held = "the simulation of another request" if truth.is_file() else "a measured set"
        raise BadInput(f"{out} holds {held}; choose another --out, or overwrite it with --force")


def _references(
    request: SimulateRequest, robot: Robot, files: list[tuple[Trajectory, Path]], desk: Desk
) -> tuple[list[Reference], list[str]]:
    """References to play, in order, named run01, run02, ..., and the file that each comes from."""
    if request.static != 0 and not BRIEFEST <= request.static < np.inf:
        raise BadInput(f"--static {request.static:g}: expected 0, or {BRIEFEST:g} s and more")
    _check_clear(request, robot, files, desk)
    given = [(Reference(path.stem, t.time, t.position, t.velocity), str(path)) for t, path in files]
    out: list[Reference] = []
    sources: list[str] = []
    seconds = request.repeat * sum(reference.duration + 2 * request.rest + request.static for reference, _ in given)
    if not seconds <= MOST_SECONDS and not request.allow_large:
        raise BadInput(
            f"{seconds:.6g} s to simulate; at most {MOST_SECONDS:g} s without --allow-large (are the times seconds?)"
        )
    for reference, source in given * request.repeat:
        if request.static > 0:
            out.append(pose(f"run{len(out) + 1:02d}", reference.position[0], request.static))
            sources.append(source)
        out.append(replace(reference, name=f"run{len(out) + 1:02d}"))
        sources.append(source)
    return out, sources


def _played(path: Path, robot: Robot, prefix: str, desk: Desk) -> Trajectory:
    """The motion in a file as `evaluate` reads it; notes are said.

    Raises:
        BadInput: no motion can be read, or its positions are degrees.
    """
    samples = read(path).of(robot.joints, prefix, robot.followers)
    doubts = doubted_units(robot, samples.doubtful, samples.position, samples.where)
    trajectory, notes = motion_of(samples)
    for note in (*samples.notes, *notes, *doubts):
        desk.say(f"note: {note}")
    return trajectory


def _check_clear(request: SimulateRequest, robot: Robot, files: list[tuple[Trajectory, Path]], desk: Desk) -> None:
    """Refuse trajectories that collide.

    Raises:
        Infeasible: a trajectory touches the arm's own body or its cell; names pair, time and depth.
    """
    cell = load_cell(robot, cell_of(request))
    if cell is None:
        return
    for trajectory, path in files:
        t = trajectory
        found = cell.prove(t.time, t.position, t.velocity, t.acceleration)
        if found.verdict == "colliding":
            raise Infeasible(
                f"{path}: {found}; --self-collision off (and no --scene) plays it anyway",
                limit="clearance", position=found.time, excess=found.depth,
            )  # fmt: skip
        if not found.proven:
            desk.say(f"warning: {path}: {found}")
