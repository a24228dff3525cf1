"""One move of a batch: everything that affects its result, in a form for any worker on any machine."""

from __future__ import annotations

import atexit
import dataclasses
import hashlib
import json
import re
import shutil
import tempfile
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene import Scene
from energy_opt.effects import Payload, load_source
from energy_opt.errors import BadInput
from energy_opt.files import is_number, plain, read_text
from energy_opt.power import Mixture, PowerModel
from energy_opt.power.model import model_from_document
from energy_opt.robot import Robot, load_robot


@dataclass(frozen=True)
class Surroundings:
    """The bodies that a move must keep clear of.

    Attributes:
        request: the request without its files.
        scene, srdf: the content of these files (see `Scene.to_text`); empty if there is none.
    """

    request: CellRequest = field(default_factory=CellRequest)
    scene: str = ""
    srdf: str = ""

    def cell(self, robot: Robot, payload: tuple[float, ...] = ()) -> Cell:
        """The robot's body in its cell; a payload's box is about its centre of mass."""
        request = self.request
        if request.payload_size is not None:
            request = replace(request, payload_at=payload[1:]) if payload else replace(request, payload_size=None)
        scene = Scene.from_text(self.scene) if self.scene else None
        with tempfile.TemporaryDirectory(prefix="energy-opt-") as folder:
            if self.srdf:
                file = Path(folder) / f"{robot.name}.srdf"
                file.write_text(self.srdf, encoding="utf-8")
                request = replace(request, srdf=file)
            return Cell(robot, request, scene)


OBJECTIVES = ("energy", "torque", "power_squared", "path_length", "time")
MODES: tuple[Literal["retime", "reshape"], ...] = ("retime", "reshape")

_MULTIPLE = re.compile(r"\s*([0-9.eE+-]+)\s*x\s*")


@dataclass(frozen=True)
class Duration:
    """The requested duration of a move: seconds, a multiple of the minimum time, or free (neither)."""

    seconds: float | None = None
    multiple: float | None = None

    @classmethod
    def parse(cls, value: object) -> Duration:
        """From a suite: 2.5 (seconds), "1.5x" (of the minimum time on the straight path), or "free".

        Raises:
            BadInput: anything else, or a number that is not above zero.
        """
        if value == "free":
            return cls()
        match = _MULTIPLE.fullmatch(value) if isinstance(value, str) else None
        with suppress(ValueError):
            number = float(match[1]) if match else float(value) if is_number(value) else 0.0
            if 0 < number < float("inf"):
                return cls(multiple=number) if match else cls(seconds=number)
        raise BadInput(f'{value!r} is not a duration; expected seconds above 0, a multiple such as "1.5x", or "free"')

    def of(self, fastest: float) -> float | None:
        """Duration [s] of a move whose shortest one is `fastest` [s]; None if it is free."""
        return self.seconds if self.multiple is None else self.multiple * fastest

    @property
    def label(self) -> str:
        """The text of a suite for this duration."""
        if self.seconds is not None:
            return f"{self.seconds:g}"
        return "free" if self.multiple is None else f"{self.multiple:g}x"


@dataclass(frozen=True)
class RobotSource:
    """The source of a robot; files are included as text, so that a worker elsewhere needs none of them."""

    name: str
    urdf: str | None = None
    limits: str | None = None
    lock: tuple[tuple[str, float], ...] = ()
    file: str | None = field(default=None, compare=False)  # where the URDF was read; does not affect results

    def load(self) -> Robot:
        """The robot itself; from its own file if that is unchanged, so that meshes beside it are found."""
        here = self.file is not None and Path(self.file).is_file() and read_text(Path(self.file)) == self.urdf
        with tempfile.TemporaryDirectory(prefix="energy-opt-") as folder:
            limits = Path(folder) / "joint_limits.yaml"
            name = self.name
            if self.urdf is not None:
                urdf = Path(str(self.file)) if here else _lasting(self.urdf, self.name)
                name = str(urdf)
            if self.limits is not None:
                limits.write_text(self.limits, encoding="utf-8")
            return load_robot(name, limits=None if self.limits is None else limits, lock=dict(self.lock))


@cache
def _lasting(urdf: str, name: str) -> Path:
    """A URDF's text as a file that lasts as long as this process: a robot's body is read when first needed."""
    folder = tempfile.mkdtemp(prefix="energy-opt-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    path = Path(folder) / f"{name}.urdf"
    path.write_text(urdf, encoding="utf-8")
    return path


@dataclass(frozen=True)
class Task:
    """One row of the results, not yet solved.

    Attributes:
        index: its place in the suite; results are listed in this order.
        start, goal: (n,) rad; via: via points.
        payload: mass [kg] and com (3) [m], empty for the model's own.
        model: the model's name in the suite; effects: its content, as in a model file.
        settings: settings of the solver that differ from the defaults.
        surroundings: the arm's body and its cell; path: suffix and text of the file of a given path, or empty.
        own_effects: text and path of the files of effects that the model may use.
        ends: start, goal and via points as text of `Ends.to_text`, if some are poses; else empty.
        compile: "always" or "never".
    """

    index: int
    suite: str
    robot: RobotSource
    move: str
    start: tuple[float, ...]
    goal: tuple[float, ...]
    via: tuple[tuple[float, ...], ...]
    mode: Literal["retime", "reshape"]
    timing: Duration
    payload: tuple[float, ...]
    model: str
    effects: str
    objective: str
    settings: tuple[tuple[str, Any], ...] = ()
    own_effects: tuple[tuple[str, str], ...] = ()
    surroundings: Surroundings = field(default_factory=Surroundings)
    path: tuple[str, str] = ("", "")
    compile: str = "never"
    ends: str = ""

    @property
    def payload_label(self) -> str:
        """The payload in the form of --payload, empty if the suite names none."""
        return ",".join(f"{x:g}" for x in self.payload)

    @property
    def label(self) -> str:
        """The identity of this row within its suite."""
        words = [self.robot.name, self.move, self.mode, self.timing.label, self.payload_label, self.model]
        return " ".join(word for word in [*words, self.objective] if word)

    @property
    def key(self) -> str:
        """A digest of everything that affects the result (without its place in the suite and speed options)."""
        content = dataclasses.asdict(self)
        del content["index"], content["compile"], content["robot"]["file"]
        content["own_effects"] = [text for text, _ in self.own_effects]
        if not self.ends:
            del content["ends"]
        if not self.own_effects:
            del content["own_effects"]
        text = json.dumps(plain(content), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:24]

    @property
    def build(self) -> tuple[Any, ...]:
        """Everything that the built problem depends on; tasks that share it share a planner."""
        return (self.robot, self.mode, self.objective, self.settings, self.compile, self.power().structure)

    def power(self) -> PowerModel:
        """The power model with the payload; for several models their mean."""
        models = [model for _, model in self.powers()]
        return models[0] if len(models) == 1 else Mixture.of(models)

    def powers(self) -> list[tuple[str, PowerModel]]:
        """The models by name, each with the payload; results are stated under the first."""
        for text, where in self.own_effects:
            load_source(text, where)
        document, base = json.loads(self.effects), self.surroundings.request.base
        records, out = document.get("mean", [{"name": self.model, **document}]), []
        for row in records:
            model = model_from_document({key: value for key, value in row.items() if key != "name"}, row["name"])
            if self.payload:
                model = model.replaced(Payload(mass=self.payload[0], com=list(self.payload[1:])))
            out.append((row["name"], model.standing(*base[3:5]) if any(base) else model))
        return out
