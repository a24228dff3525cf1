"""Read the files of a measured set into runs, and find all its faults, with file, row and column."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.measured.clock import shows_means
from energy_opt.measured.columns import ARM_POWER, LOGGED, PAYLOAD
from energy_opt.measured.differentiate import choose_smoothing, coarse, kinematics
from energy_opt.measured.joint_units import contradicting
from energy_opt.measured.log import LogFile, read_log
from energy_opt.measured.meter_clocks import Found, clocks_of
from energy_opt.measured.plausible import OUTSIDE, saturated
from energy_opt.measured.recording import Recording, read_recording
from energy_opt.measured.run import MeasuredSet, Run
from energy_opt.measured.table import Table
from energy_opt.numerics.signals import standstills
from energy_opt.robot import PointMass, Robot, load_robot, robot_named

MOSTLY = 0.5  # share of the highest readings that are in motion where the meter's range ends there
MANY = 3  # if more remarks have the same words, they are written once

LOGGER = logging.getLogger(__name__)


def read_set(
    folder: str | Path, robot: Robot | None = None, *, allow_outside: bool = False, meter: bool = True
) -> MeasuredSet:
    """Read a measured set.

    Args:
        folder: the set's folder, or its log.toml.
        robot: the robot to use instead of the one that the log names.
        allow_outside: True if the log may name files outside the set's folder.
        meter: True to refuse a set without any meter reading.

    Raises:
        BadInput: the first fault, with file, row and column, and how many more there are.
    """
    log = read_log(folder, allow_outside)
    robot = robot or robot_of(log)
    runs, clock, faults, remarks = collect(log, robot)
    if not faults and meter and not any(len(run.power) for run in runs):
        faults = [f"{log.path}: no run has a reading of power; is the meter's column named in [columns]?"]
    if faults:
        more = f" (and {len(faults) - 1} more faults; `energy-opt check` lists them)" if len(faults) > 1 else ""
        raise BadInput(faults[0] + more)
    wrong = {run.file: [] if coarse(run) else list(contradicting(run)) for run in runs}
    runs = [dataclasses.replace(run, **dict.fromkeys(wrong[run.file])) for run in runs]  # type: ignore[arg-type]
    said = "contradicts the positions: not used; are unit and sign right?"
    remarks += _merged_remarks([f"{file}: logged {name} {said}" for file, names in wrong.items() for name in names])
    stated = _stated_payloads(log)
    if len(stated) > 1:
        remarks.append(
            f"{log.path.name}: the recorder states several payloads ({stated[:, 0].min():g} to {stated[:, 0].max():g} "
            "kg): none is used; make a set of the runs with each"
        )
    payload = PointMass(float(stated[0][0]), stated[0][1:]) if len(stated) == 1 and stated[0][0] > 0 else None
    return MeasuredSet(log.path.parent, robot, tuple(runs), clock, payload, tuple(remarks))


def _stated_payloads(log: LogFile) -> np.ndarray:
    """Mass [kg] and centre of mass [m], in the last joint's frame, of each payload (K, 4) that the recorder states."""
    names, stated = PAYLOAD.get(log.preset or "", ()), []
    for entry in log.runs if names else ():
        table = Table(log.file(entry.file), log.csv)
        if not all(name in table for name in names):
            return np.zeros((0, 4))
        table.load(names)
        if table.faults:
            return np.zeros((0, 4))
        values = np.column_stack([table.column(name) for name in names])
        values = values[np.isfinite(values).all(axis=1)]
        stated.append(values[np.diff(values, axis=0, prepend=np.nan).any(axis=1)])  # where they change
    return np.unique(np.vstack(stated), axis=0) if stated else np.zeros((0, 4))


def robot_of(log: LogFile, limits: Path | None = None, lock: Mapping[str, float] | None = None) -> Robot:
    """The robot that a log names; a URDF lies in the set's folder.

    Args:
        log: the set's. limits: a joint_limits.yaml. lock: positions of joints that do not move, by name.

    Raises:
        BadInput: no such robot; or its URDF lies outside of the set's folder, and the log may not name such files.
    """
    try:
        name = robot_named(log.robot, log.path.parent, log.allow_outside)
    except BadInput as error:
        raise BadInput(f"{log.path}: robot {error}, or say which with --robot") from None
    return load_robot(name, limits=limits, lock=lock)


def collect(log: LogFile, robot: Robot) -> tuple[list[Run], bool, list[str], list[str]]:
    """All readable runs, whether their starts are known, all faults, and remarks on the reading."""
    faults = [
        f"{log.path}: columns.{key}: no joint {key.rpartition('.')[0]!r}; the robot's are {', '.join(robot.joints)}"
        for key in log.rules
        if key.rpartition(".")[0] not in (*robot.joints, "", "power", LOGGED)
    ]
    found = _recordings(log, robot, faults)
    known, said = [fault for fault in faults if fault.startswith(f"{log.path}: columns.")], []
    open_ = {k: one.meter for k, one in found.items() if one.meter is not None}
    clocks = dict(zip(open_, clocks_of(list(open_.values())), strict=True))
    scores = [one.scores for k, one in found.items() if k not in clocks] + [one.scores for one in clocks.values()]
    if log.window is None and any(one.interval for one in found.values()):
        # Whether a slow meter shows means is a property of the meter: all runs decide together.
        interval = float(np.median([one.interval for one in found.values() if one.interval]))
        scored = [x for x in scores if x is not None and len(x) > 1 and np.isfinite(x).all()]
        mean, sure = shows_means(np.sum(scored, axis=0), interval) if scored else (True, False)
        log = dataclasses.replace(log, window=interval if mean else 0.0)
        shows = f"means over {interval:.3g} s" if mean else "the power at its stamps"
        said.append(
            f"meter: a reading every {interval:.3g} s, taken for {shows}, "
            + ("which fits the motion better" if sure else "though the motion does not show whether they are means")
            + " ([meter] window overrides this)"
        )
    if said or clocks:
        found = _recordings(log, robot, faults := [*known], clocks)
    records = list(found.values())
    if records:
        records[0].remarks += said
    faults += [fault for one in records for fault in one.faults]
    runs = [run for one in records for run in one.runs]
    if ends := _range_end(runs):
        runs = [_below(run, ends) for run in runs]
        remarks = [f"{log.path.name}: the readings of {ends:.4g} W are left out: the meter's range seems to end there"]
    else:
        remarks = []
    clock = len(log.runs) == 1 or all(entry.start is not None for entry in log.runs)
    remarks += [remark for one in records for remark in one.remarks]
    if overlap := _overlap(log, runs):
        starts = [0.0, *np.cumsum([run.time[-1] for run in runs]).tolist()]  # each where the one before ends
        runs = [dataclasses.replace(run, start=begin) for run, begin in zip(runs, starts, strict=False)]
        clock = False
        remarks.append(overlap)
    return runs, clock, list(dict.fromkeys(faults)), _merged_remarks(remarks)


def _range_end(runs: Sequence[Run]) -> float:
    """The highest power [W] that the set's meter can show, if it often shows that in motion; else 0.

    At rest, many readings are the same for another reason: the arm holds a pose.
    """
    runs = [run for run in runs if run.meter == "power"]
    power = np.concatenate([run.power for run in runs]) if runs else np.zeros(0)
    if not saturated(power):
        return 0.0
    moving = []
    for run in runs:
        edges = run.time[np.array(standstills(run.time, run.position), dtype=int).ravel()]
        moving.append(np.searchsorted(edges, run.power_time, side="right") % 2 == 0)
    highest = float(power.max())
    return highest if np.concatenate(moving)[power == highest].mean() > MOSTLY else 0.0


def _below(run: Run, power: float) -> Run:
    """A run with those of its readings that are below a power [W]."""
    keep = (run.power < power) | (run.meter != "power")
    return dataclasses.replace(run, power_time=run.power_time[keep], power=run.power[keep], window=run.window[keep])


CLOSE = 1.0  # [s] by which runs may overlap, as starts are rounded


def _overlap(log: LogFile, runs: Sequence[Run]) -> str:
    """A remark on runs whose stated starts make them overlap in time; "" if none do."""
    ordered = sorted(runs, key=lambda run: run.start + run.time[0])
    for one, other in zip(ordered, ordered[1:], strict=False):
        begin, end = other.start + float(other.time[0]), one.start + float(one.time[-1])
        if begin < end - CLOSE:
            return (
                f"{log.path.name}: start of {other.file}: begins at {begin:.4g} s, before {one.file} ends at "
                f"{end:.4g} s; an arm makes one run at a time, so no start is used. Correct them, or leave them out"
            )
    return ""


def _merged_remarks(remarks: list[str]) -> list[str]:
    """Merge remarks that many files share word for word."""
    by_word: dict[str, list[str]] = {}
    for remark in remarks:
        file, _, word = remark.partition(": ")
        by_word.setdefault(word or file, []).append(remark)
    out = []
    for word, own in by_word.items():
        first, last = own[0].partition(": ")[0], own[-1].partition(": ")[0]
        out += own if len(own) <= MANY else [f"{first} to {last}, {len(own)} files: {word}"]
    return out


def _recordings(
    log: LogFile, robot: Robot, faults: list[str], clocks: Mapping[int, Found] | None = None
) -> dict[int, Recording]:
    """Every [[run]] by its number; the errors of those that cannot be read go to `faults`.

    Args:
        clocks: what is known of the meters' clocks, by the run's number.
    """
    out: dict[int, Recording] = {}
    clock = 0.0
    for k, entry in enumerate(log.runs):
        LOGGER.info("file %d of %d: %s", k + 1, len(log.runs), entry.file, extra={"share": k / len(log.runs)})
        try:
            out[k] = read_recording(log, entry, robot, clock, None if clocks is None else clocks.get(k))
        except BadInput as error:
            faults.append(str(error))
            continue
        if out[k].runs:
            clock = out[k].runs[-1].start + float(out[k].runs[-1].time[-1])
    return out


MOVES = 0.01  # [rad, m] by which a joint may move in a static run
MISMATCH = 0.2  # largest rms difference of logged velocity from the slope of the positions, over the latter's spread


def inspect_set(
    folder: Path, allow_outside: bool = False, lock: Mapping[str, float] | None = None
) -> tuple[list[str], list[str]]:
    """All faults of a measured set, and remarks on the reading: samples dropped, recordings cut, clocks found.

    It never raises for a faulty file.

    Args:
        folder: of the set. allow_outside: its log may name files outside.
        lock: positions of joints that do not move, by name.
    """
    try:
        log = read_log(folder, allow_outside)
        robot = robot_of(log, None, lock)
    except BadInput as error:
        return str(error).splitlines(), []
    runs, _, faults, remarks = collect(log, robot)
    for run in runs:
        faults += _plausible(run, robot, str(log.path.parent / run.file.partition("#")[0]))
    faults += _constant(runs, log)
    remarks += _torque_remarks(runs, robot)
    power, (low, high) = np.concatenate([np.zeros(0), *(run.power for run in runs)]), ARM_POWER
    if len(power) and not low <= power.mean() <= high:
        remarks.append(
            f"the mean power is {power.mean():.3g} W; arms with their controllers take {low:g} to {high:g} W; is the "
            "unit right?"
        )
    if not faults and not len(power):
        remarks.append("no run has a reading of power: nothing but currents and torques can be identified")
    return faults, remarks


def moves_though_static(run: Run, robot: Robot) -> str:
    """What is wrong with a run that is called static and moves; "" for all others."""
    moved = np.ptp(run.position, axis=0)
    if run.kind != "static" or moved.max() <= MOVES:
        return ""
    joint = robot.joints[int(np.argmax(moved))]
    size = f"{moved.max():.3g} {robot.unit('position', joint)}"
    return f'column {joint}.position: moves by {size} in a run called static; expected kind = "motion"'


def _plausible(run: Run, robot: Robot, where: str) -> list[str]:
    """Faults of a run's positions and velocities: motion in a static run, positions outside the limits, and logged
    velocities that are not the slope of the positions.
    """
    faults = [f"{where}: {said}"] if (said := moves_though_static(run, robot)) else []
    for joint, unit, q, low, high in zip(
        robot.joints, robot.units, run.position.T, robot.limits.lower, robot.limits.upper, strict=True
    ):
        out = np.flatnonzero((q < low - OUTSIDE) | (q > high + OUTSIDE))
        if out.size:
            faults.append(
                f"{where}: row {int(run.lines[out[0]])}, column {joint}.position: {q[out[0]]:.4g} {unit} is outside "
                f"the joint's limits [{low:.4g}, {high:.4g}]; is the unit right?"
            )
    if "acceleration" in contradicting(run) and not coarse(run):
        faults.append(f"{where}: columns <joint>.acceleration contradict the positions; are unit and sign right?")
    if run.velocity is not None and len(run.time) > 16 and not coarse(run):
        positions = dataclasses.replace(run, velocity=None, acceleration=None)
        own = kinematics(positions, run.time, choose_smoothing([positions])).v
        for j, joint in enumerate(robot.joints):
            spread = float(np.std(own[:, j]))
            off = float(np.sqrt(np.mean((run.velocity[:, j] - own[:, j]) ** 2)))
            if spread > 0.02 and off > MISMATCH * spread:
                faults.append(
                    f"{where}: column {joint}.velocity: differs from the slope of the positions by {off:.3g} "
                    f"{robot.unit('velocity', joint)} rms "
                    f"(its own spread is {spread:.3g}); are unit and joint right?"
                )
    return faults


LOADED = 2.0  # [N m, N] least spread of the torque of gravity that shows the unit of logged torques
ALIKE = 0.8  # least correlation of logged torques with those of gravity
TIMES = 3.0  # multiple from which neither a payload nor wrong masses explain a torque
LOOKED_AT = 500  # samples used of a run


def _torque_remarks(runs: Sequence[Run], robot: Robot) -> list[str]:
    """A remark on logged torques that go with those of gravity, but have another sign or several times the size."""
    logged, held = [], []
    for run in runs:
        if run.effort is not None:
            at = slice(None, None, max(1, len(run.time) // LOOKED_AT))
            q = run.position[at]
            logged.append(run.effort[at])
            held.append(robot.body.torque(q, np.zeros_like(q), np.zeros_like(q)))
    if not logged:
        return []
    x, y = np.vstack(held), np.vstack(logged)
    x, y = x - x.mean(axis=0), y - y.mean(axis=0)
    found = []
    for j, joint in enumerate(robot.joints):
        spread, own, shared = np.mean(x[:, j] ** 2), np.mean(y[:, j] ** 2), np.mean(x[:, j] * y[:, j])
        if spread > LOADED**2 and shared**2 > ALIKE**2 * spread * own:
            times = shared / spread
            if not 1 / TIMES < times < TIMES:
                found.append(f"{joint} {times:.3g}")
    said = f"logged torques are these multiples of the torque of gravity: {', '.join(found)}; are unit and sign right?"
    return [said] if found else []


def _constant(runs: Sequence[Run], log: LogFile) -> list[str]:
    """Faults of meters that show one value throughout a recording."""
    by_file: dict[str, list[np.ndarray]] = {}
    for run in runs:
        by_file.setdefault(run.file.partition("#")[0], []).append(run.power)
    faults = []
    for file, powers in by_file.items():
        power = np.concatenate(powers)
        if power.size > 100 and np.ptp(power) == 0:
            faults.append(
                f"{log.path.parent / file}: column power: is {power[0]:g} W throughout; is the meter connected?"
            )
    return faults
