"""Suites: a TOML file that names robots, moves, modes, durations, payloads, models and objectives.

    format = "energy-opt/suite/1"
    name = "example"
    robots = ["panda", "my_arm.urdf"]
    random = { count = 20, seed = 1, range = 0.6 }
    modes = ["retime", "reshape"]
    durations = [2.0, "1.5x", "free"]
    payloads = [0, "1.5,0,0,0.1"]
    models = ["source_method_2", "my_model.toml"]      # default: "mean", of source_method_2 and careful
    objectives = ["energy", "torque"]

    [[moves]]
    name = "across"
    start = [0, -0.785, 0, -2.356, 0, 1.571, 0.785]
    goal = { panda_joint1 = 1.2, ... }      # every joint by name, or a list in order
    durations = [2.0]                       # optional: instead of the suite's

    [[moves]]
    name = "to the part"
    start = [0, -0.785, 0, -2.356, 0, 1.571, 0.785]
    goal_pose = [0.5, 0.1, 0.3, 3.14159, 0, 0]   # of the tool; also start_pose, via_pose = [...], pose_tolerance
    free = ["rz"]

    [[groups]]                              # optional: further products; what a group does not say, the top level does
    robots = ["ur5"]

Every robot meets every move, mode, duration, payload, model and objective. Files are named relative to the suite.
"""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from energy_opt.batches.entries import MEAN, NAMES, OF_POSES, Group, read_group
from energy_opt.batches.faults import Faults, Files
from energy_opt.batches.moves import NamedMove, given_path, joint_values, posed_move, random_moves
from energy_opt.batches.task import Duration, Task
from energy_opt.effects import loaded_sources
from energy_opt.errors import BadInput, near
from energy_opt.files import read_toml, to_json
from energy_opt.power.known import named_model
from energy_opt.power.variants import of_joints
from energy_opt.robot import Robot

FORMAT = "energy-opt/suite/1"
MEMBERS = ("source-method-2", "careful")  # of the mean
NAME = re.compile(r"[^\W_][\w .+-]*")  # it becomes a folder's name
COMPILE_FROM = 20  # tasks on one built problem from which a compiler pays for itself


@dataclass(frozen=True)
class Suite:
    """A suite with everything resolved; `tasks` in the order of its results."""

    name: str
    path: Path
    tasks: tuple[Task, ...]

    @property
    def digest(self) -> str:
        """Changes with anything that could change a result."""
        return hashlib.sha256("".join(task.key for task in self.tasks).encode()).hexdigest()[:24]


def load_suite(
    path: str | Path,
    *,
    overrides: Mapping[str, Any] | None = None,
    seed: int | None = None,
    compile: str = "auto",
    allow_outside: bool = False,
    allow_large: bool = False,
) -> Suite:
    """Read a suite and resolve robots, models and moves.

    Args:
        overrides: entries that take the place of every table's own, each of `settings`; their files may be anywhere.
        allow_outside, allow_large: the suite's own files may lie outside its folder, and be larger than usual.
        seed: takes the place of the seeds of random moves and of the solver's starts.
        compile: "always", "never", or "auto": compiled where enough moves share a built problem and a compiler exists.

    Raises:
        BadInput: names every fault of the file, one a line.
    """
    suite, faults = _read(Path(path), overrides or {}, seed, allow_outside, allow_large)
    if faults:
        raise BadInput("\n".join(f"{path}: {fault}" for fault in faults))
    return replace(suite, tasks=tuple(_with_compile(suite.tasks, compile)))


def check_suite(path: str | Path, *, allow_outside: bool = False, allow_large: bool = False) -> list[str]:
    """Every fault of a suite file, one line each; empty where it is usable. Arguments are those of `load_suite`."""
    try:
        return [f"{path}: {fault}" for fault in _read(Path(path), {}, None, allow_outside, allow_large)[1]]
    except BadInput as error:
        return str(error).splitlines()


def _read(
    path: Path, overrides: Mapping[str, Any], seed: int | None, allow_outside: bool, allow_large: bool
) -> tuple[Suite, list[str]]:
    document = read_toml(path)
    faults = Faults()
    if document.get("format") != FORMAT:
        faults.add("format", f"{document.get('format')!r}; expected {FORMAT!r}")
    name = document.get("name", path.stem)
    if not isinstance(name, str) or not NAME.fullmatch(name) or len(name) > 100:
        faults.add("name", f"{name!r}; expected letters, digits, spaces and . _ + - (it names a folder)")
    top = {key: value for key, value in document.items() if key not in ("format", "name", "groups")}
    _unknown(top, "", faults)
    groups = document.get("groups", [])
    if not isinstance(groups, list) or not all(isinstance(group, Mapping) for group in groups):
        faults.add("groups", "is not a list of [[groups]] tables")
        groups = []
    for number, group in enumerate(groups, start=1):
        _unknown(group, f"groups {number}: ", faults)
    tables = [("", top)] if not groups else [(f"groups {n}: ", {**top, **g}) for n, g in enumerate(groups, start=1)]
    tasks: list[Task] = []
    for where, table in tables:
        own = table.get("settings", {})
        table = _seeded({**table, **overrides}, seed)
        if isinstance(own, Mapping) and "settings" in overrides:
            table["settings"] = {**own, **overrides["settings"]}
        files = Files(path.parent, allow_outside, frozenset(overrides), allow_large)
        group = read_group(table, files, faults.within(where))
        tasks += _product(str(name), group, len(tasks), files, faults.within(where))
    if not faults and not tasks:
        faults.add("moves", "none; give [[moves]] with start and goal, or random = { count, seed, range }")
    for label, count in Counter(task.label for task in tasks).items():
        if count > 1 and not faults:
            faults.add("moves", f"{label!r} is there {count} times; give each move its own name")
    return Suite(str(name), path, tuple(tasks)), faults.lines


def _seeded(table: dict[str, Any], seed: int | None) -> dict[str, Any]:
    """The table with another seed, where one is given and the table is sound enough to take it."""
    if seed is None:
        return table
    random, settings = table.get("random"), table.get("settings", {})
    if isinstance(random, Mapping):
        table["random"] = {**random, "seed": seed}
    elif isinstance(random, list):
        table["random"] = [
            {**row, "seed": seed + k} if isinstance(row, Mapping) else row for k, row in enumerate(random)
        ]
    if isinstance(settings, Mapping):
        table["settings"] = {**settings, "seed": seed}
    return table


def _unknown(table: Mapping[str, Any], where: str, faults: Faults) -> None:
    for key in table:
        if key not in NAMES:
            hint = near(key, NAMES) or f"; known: {', '.join(NAMES)}"
            faults.add(f"{where}{key}", f"unknown key{hint}")


def _product(suite: str, group: Group, at: int, files: Files, faults: Faults) -> Iterator[Task]:
    """All records of a group, in the order robot, move, mode, duration, payload, model, objective."""
    for source, robot in group.robots:
        models = []
        for name, given in group.models:
            if name == MEAN:
                records = [{"name": member, **named_model(member, robot).to_document()} for member in MEMBERS]
                models.append((name, to_json({MEAN: records})))
                continue
            effects = named_model(name, robot) if given is None else given
            try:
                effects = of_joints(effects, robot)
                effects.check(robot.n)
            except BadInput as error:
                faults.add(f"models {name} on {robot.name}", str(error))
            models.append((name, to_json(effects.to_document())))
        for move, timings in _moves(group, robot, files, faults):
            for mode in group.modes:
                for timing in timings:
                    for payload in group.payloads:
                        for model, content in models:
                            for objective in group.objectives:
                                yield Task(
                                    at,
                                    suite,
                                    source,
                                    move.name,
                                    move.start,
                                    move.goal,
                                    move.via,
                                    mode,
                                    timing,
                                    payload,
                                    model,
                                    content,
                                    objective,
                                    group.settings,
                                    loaded_sources(),
                                    group.surroundings,
                                    move.path,
                                    ends=move.ends,
                                )
                                at += 1


def _moves(group: Group, robot: Robot, files: Files, faults: Faults) -> Iterator[tuple[NamedMove, list[Duration]]]:
    """Given moves first, then random ones."""
    for number, (name, table, timings) in enumerate(group.moves, start=1):
        where = f"moves {number} ({name}) on {robot.name}"
        try:
            if "path" in table:
                yield given_path(name, table["path"], robot.joints, files), timings or group.timings
                continue
            if any(key in table for key in OF_POSES):
                yield posed_move(name, table, robot, files, group.surroundings), timings or group.timings
                continue
            start, goal = (joint_values(table[end], robot.joints) for end in ("start", "goal"))
            via = tuple(joint_values(point, robot.joints) for point in table.get("via", []))
        except BadInput as error:
            faults.add(where, str(error))
            continue
        yield NamedMove(name, start, goal, via), timings or group.timings
    for count, seed, share in group.random:
        for move in random_moves(robot, count, seed, share):
            yield move, group.timings


def _with_compile(tasks: tuple[Task, ...], policy: str) -> Iterator[Task]:
    from energy_opt.numerics.compile import compiler

    if policy == "auto":
        shared = Counter(task.build for task in tasks) if compiler() else Counter()
        for task in tasks:
            yield replace(task, compile="always" if shared[task.build] >= COMPILE_FROM else "never")
    else:
        for task in tasks:
            yield replace(task, compile=policy)
