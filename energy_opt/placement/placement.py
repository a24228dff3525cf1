"""A placement: the box for the base and the effort of the search that are asked for, and the answer with its files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.cell.load import scene_of
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene import FARTHEST, WORLD
from energy_opt.errors import BadInput
from energy_opt.files import plain, write_json
from energy_opt.folders import written_whole
from energy_opt.jobs.cycle import Plan
from energy_opt.jobs.file import Job
from energy_opt.jobs.job_files import write as write_job
from energy_opt.jobs.legs import at_step
from energy_opt.jobs.posed import Ends
from energy_opt.jobs.solve_job import JobResult
from energy_opt.poses.pose import numbers_of
from energy_opt.reports.page import Report
from energy_opt.results import interrupted_words

AXES = ("x", "y", "z", "yaw")
FORM = "X0,X1,Y0,Y1,Z0,Z1 [m], then nothing, `yaw` or YAW0,YAW1 [rad]"


@dataclass(frozen=True)
class PlaceRequest:
    """The box of a search for the base's pose.

    Attributes:
        box: lowest and highest x, y and z of the base in the scene's frame [m].
        yaw: lowest and highest yaw [rad]; None for the given yaw.
        fixture: the object of the scene to place in the box instead of the base; None for the base.
        looked_at: number of placements at which the job is estimated.
        seeds: number of best estimates at which the job is solved.
        steps: most placements at which it is solved roughly after these.
    """

    box: tuple[float, float, float, float, float, float]
    yaw: tuple[float, float] | None = None
    looked_at: int = 120
    seeds: int = 3
    steps: int = 5
    fixture: str | None = None

    def __post_init__(self) -> None:
        if len(self.box) != 6 or not np.isfinite(self.box).all() or np.abs(self.box).max() > FARTHEST:
            raise BadInput(f"--base-box: expected {FORM}, at most {FARTHEST:g} m")
        pairs = [self.box[0:2], self.box[2:4], self.box[4:6], self.yaw or (0.0, 0.0)]
        for axis, (low, high) in zip(AXES, pairs, strict=True):
            if not low <= high:
                raise BadInput(f"--base-box: {axis} begins at {low:g} and ends at {high:g}; expected the smaller first")
        if np.abs(pairs[3]).max() > 4 * np.pi:
            raise BadInput(f"--base-box: yaw {pairs[3][0]:g}, {pairs[3][1]:g}: expected rad")
        for name, least in (("looked_at", 1), ("seeds", 1), ("steps", 0)):
            if not least <= getattr(self, name) <= 10_000:
                raise BadInput(f"--{name.replace('_', '-')} {getattr(self, name)}: expected {least} to 10000")

    @classmethod
    def of(cls, words: str, **more: Any) -> PlaceRequest:
        """From X0,X1,Y0,Y1,Z0,Z1 [m], and `yaw` (all round) or YAW0,YAW1 [rad]; `more` are further fields.

        Raises:
            BadInput: another form, a range whose end is below its beginning, or a value that no search has.
        """
        parts = [part.strip() for part in words.split(",")]
        turning = len(parts) == 7 and parts[6].lower() == "yaw"
        try:
            numbers = [float(part) for part in parts[: 6 if turning else None]]
        except ValueError:
            numbers = []
        if len(numbers) not in (6, 8):
            raise BadInput(f"--base-box {words}: expected {FORM}")
        yaw = (-np.pi, np.pi) if turning else (numbers[6], numbers[7]) if len(numbers) == 8 else None
        x0, x1, y0, y1, z0, z1 = numbers[:6]
        return cls((x0, x1, y0, y1, z0, z1), yaw, **more)

    def bounds(self, given: tuple[float, ...]) -> np.ndarray:
        """Lowest and highest x, y, z [m] and yaw [rad], (4, 2); by default the given yaw (x, y, z, roll, pitch,
        yaw).
        """
        yaw = self.yaw or (given[5], given[5])
        return np.array([self.box[0:2], self.box[2:4], self.box[4:6], yaw])


def in_scene(job: Job, cell: CellRequest) -> Job:
    """The job with its poses fixed in the scene, as seen from the given base."""
    steps = list(job.steps)
    for k in job.open:
        pose = steps[k].pose
        assert pose is not None
        if not pose.frame:
            steps[k] = replace(steps[k], pose=replace(pose, matrix=cell.base_pose @ pose.matrix, frame=WORLD[0]))
    return replace(job, steps=tuple(steps))


def check_scenes(job: Job, cell: CellRequest) -> None:
    """Raise BadInput if an object's place depends on that of the base: it is in the frame of a link beside the root."""
    links = {name for name, (_, at) in job.robot.body.link_frames().items() if not np.allclose(at, np.eye(4))}
    for scene in filter(None, map(scene_of, {at_step(cell, step) for step in job.steps})):
        for thing in scene.objects:
            if thing.still_in in links:
                raise BadInput(f"{scene.source}: object {thing.name}: its frame {thing.still_in} moves with the base; "
                               f"give its pose in the scene's frame, {WORLD[0]}")  # fmt: skip


def fixture_pose(job: Job, cell: CellRequest, fixture: str) -> tuple[float, ...]:
    """The placement of a fixture: x, y, z [m], roll, pitch, yaw [rad] (6,) of its frame in the scene's.

    Args:
        job: its steps name the fixture. cell: with the scene, unless the job has its own. fixture: the object's name.

    Raises:
        BadInput: no step ends at a pose in that frame, or there is no scene with such an object.
    """
    steps = [step for step in job.steps if step.pose is not None and step.pose.frame == fixture]
    if not steps:
        raise BadInput(f"{job.name}: no step ends at a pose in the frame of {fixture!r}, so its place changes nothing; "
                       f'give `pose = "{fixture}: X,Y,Z,R,P,Y"`')  # fmt: skip
    scene = scene_of(at_step(cell, steps[0]), job.robot)
    if scene is None:
        raise BadInput(f"{job.name}: no scene has the object {fixture!r}; give --scene")
    known = {thing.name: thing for thing in scene.objects}
    if fixture not in known:
        scene.with_object_at(fixture, np.eye(4))
    return numbers_of(known[fixture].place)


@dataclass(frozen=True)
class Rough:
    """A rough cycle at a placement x, y, z, yaw (4,): positions at its ends, motions, and energy [J].

    Without motions, and of infinite energy, if none was found.
    """

    point: np.ndarray
    ends: Ends
    plan: Plan | None
    energy: float


@dataclass(frozen=True)
class Looked:
    """A placement considered: pose (6,), estimate or energy [J] (not finite: no cycle is known), and its kind."""

    place: tuple[float, ...]
    energy: float
    kind: str

    def document(self, what: str) -> dict[str, Any]:
        """Its record in place.json."""
        return {what: list(self.place), "energy_total": self.energy if np.isfinite(self.energy) else None,
                "kind": self.kind}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Placement:
    """The cheapest placement of the base, or of a fixture.

    Attributes:
        place: its x, y, z [m], roll, pitch, yaw [rad] in the scene's frame; result: the job solved there.
        given, given_result: the pose that was given, and the job there; None if it cannot be done there.
        looked_at: estimates all over the box; path: the placements at which the job was solved, in order.
        warnings: notes for the reader. interrupted: stopped early.
    """

    place: tuple[float, ...]
    result: JobResult
    given: tuple[float, ...]
    given_result: JobResult | None
    looked_at: tuple[Looked, ...]
    path: tuple[Looked, ...]
    warnings: tuple[str, ...]
    fixture: str | None = None
    interrupted: bool = False

    @property
    def what(self) -> str:
        """Key of the placed pose in place.json."""
        return "base" if self.fixture is None else "pose"

    @property
    def solved(self) -> bool:
        """Was the search finished, and is the job at the answer solved, proven clear and within all limits?"""
        return not self.interrupted and self.result.solved

    def document(self) -> dict[str, Any]:
        """The content of place.json without the request; energies in J."""
        here, there = self.result.energy, None if self.given_result is None else self.given_result.energy
        saving = None if there is None else {"joules": there - here, "percent": 100 * (1 - here / there)}
        choice = self.result.choice
        return {
            "format": "energy-opt/place-result/1",
            "status": "solved" if self.solved else "not_converged",
            "robot": self.result.job.robot.name,
            **({} if self.fixture is None else {"fixture": self.fixture}),
            self.what: list(self.place),
            "energy_total": here,
            "given": {self.what: list(self.given), "energy_total": there},
            "saving": saving,
            "goals": [] if choice is None else [{"step": k + 1, "goal": q.tolist()} for k, q in choice.ends.items()],
            "path": [at.document(self.what) for at in self.path],
            "looked_at": [at.document(self.what) for at in self.looked_at],
            "solves": len(self.path),
            "warnings": [*interrupted_words(self.interrupted), *self.warnings],
            "interrupted": self.interrupted,
        }


def write(placement: Placement, request: Mapping[str, Any], job: Mapping[str, Any], out: Path) -> dict[str, Any]:
    """Write place.json, map.png, report.html and the job's folder.

    Args:
        placement: the answer. request: its document. job: that of the job at the answer. out: the folder.

    Returns:
        The content of place.json.
    """
    from energy_opt.reports.plots import plot_placements, png

    found = {**placement.document(), "request": plain(request)}
    with written_whole(Path(out) / "job", "job.json") as aside:
        write_job(placement.result, job, aside)
    looked = placement.looked_at
    places = np.array([at.place[:2] for at in looked]).reshape(-1, 2)
    solved = [at for at in placement.path if np.isfinite(at.energy) and at.kind in ("seed", "step")]
    solved = [
        at for at in solved if at.kind == "step" or at.energy == min(s.energy for s in solved if s.kind == "seed")
    ]
    energies = np.array([at.energy for at in looked])
    path = [at.place[:2] for at in solved if at.place != placement.place]
    given = placement.given[0], placement.given[1]
    figure = plot_placements(places[:, 0], places[:, 1], energies, [*path, placement.place[:2]], given)  # type: ignore[list-item]
    picture = png(figure)
    (Path(out) / "map.png").write_bytes(picture)
    what = placement.fixture or "base"
    report = Report(f"{found['robot']}: the cheapest place of the {what}").headline(headline(found))
    report.warning(*found["warnings"])
    report.picture(picture, f"Estimates of the cycle's energy over x and y of the {what}, and the path of the search")
    records = [[at.kind, *at.place, at.document("")["energy_total"]] for at in placement.path]
    report.section("Placements at which the job was solved").table(
        ["", "x [m]", "y [m]", "z [m]", "roll [rad]", "pitch [rad]", "yaw [rad]", "energy [J]"], records
    )
    report.section("The job at the answer").text("job/report.html is the report of this job.").command(request)
    report.write(Path(out) / "report.html")
    write_json(Path(out) / "place.json", found)
    return found


def headline(found: Mapping[str, Any]) -> str:
    """A summary in one sentence."""
    what = found.get("fixture")
    x, y, z, _, _, yaw = found["base" if what is None else "pose"]
    at = f"{what or 'Base'} at x {x:.4g} m, y {y:.4g} m, z {z:.4g} m, yaw {yaw:.4g} rad"
    models = [model["name"] for model in (found["request"].get("robust") or {}).get("models", ())]
    mean = f" in the mean of {' and '.join(models)}" if models else ""
    words = f"{at}: {found['energy_total']:.4g} J a cycle{mean}"
    if found["saving"] is None:
        return words + "; the job is not possible at the given place."
    given, percent = found["given"]["energy_total"], found["saving"]["percent"]
    compared = f"{abs(percent):.3g} % {'less' if percent >= 0 else 'more'}"
    return words + f", {compared} than the {given:.4g} J at the given place."
