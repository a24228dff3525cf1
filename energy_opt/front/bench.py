"""The verb `bench`: a suite of moves, in parallel and resumable, or the comparison of two runs."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from energy_opt.arguments import expect
from energy_opt.batches.batch import Batch, run_batch
from energy_opt.batches.compare import compare, comparison_text
from energy_opt.batches.suite import load_suite
from energy_opt.batches.tables import CellTable
from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput
from energy_opt.front.desk import Desk, verb
from energy_opt.front.given import cell_of, of_another_arm, payload_from
from energy_opt.power import PowerModel
from energy_opt.requests.verbs import BenchRequest
from energy_opt.results import Listing
from energy_opt.robot import Robot

MOST_JOBS = 1024  # most processes on one machine


def run(request: BenchRequest, desk: Desk) -> Batch | Listing:
    """A suite of moves, in parallel, resumable, with a report in the folder `out`; or two results side by side.

    Raises:
        BadInput: a fault of the suite, or `out` holds another suite's results.
    """
    if request.compare:
        if request.suite is not None:
            raise BadInput("--compare takes two results and no suite")
        if len(request.compare) != 2:
            raise BadInput("--compare takes two results, OLD and NEW")
        found = compare(*map(Path, request.compare))
        return Listing(found, comparison_text(found))
    if request.suite is None:
        raise BadInput("no suite: give SUITE.toml, or --compare OLD NEW")
    jobs = len(os.sched_getaffinity(0)) if request.jobs is None else request.jobs
    if not 1 <= jobs <= MOST_JOBS:
        raise BadInput(f"--jobs {str(jobs)[:24]}: expected 1 to {MOST_JOBS} processes")
    if request.seed is not None and request.seed < 0:
        raise BadInput(f"--seed {request.seed}: expected a whole number, 0 or above")
    worth = request.worth
    suite = load_suite(
        Path(request.suite), overrides=overrides_of(request), seed=request.seed, compile=request.compile,
        allow_outside=request.allow_outside, allow_large=request.allow_large,
    )  # fmt: skip
    pairs = {(task.model, task.robot.name): task for task in suite.tasks}.values()
    foreign = [of_another_arm(name, model, task.robot) for task in pairs for name, model in task.powers()]
    for warning in (*suite.notes, *(f"warning: {said}" for said in foreign if said)):
        desk.say(warning)
    out = Path(request.out or f"bench_{suite.name}")
    asked = replace(request, suite=str(Path(request.suite).resolve()))
    with desk.showing() as show:
        batch = run_batch(
            suite, out, jobs=jobs, resume=request.resume, force=request.force, scheduler=request.scheduler,
            show=show, request={**asked.document(), **desk.stamp}, worth=worth,
        )  # fmt: skip
    if batch.left_out:
        desk.say(f"{batch.left_out} earlier results belong to another version of the suite and were left out")
    if batch.interrupted:
        desk.say(f"interrupted; finished moves are in {out}; --resume runs the remaining ones")
    return replace(batch, request=request)


bench = verb(BenchRequest, run)


def overrides_of(request: BenchRequest) -> dict[str, Any]:
    """A request's values that replace those of every table of a suite, by the suite's keys.

    Raises:
        BadInput: a robot or model that is loaded already; processes need names or files.
    """
    expect(request.overrides, Mapping | None, "overrides")
    out: dict[str, Any] = dict(request.overrides or {})
    for name, given in (("robots", request.robot), ("models", request.model)):
        if isinstance(given, (Robot, PowerModel)):
            raise BadInput(f"{name[:-1]}: bench needs names or files; save the model, or name the URDF")
        if given is not None:
            path = Path(str(given))
            out[name] = [str(path.resolve()) if path.is_file() else str(given)]
    if request.limits is not None:
        out["limits"] = str(Path(request.limits).resolve())
    if isinstance(request.payload, str):
        out["payloads"] = [request.payload]
    elif request.payload is not None:
        held = payload_from(request.payload).values
        out["payloads"] = [",".join(map(repr, [*held["mass"].tolist(), *held["com"].tolist()]))]
    if request.deadline is not None:
        out["settings"] = {"deadline": request.deadline}
    if request.lock:
        out["lock"] = request.locked
    return out | _surroundings(request)


def _surroundings(request: BenchRequest) -> dict[str, Any]:
    """Body and cell by the suite's keys, as far as options state them."""
    around = cell_of(request)
    out = cell_entries(around)
    if request.self_collision is not None:
        out["self_collision"] = around.self_collision
    if request.planner is not None:
        out["planner"] = around.planner
    return out


def cell_entries(around: CellRequest) -> dict[str, Any]:
    """The values of body and cell that differ from the defaults, by the suite's keys; files by their whole paths."""
    out = {key: value for key, value in around.document().items() if key in CellTable.model_fields}
    for key, file in (("scene", around.scene), ("srdf", around.srdf)):
        if file is not None:
            out[key] = str(file.resolve())
    if around.package_dirs:
        out["package_dirs"] = [str(folder.resolve()) for folder in around.package_dirs]
    return out
