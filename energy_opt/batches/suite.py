"""Suites: a TOML file that names robots, moves, modes, durations, payloads, models and objectives; see example.toml.

Every robot meets every move, mode, duration, payload, model and objective. Each of [[groups]] is such a product in
place of the top level's; what a group does not say, the top level does. An end of a move is a list in the robot's
order, a table by joint name, or a pose of the tool: start_pose, goal_pose, via_pose = [...], with free = ["rz"] and
pose_tolerance. Files are named relative to the suite.
"""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import count, product
from pathlib import Path
from typing import Any

from energy_opt.batches.tables import MEAN, CellTable, GroupTable, NamedMove, joint_values, posed_move, random_moves
from energy_opt.batches.task import Duration, RobotSource, Surroundings, Task
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene_files import read_scene
from energy_opt.effects import loaded_sources
from energy_opt.errors import BadInput
from energy_opt.files import inside, read_text, read_toml, to_json
from energy_opt.formats import read_path
from energy_opt.power import PowerModel, load_model
from energy_opt.power.known import NAMED, is_named, named_model
from energy_opt.power.variants import of_joints
from energy_opt.robot import Robot, known_robots
from energy_opt.schema import faults_of

FORMAT = "energy-opt/suite/1"
MEMBERS = ("source-method-2", "careful")  # models of the mean
NAME = re.compile(r"[^\W_][\w .+-]*")  # it becomes a folder's name


@dataclass(frozen=True)
class Suite:
    """A suite with everything resolved; `tasks` are in the order of the results, `notes` are for the user."""

    name: str
    path: Path
    tasks: tuple[Task, ...]
    notes: tuple[str, ...] = ()

    @property
    def digest(self) -> str:
        """A digest that changes with anything that could change a result."""
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
        overrides: entries that replace every table's own, each of `settings`; their files may be anywhere.
        allow_outside, allow_large: the suite's own files may lie outside its folder, and be larger than usual.
        seed: replaces the seeds of random moves and of the solver's starts.
        compile: "always", or "never" and "auto": nothing is compiled, so that a resumed batch computes the same.

    Raises:
        BadInput: names every fault of the file, one a line.
    """
    reading = _Reading(Path(path), overrides or {}, seed, allow_outside, allow_large)
    suite = reading.suite()
    if reading.faults:
        raise BadInput("\n".join(f"{path}: {fault}" for fault in reading.faults))
    policy = "never" if compile == "auto" else compile
    tasks = tuple(replace(task, compile=policy) for task in suite.tasks)
    return replace(suite, tasks=tasks, notes=tuple(reading.notes))


@dataclass
class _Reading:
    """One reading of a suite. It collects faults, so that one reading names them all.

    Attributes:
        path: the suite. overrides, seed, allow_outside, allow_large: as those of `load_suite`.
        where: the present group; it precedes each of its faults. faults, notes: in order, without repeats.
    """

    path: Path
    overrides: Mapping[str, Any]
    seed: int | None
    allow_outside: bool
    allow_large: bool
    where: str = ""
    faults: dict[str, None] = field(default_factory=dict)
    notes: dict[str, None] = field(default_factory=dict)

    @contextmanager
    def at(self, key: str) -> Iterator[None]:
        """A part of the file: its error becomes a fault, and reading continues after it."""
        try:
            yield
        except BadInput as error:
            self.faults[f"{self.where}{key}: {error}"] = None

    def inside(self, name: str, key: str) -> Path:
        """The path of the entry `key`: in the suite's folder, or anywhere if an option gave it."""
        return inside(self.path.parent, name, self.allow_outside or key in self.overrides)

    def file(self, name: str, key: str, others: Iterable[str] = ()) -> Path:
        """The path of an existing file, as by `inside`.

        Raises:
            BadInput: there is none; `others` are names that would be accepted instead.
        """
        path = self.inside(name, key)
        if not path.is_file():
            kind = "model file" if key == "models" else "file"
            either = f"neither a {kind} beside the suite nor one of {', '.join(others)}" if others else ""
            raise BadInput(f"{name!r} is {either or 'not a file beside the suite'}")
        return path

    def suite(self) -> Suite:
        """The suite, as far as it is valid."""
        document = read_toml(self.path, "suite")
        name, groups = document.pop("name", self.path.stem), document.pop("groups", [])
        given = document.pop("format", None)
        if given != FORMAT:
            self.faults[f"format: {given!r}; expected {FORMAT!r}"] = None
            return Suite(str(name), self.path, ())  # a file of another kind: its other faults say nothing
        with self.at("name"):
            if not isinstance(name, str) or not NAME.fullmatch(name) or len(name) > 100:
                raise BadInput(f"{name!r}; expected letters, digits, spaces and . _ + - (it names a folder)")
        if not isinstance(groups, list) or not all(isinstance(group, Mapping) for group in groups):
            self.faults["groups: is not a list of [[groups]] tables"] = None
            groups = []
        tasks: list[Task] = []
        for number, group in enumerate(groups or [{}], start=1):
            self.where = f"groups {number}: " if groups else ""
            table, faults = faults_of(GroupTable, self._seeded({**document, **group}))
            self.faults |= {self.where + fault: None for fault in faults}
            if table is not None:
                tasks += self._product(str(name), table, len(tasks))
        self.where = ""
        with self.at("moves"):
            if not self.faults and not tasks:
                raise BadInput("none; give [[moves]] with start and goal, or random = { count, seed, range }")
            twice = [label for label, count in Counter(task.label for task in tasks).items() if count > 1]
            if twice and not self.faults:
                count = sum(task.label == twice[0] for task in tasks)
                raise BadInput(f"{twice[0]!r} is given {count} times; expected each entry and each name once")
        return Suite(str(name), self.path, tuple(tasks))

    def _seeded(self, table: dict[str, Any]) -> dict[str, Any]:
        """A table with the overrides and, if given, the seed, where its entries are valid."""
        own = table.get("settings", {})
        table |= self.overrides
        if isinstance(own, Mapping) and "settings" in self.overrides:
            table["settings"] = {**own, **self.overrides["settings"]}
        if self.seed is None:
            return table
        random, settings = table.get("random", []), table.get("settings", {})
        given = random if isinstance(random, list) else [random]
        table["random"] = [
            {**row, "seed": self.seed + k} if isinstance(row, Mapping) else row for k, row in enumerate(given)
        ]
        if isinstance(settings, Mapping):
            table["settings"] = {**settings, "seed": self.seed}
        return table

    def _product(self, suite: str, table: GroupTable, first: int) -> Iterator[Task]:
        """All tasks of a group, in the order robot, move, mode, duration, payload, model, objective."""
        numbers, around = count(first), self._surroundings(table)
        models = [(name, self._model(name)) for name in table.models]
        shared: dict[str, Any] = {
            "settings": tuple(sorted(table.settings.items())), "own_effects": loaded_sources(), "surroundings": around,
        }  # fmt: skip
        for source, robot in self._robots(table):
            contents = [(name, self._effects(name, model, robot)) for name, model in models]
            for move, timings in self._moves(table, robot, around):
                of_move: dict[str, Any] = {"start": move.start, "goal": move.goal, "via": move.via, "path": move.path}
                of_move |= {"move": move.name, "ends": move.ends}
                for mode, timing, payload, (name, effects), objective in product(
                    table.modes, timings or table.durations, table.payloads, contents, table.objectives
                ):
                    yield Task(
                        next(numbers), suite, source, mode=mode, timing=timing, payload=payload, model=name,
                        effects=effects, objective=objective, **of_move, **shared,
                    )  # fmt: skip

    def _robots(self, table: GroupTable) -> list[tuple[RobotSource, Robot]]:
        """The robots that can be loaded, with their sources."""
        out, limits = [], None
        lock = tuple(sorted(table.lock.items()))
        with self.at("limits"):
            limits = None if table.limits is None else read_text(self.file(table.limits, "limits"))
        for name in table.robots:
            with self.at("robots"):
                source = RobotSource(name, None, limits, lock)
                if name not in known_robots():
                    file = self.file(name, "robots", known_robots())
                    source = RobotSource(file.stem, read_text(file), limits, lock, str(file.resolve()))
                out.append((source, source.load()))
        return out

    def _model(self, name: str) -> PowerModel | None:
        """The model of a file; None for named models, which depend on the robot."""
        with self.at("models"):
            if name != MEAN and not is_named(name):
                return load_model(self.file(name, "models", [MEAN, *NAMED]))
        return None

    def _effects(self, name: str, model: PowerModel | None, robot: Robot) -> str:
        """A model's content for a robot, as JSON; for the mean, that of its members."""
        if name == MEAN:
            members = [{"name": member, **named_model(member, robot).to_document()} for member in MEMBERS]
            return to_json({MEAN: members})
        with self.at(f"models {name} on {robot.name}"):
            if model is not None or is_named(name):
                model = of_joints(named_model(name, robot) if model is None else model, robot)
                model.check(robot.n)
        return "" if model is None else to_json(model.to_document())

    def _surroundings(self, table: GroupTable) -> Surroundings:
        """Body and cell of a table."""
        given = table.model_dump(include=set(CellTable.model_fields) - {"scene", "srdf"}, exclude_none=True)
        given = {key: tuple(value) if isinstance(value, list) else value for key, value in given.items()}
        request, scene, srdf = CellRequest(), "", ""
        with self.at("cell"):
            folders = given.get("package_dirs", ())
            given["package_dirs"] = tuple(self.inside(name, "package_dirs").resolve() for name in folders)
            request = CellRequest(**given)
        with self.at("scene"):
            if table.scene is not None:
                file, bounds = self.inside(table.scene, "scene"), (self.allow_outside, self.allow_large)
                scene = read_scene(file, allow_outside=bounds[0], allow_large=bounds[1]).to_text()
        with self.at("srdf"):
            srdf = "" if table.srdf is None else read_text(self.inside(table.srdf, "srdf"))
        return Surroundings(request, scene, srdf)

    def _moves(
        self, table: GroupTable, robot: Robot, around: Surroundings
    ) -> Iterator[tuple[NamedMove, list[Duration]]]:
        """Given moves first, then random ones; each with its own durations, if any."""
        for number, row in enumerate(table.moves, start=1):
            name = row.name or f"move{number:02d}"
            where = f"moves {number} ({name}) on {robot.name}"

            def say(note: str, where: str = where) -> None:
                self.notes[f"{self.where}{where}: {note}"] = None

            with self.at(where):
                if row.path is not None:
                    file = self.file(row.path, "moves")
                    found = read_path(file, robot.joints)
                    start, goal = (tuple(end.tolist()) for end in (found.start, found.goal))
                    move = NamedMove(name, start, goal, path=(file.suffix, read_text(file)))
                elif row.chosen:
                    move = posed_move(name, row, robot, self.inside(".", "moves"), around, say)
                else:
                    start, goal = (joint_values(end, robot, say) for end in (row.start, row.goal))
                    move = NamedMove(name, start, goal, tuple(joint_values(point, robot, say) for point in row.via))
                yield move, row.durations
        for random in table.random:
            for move in random_moves(robot, random.count, random.seed, random.range):
                yield move, []
