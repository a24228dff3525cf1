"""JOB.toml of format 2: several robots, waits with modes, time lags and zones, in one periodic cycle.

`energy-opt --example job` prints a file of one robot; docs/verbs/job.md shows one of several.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, StrictBool, model_validator

from energy_opt.errors import BadInput, suggest
from energy_opt.files import read_toml
from energy_opt.motion.move import LONGEST
from energy_opt.schedule import Group
from energy_opt.schema import Name, Number, Table, parse

FORMAT = "energy-opt/job/2"
MOST = 1e12  # [W, J] largest power and energy of a step: published cells have up to 1e6
STEEPEST = 20  # largest exponent of a duration, of either sign: published curves have 1

Seconds = Annotated[Number, Field(ge=0, le=LONGEST)]
Span = tuple[Seconds, Seconds]
Watts = Annotated[Number, Field(ge=0, le=MOST)]
Joules = Annotated[Number, Field(ge=-MOST, le=MOST)]
Exponent = Annotated[int, Field(strict=True, ge=-STEEPEST, le=STEEPEST)]
MOTORS = "motors"  # the mode of being held by a known arm's motors; its power follows from the power model
OF_ARMS = {"free", "pose_tolerance", "mode", "min_duration", "max_duration", "stop"}  # keys of a known arm's moves
FOREIGN = {  # keys that do not belong to a step, by its kind
    "to": {"duration"},
    "pose": {"duration"},
    "wait": {*OF_ARMS, "duration", "as_is"},
    "curve": {*OF_ARMS, "payload", "power", "modes"},
}
Positions = list[Number] | dict[str, Number] | Name
PoseNumbers = Annotated[list[Number], Field(min_length=6, max_length=7)] | Name  # [m, rad], or "OBJECT: ..."


class ModeTable(Table):
    """A mode in which a robot waits: power [W], shortest duration [s], seconds [s] and energy [J] of entry and exit."""

    name: Name
    power: Watts
    least: Seconds = 0.0
    enter: tuple[Seconds, Joules] = (0.0, 0.0)
    leave: tuple[Seconds, Joules] = (0.0, 0.0)
    posture: Literal["any"] | Annotated[list[Name], Field(min_length=1)] = "any"


class PoseTable(Table):
    """A pose of the tool in the frame of the robot's base or of an object, with its freedom."""

    pose: PoseNumbers
    free: list[Name] = []
    tolerance: Name | None = None


Places = dict[Name, list[Number] | Name | PoseTable | dict[str, Number]]


class StepTable(Table):
    """One step of a robot: a move of a known arm (`to` or `pose`), one known by its `curve`, or a `wait`.

    `as_is` is a move's present duration [s], for the lever of that name.
    """

    name: Name | None = None
    to: Positions | None = None
    pose: PoseNumbers | None = None
    free: list[Name] | None = None
    pose_tolerance: Name | None = None
    wait: Seconds | Span | None = None
    duration: Seconds | Span | None = None
    curve: Annotated[list[tuple[Exponent, Number]], Field(min_length=1)] | None = None
    power: dict[Name, Watts] = {}
    modes: list[Name] | None = None
    mode: Literal["retime", "reshape"] | None = None
    min_duration: Seconds = 0.0
    max_duration: Seconds | None = None
    as_is: Seconds | None = None
    payload: Number | tuple[Number, Number, Number, Number] | None = None
    stop: StrictBool = True
    zone: Name | None = None
    after: Name | None = None
    lag: tuple[Number, Number] | None = None
    any_order: StrictBool = False

    @model_validator(mode="after")
    def _one_kind(self) -> StepTable:
        kinds = [k for k in ("to", "pose", "wait", "curve") if getattr(self, k) is not None]
        if len(kinds) != 1:
            raise ValueError(
                "expected one of `to`, `pose`, `wait` or `curve`" + (f"; found {', '.join(kinds)}" if kinds else "")
            )
        foreign = self.model_fields_set & FOREIGN[kinds[0]]
        if foreign:
            raise ValueError(f"`{min(foreign)}` does not belong to a step with `{kinds[0]}`")
        if self.curve is not None and self.duration is None:
            raise ValueError("a curve needs `duration = [least, most]` [s]")
        if self.as_is is not None and self.curve is not None and not self.span[0] <= self.as_is <= self.span[1]:
            raise ValueError(f"as_is = {self.as_is:g} is outside duration = [{self.span[0]:g}, {self.span[1]:g}]")
        if self.lag is not None and self.after is None:
            raise ValueError("`lag` belongs to `after`")
        for key in ("wait", "duration", "lag"):
            span = getattr(self, key)
            if isinstance(span, tuple) and span[0] > span[1]:
                raise ValueError(f"{key} = [{span[0]:g}, {span[1]:g}]: expected the smaller first")
        if self.max_duration is not None and self.min_duration > self.max_duration:
            raise ValueError(f"min_duration = {self.min_duration:g} is above max_duration = {self.max_duration:g}")
        return self

    @property
    def moves(self) -> bool:
        """True if it is a move of a known arm."""
        return self.to is not None or self.pose is not None

    @property
    def passes(self) -> bool:
        """True if it is a move that passes its pose without stopping."""
        return self.moves and not self.stop

    @property
    def span(self) -> Span:
        """Shortest and longest duration of a wait or a curve [s]."""
        given = self.wait if self.wait is not None else self.duration
        assert given is not None
        return given if isinstance(given, tuple) else (given, given)


class RobotTable(Table):
    """A robot of the cell: its arm and base, or only curves; its own modes; its steps, which form a ring."""

    name: Name
    robot: Name | None = None
    base: tuple[Number, Number, Number, Number, Number, Number] = (0.0,) * 6
    model: Name | None = None
    tool: Name | None = None
    payload: Number | tuple[Number, Number, Number, Number] = 0.0
    home: Positions | None = None
    poses: Places = {}
    mode: list[ModeTable] = []
    step: Annotated[list[StepTable], Field(min_length=1, max_length=1000)]


class LagTable(Table):
    """start(to) - start(from) >= length - cycle_time * height; steps are named `robot.step`."""

    begin: Annotated[Name, Field(alias="from")]
    end: Annotated[Name, Field(alias="to")]
    length: Number
    height: Annotated[int, Field(strict=True, ge=-100, le=100)] = 0


class SupplyTable(Table):
    """The supply that the robots share: link capacity [J], a braking resistor, bound of the sum of powers [W]."""

    shared: StrictBool = True
    capacity: Annotated[Number, Field(ge=0)] = 0.0
    resistor: StrictBool = True
    max_power: Annotated[Number, Field(gt=0)] | None = None


class WorkCell(Table):
    """A job file of format 2: times in s, poses and modes that all robots share, and the robots (docs/verbs/job.md).

    `jitter` is how early or late every robot may be.
    """

    format: Literal["energy-opt/job/2"]
    cycle_time: Annotated[Number, Field(gt=0, le=LONGEST)]
    jitter: Seconds = 0.02
    scene: Name | None = None
    poses: Places = {}
    supply: SupplyTable | None = None
    mode: list[ModeTable] = []
    robot: Annotated[list[RobotTable], Field(min_length=1, max_length=100)]
    lag: list[LagTable] = []

    def step_at(self, name: str) -> tuple[int, int]:
        """Indices of `robot.step`.

        Raises:
            BadInput: there is none.
        """
        known = self.step_names
        if name not in known:
            raise BadInput(f"no step {name!r}{suggest(name, known)}; steps are named `robot.step`")
        return known[name]

    @property
    def step_names(self) -> dict[str, tuple[int, int]]:
        """Indices (robot, step) of every step by `robot.step`."""
        return {
            f"{robot.name}.{step_name(k, step)}": (r, k)
            for r, robot in enumerate(self.robot)
            for k, step in enumerate(robot.step)
        }


def step_name(number: int, step: StepTable) -> str:
    """The name of a step; `step 3` if it has none."""
    return step.name or f"step {number + 1}"


def step_label(number: int, step: StepTable) -> str:
    """A step in messages: `step pick`, or `step 3` if it has no name."""
    return f"step {step.name or number + 1}"


def groups_of(robot: RobotTable) -> list[Group]:
    """The steps of a robot that may be done in any order, in blocks: a move with `any_order`, and the waits after it.

    A wait with a range of durations that follows the last of them keeps its place, unless it is marked too. Steps
    that are passed without stopping are one block with the next. `after` between two steps of one group orders their
    blocks.
    """
    blocks: list[tuple[int, int, bool]] = []  # first and last step, and whether it may be moved
    for k, step in enumerate(robot.step):
        before = robot.step[k - 1] if k else step
        passes = k > 0 and before.passes
        if blocks and (passes or (step.wait is not None and blocks[-1][2] and robot.step[blocks[-1][0]].wait is None)):
            first, _, free = blocks.pop()
            blocks.append((first, k, free or step.any_order))
        else:
            blocks.append((k, k, step.any_order))
    runs = [[b[:2] for b in run] for free, run in groupby(blocks, key=lambda b: b[2]) if free]
    for run in runs:
        first, last = run[-1]
        while last > first and (wait := robot.step[last]).wait and not wait.any_order and wait.span[0] < wait.span[1]:
            last -= 1
        run[-1] = first, last
    return [Group(tuple(run), _block_order(robot, run)) for run in runs if len(run) > 1]


def _block_order(robot: RobotTable, blocks: list[tuple[int, int]]) -> frozenset[tuple[int, int]]:
    """Pairs of blocks that `after` orders, directly or through others."""
    steps = robot.step
    of = {
        f"{robot.name}.{step_name(k, steps[k])}": (b, steps[k].after)
        for b, (first, last) in enumerate(blocks)
        for k in range(first, last + 1)
    }
    known = {(of[after][0], b) for b, after in of.values() if after in of and of[after][0] != b}
    while more := {(i, k) for i, j in known for j_, k in known if j == j_} - known:
        known |= more
    return frozenset(known)


def load_workcell(path: Path) -> WorkCell:
    """Read a job file of format 2.

    Raises:
        BadInput: names every fault, one a line, with robot and step.
    """
    return workcell_of(read_toml(Path(path), "job"), Path(path))


def workcell_of(document: Mapping[str, Any], path: Path) -> WorkCell:
    """A cell from its document.

    Args:
        document: the file's content. path: names it in messages.

    Raises:
        BadInput: another format; or every fault, one a line, with robot and step.
    """
    if document.get("format") != FORMAT:
        raise BadInput(f"{path}: format = {document.get('format')!r}; expected {FORMAT!r}")
    if isinstance(document.get("robot"), str) and "step" in document:
        raise BadInput(f"{path}: format = {FORMAT!r} with the keys of one robot; expected 'energy-opt/job/1'")
    cell = parse(WorkCell, document, str(path))
    if faults := _wrong_names(cell):
        raise BadInput("\n".join(f"{path}: {fault}" for fault in faults))
    return cell


def _wrong_names(cell: WorkCell) -> list[str]:
    """Faults of duplicate and unknown names, and a jitter that cannot be in seconds."""
    faults = []
    if cell.jitter > cell.cycle_time / 2:
        faults.append(f"jitter = {cell.jitter:g} s is more than half of the cycle; 20 ms are 0.02")
    names = [robot.name for robot in cell.robot]
    faults += [f"robot: two robots are named {name!r}" for name in sorted({n for n in names if names.count(n) > 1})]
    if faults:  # others may follow from these
        return faults
    for robot in cell.robot:
        where = f"robot {robot.name}"
        steps = [step_name(k, step) for k, step in enumerate(robot.step)]
        faults += [f"{where}: two steps are named {n!r}" for n in sorted({n for n in steps if steps.count(n) > 1})]
        modes = {mode.name for mode in (*cell.mode, *robot.mode)} | ({MOTORS} if robot.robot is not None else set())
        for k, step in enumerate(robot.step):
            known, label = modes | set(step.power), f"{where}: {step_label(k, step)}"
            # a step may have modes of its own, but no misspelled ones
            hints = {own: suggest(own, modes | {MOTORS}) for own in sorted(set(step.power) - modes - {MOTORS})}
            faults += [f"{label}: power: no mode {mode!r}{hint}" for mode, hint in hints.items() if hint]
            unknown = (mode for mode in step.modes or () if mode not in known)
            faults += [f"{label}: no mode {mode!r}{suggest(mode, known)}" for mode in unknown]
            waits, arm = step.wait is not None, robot.robot is not None
            said = {
                "a wait needs a [[mode]], or power = { NAME = W }": waits and not arm and not known,
                "a move needs the arm: robot = NAME_OR_URDF in [[robot]]": step.moves and not arm,
                "a curve belongs to a robot without an arm (no `robot = ...`)": step.curve is not None and arm,
                "power: the power of its motors follows from the arm's power model": MOTORS in step.power and arm,
                "any_order belongs to a move; its waits go with it": step.any_order and not step.moves and arm,
            }
            faults += [f"{label}: {text}" for text, wrong in said.items() if wrong]
            other = robot.step[k + 1].zone if step.passes and k + 1 < len(steps) else None
            if step.zone and other and step.zone != other:
                faults.append(
                    f"{where}: steps {steps[k]} and {steps[k + 1]}: one motion, as stop = false, in two zones"
                )
            if step.after is not None:
                faults += _unknown(cell, step.after, f"{label}: after")
                if step.after == f"{robot.name}.{steps[k]}":
                    faults.append(f"{label}: after = {step.after!r} is the step itself; name another")
        for group in groups_of(robot):
            if tied := sorted(i for i, j in group.before if i == j):
                names_ = " and ".join(steps[group.blocks[b][0]] for b in tied)
                faults.append(f"{where}: steps {names_}: each is `after` another")
    for where, tables in [("", cell.mode), *((f"robot {robot.name}: ", robot.mode) for robot in cell.robot)]:
        named = [mode.name for mode in tables]
        faults += [f"{where}two modes are named {n!r}" for n in sorted({n for n in named if named.count(n) > 1})]
    own = {
        robot.name: {*cell.poses, *robot.poses, *(["home"] if robot.home else []), *(s.name or "" for s in robot.step)}
        for robot in cell.robot
    }
    placed = [("", mode, set().union(*own.values())) for mode in cell.mode]
    placed += [(f"robot {robot.name}: ", mode, own[robot.name]) for robot in cell.robot for mode in robot.mode]
    for where, table, there in placed:
        for pose in () if table.posture == "any" else table.posture:
            if pose not in there:
                faults.append(
                    f"{where}mode {table.name}: posture {pose!r} is no pose and no wait{suggest(pose, there)}"
                )
    bound = cell.supply is not None and cell.supply.max_power is not None
    if bound and all(robot.robot is None for robot in cell.robot):
        faults.append("supply: max_power needs an arm: robot = NAME_OR_URDF; curves contain no peak power")
    for lag in cell.lag:
        faults += _unknown(cell, lag.begin, "lag: from") + _unknown(cell, lag.end, "lag: to")
    return faults


def _unknown(cell: WorkCell, name: str, where: str) -> list[str]:
    known = cell.step_names
    own = [full for full in known if full.endswith(f".{name}")]  # the robot is missing
    hint = f"; did you mean {' or '.join(map(repr, own))}?" if own else suggest(name, known)
    return [] if name in known else [f"{where} = {name!r}: no such step{hint}; named `robot.step`"]
