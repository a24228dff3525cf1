"""Units of the joints' columns of a file: named by headers or a row of units, else guessed from the values.

Every joint has a unit of its own: an arm may turn in degrees and slide in millimetres.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.measured.columns import named_unit
from energy_opt.measured.header import BY_SIGNAL, LENGTHS, UNITS, known_unit
from energy_opt.measured.joints import FEWEST
from energy_opt.measured.plausible import are_degrees, degrees_fault, leaps, spikes
from energy_opt.measured.run import Run
from energy_opt.measured.stated_units import stated_unit
from energy_opt.measured.table import Table
from energy_opt.numerics.stamps import clean
from energy_opt.robot import Robot

ALIKE = 0.25  # relative deviation up to which a measured ratio identifies a unit
BEYOND = 3.0  # multiple of a sliding joint's range from which its positions cannot be metres
MOVED = 0.02  # [rad, m] least motion that shows the unit of a velocity
LASTS = 0.1  # [s] over which velocities are compared with the change of positions
MOST_AMPERES = 100.0  # [A] largest plausible current of a joint or a supply: 20 kW from the mains are 87 A
TOGETHER = 0.6  # least correlation of velocities with the slope of the positions

TOO_FAST = "positions are degrees (as radians the joints would be too fast): converted"  # said of a guess

Units = dict[str, str | None]  # by joint; None: SI


def without_foreign(columns: dict[str, dict[str, str]], table: Table, words: list[str]) -> None:
    """Take signals out of `columns` whose unit is no unit of theirs; torques in amperes become currents.

    Args:
        columns: header by signal and joint. words: receives what was left out.
    """
    for signal in [name for name in columns if name != "position"]:
        units = [stated_unit(signal, c, table.units.get(c, ""), joint) for joint, c in columns[signal].items()]
        if any(not unit or known_unit(signal, unit) for unit in units):  # a single letter may be a joint's name
            continue
        by = columns.pop(signal)
        if signal == "effort" and known_unit("current", units[0]) and "current" not in columns:
            columns["current"] = by
            words.append(f"{signal} in {units[0]}: taken for currents")
        else:
            words.append(f"{signal} is left out: its unit {units[0]} is not known")


def joint_units(
    table: Table, robot: Robot, columns: Mapping[str, Mapping[str, str]], values: Mapping[str, np.ndarray],
    time: np.ndarray, words: list[str],
) -> dict[str, Units]:  # fmt: skip
    """The unit of every joint's column, by signal. Velocities in no known unit are left out.

    Args:
        columns: header by signal and joint. values: by signal (N, n), as written. time: (N,) [s].
        words: receives what was guessed.

    Raises:
        BadInput: an angle's unit is named for a joint that slides, or a length's for one that turns.
    """
    named = {signal: _named(table, robot, signal, by) for signal, by in columns.items()}
    out = {"position": _position_units(values["position"], time, robot, named["position"], words)}
    position = values["position"] * [UNITS["position"][out["position"][joint] or "rad"] for joint in robot.joints]
    for signal in columns:
        if signal == "velocity":
            rates = _velocity_units(values[signal], position, time, robot, named[signal], out["position"], words)
            if rates is not None:
                out[signal] = rates
        elif signal == "acceleration":
            of = out["position"]
            out[signal] = {joint: named[signal][joint] or f"{of[joint]}{BY_SIGNAL[signal]}" for joint in robot.joints}
        elif signal != "position":
            out[signal] = named[signal]
        unnamed = signal == "current" and set(named[signal].values()) == {None}
        if unnamed and np.nanpercentile(np.abs(values[signal]), 95, axis=0).max() > MOST_AMPERES:
            out[signal] = dict.fromkeys(robot.joints, "mA")
            words.append("currents are milliamperes (as amperes they would be too large): converted")
    return out


def units_in_words(signal: str, units: Units, robot: Robot) -> str:
    """The units of a signal for a message: one for all joints, or one for each."""
    si = next(iter(UNITS[signal]))
    each = [units[joint] or si for joint in robot.joints]
    return each[0] if len(set(each)) == 1 else ", ".join(each)


def _named(table: Table, robot: Robot, signal: str, by: Mapping[str, str]) -> Units:
    """The unit that the file names for each joint; a joint without one has that of the others of its kind."""
    out = {joint: named_unit(signal, by[joint], table, joint) for joint in robot.joints}
    if signal not in BY_SIGNAL:
        return _shared(out, robot.joints)
    length = [f"{unit}{BY_SIGNAL[signal]}" for unit in LENGTHS]
    for joint, slides in zip(robot.joints, robot.slides, strict=True):
        unit, si = out[joint], next(iter(UNITS[signal]))
        if slides and unit == si:  # recorders write one unit for all joints: both are SI
            out[joint] = length[0]
        elif unit is not None and (unit in length) != slides:
            expected = ", ".join(u for u in UNITS[signal] if (u in length) == slides)
            raise BadInput(
                f"{table.path}: column {by[joint]!r}: the unit is {unit}, but {joint} "
                f"{'slides' if slides else 'turns'}; expected {expected}"
            )
    groups = [[j for j, s in zip(robot.joints, robot.slides, strict=True) if s == kind] for kind in (False, True)]
    return {joint: unit for group in groups for joint, unit in _shared(out, group).items()}


def _shared(units: Units, joints: Sequence[str]) -> Units:
    """The units of some joints; those without one have the first that is named."""
    first = next((units[joint] for joint in joints if units[joint] is not None), None)
    return {joint: units[joint] or first for joint in joints}


def _position_units(values: np.ndarray, time: np.ndarray, robot: Robot, named: Units, words: list[str]) -> Units:
    """Units of the positions: that of angles is one for all, that of lengths is found joint by joint."""
    turning = [joint for joint, slides in zip(robot.joints, robot.slides, strict=True) if not slides]
    angles = {named[joint] for joint in turning}
    out = dict(named)
    if len(angles) == 1:
        angle = _angle_unit(values, time, robot, next(iter(angles)), words)
        out |= dict.fromkeys(turning, angle)
    for k, joint in enumerate(robot.joints):
        if robot.slides[k] and out[joint] is None:
            far = float(np.nanmax(np.abs(values[:, k]), initial=0.0))
            reach = BEYOND * float(max(abs(robot.limits.lower[k]), abs(robot.limits.upper[k])))
            out[joint] = "mm" if reach < far < 1000 * reach else "m"
            if out[joint] == "mm":
                words.append(f"positions of {joint} are mm (as metres they are far outside the limits): converted")
    return out


def _angle_unit(values: np.ndarray, time: np.ndarray, robot: Robot, named: str | None, words: list[str]) -> str:
    """Unit of the angles: degrees if they, or speeds between samples, are far outside the limits as radians."""
    good = np.isfinite(values).all(axis=1) & np.isfinite(time[: len(values)])
    values, time = values[good], time[: len(values)][good]
    if len(time) > 2:  # a few damaged samples say nothing about the unit of all
        real = ~spikes(time, values, robot)
        values, time = values[real], time[real]
        piece = np.searchsorted(leaps(time, values, robot), np.arange(len(time)))
        real = np.bincount(piece)[piece] >= min(FEWEST, len(time))
        values, time = values[real], time[real]
    far = are_degrees(values, robot) if named is None else degrees_fault(values, robot) is not None
    if named in (None, "rad") and far:
        against = ", though the file says rad" if named == "rad" else ""
        words.append(f"positions are degrees (as radians they are far outside the limits{against}): converted")
        return "deg"
    apart = max(1, int(0.1 / max(float(np.median(np.diff(time))), 1e-6))) if len(time) > 20 else len(time)
    if named is None and len(time) > apart:  # speeds over a tenth of a second
        rate = np.abs(values[apart:] - values[:-apart]) / np.maximum(time[apart:] - time[:-apart], 1e-9)[:, None]
        jumps = leaps(time, values, robot)[:, None] - np.arange(apart)  # no speed can be taken over these
        rate = np.delete(rate, jumps[(jumps >= 0) & (jumps < len(rate))], axis=0)
        limit = np.where(np.isfinite(robot.limits.velocity), robot.limits.velocity, np.pi)
        fast = np.percentile(rate, 99, axis=0) > 3 * limit
        if (fast & ~np.array(robot.slides)).any():
            words.append(TOO_FAST)
            return "deg"
    if named not in (None, "rad"):
        words.append(f"positions are {'degrees' if named == 'deg' else named}: converted")
    return named or "rad"


def _velocity_units(
    values: np.ndarray, position: np.ndarray, time: np.ndarray, robot: Robot, named: Units, of_position: Units,
    words: list[str],
) -> Units | None:  # fmt: skip
    """Units in which logged velocities (N, n) are the slope of the positions [SI]; None if no unit fits.

    Joints that turn share one unit, and so do joints that slide. Samples are those of the reading, cut where it cuts.
    """
    out, cuts = dict(named), np.zeros(0, dtype=int)
    time = time[: len(values)]
    good = np.flatnonzero(np.isfinite(np.column_stack([time, position, values])).all(axis=1))
    if len(good) > 2:
        good = good[~spikes(time[good], position[good], robot)]
        samples = clean(time[good], np.column_stack([position[good], values[good]]))
        good, time = good[samples.kept], samples.time
        cuts = np.union1d(samples.gaps, leaps(time, position[good], robot)).astype(int)
        values, position = values[good], position[good]
    for kind, units in ((False, ("rad/s", "deg/s", "rpm")), (True, ("m/s", "mm/s"))):
        group = [k for k, slides in enumerate(robot.slides) if slides == kind]
        if not group or named[robot.joints[group[0]]] is not None:
            continue
        assumed = f"{of_position[robot.joints[group[0]]]}{BY_SIGNAL['velocity']}"
        ratio = _slope_ratio(values[:, group], position[:, group], time, cuts)
        fitting = (unit for unit in (*units, assumed) if ratio and abs(ratio * UNITS["velocity"][unit] - 1) < ALIKE)
        unit = assumed if ratio is None else next(fitting, None)
        if unit is None:
            words.append("velocities are left out: they are not the slope of the positions in any unit known")
            return None
        if unit != assumed:
            words.append(f"velocities are {unit} (by the slope of the positions): converted")
        out |= dict.fromkeys([robot.joints[k] for k in group], unit)
    return out


def contradicting(run: Run) -> Iterator[str]:
    """The logged rates of a run that are not the slope of its positions: "velocity", "acceleration"."""
    slope = run.position
    for name, rate in (("velocity", run.velocity), ("acceleration", run.acceleration)):
        if rate is not None:
            ratio = _slope_ratio(rate, slope, run.time)
            if ratio is None or abs(ratio - 1) < ALIKE:
                slope = rate
                continue
            yield name
        ends = [np.clip(run.time + x, run.time[0], run.time[-1]) for x in (-LASTS / 2, LASTS / 2)]
        change = [np.interp(ends[1], run.time, x) - np.interp(ends[0], run.time, x) for x in slope.T]
        slope = np.column_stack(change) / (ends[1] - ends[0])[:, None]


def _slope_ratio(
    velocity: np.ndarray, position: np.ndarray, time: np.ndarray, cuts: np.ndarray | None = None
) -> float | None:
    """Ratio of velocities (N, n) to the slope of the positions (N, n), over `LASTS`; 0 if they do not go together.

    None if there are too few samples, or the positions hardly move. Slopes from sample to sample would show the steps
    of a coarse encoder. What happens in the steps after the samples `cuts` (K,) is not known and does not count.
    """
    if len(time) < 20:
        return None
    step, change = np.diff(time), np.diff(position, axis=0)
    apart = min(max(1, round(LASTS / float(np.median(step)))), len(time) // 2)
    if cuts is not None:
        step[cuts], change[cuts] = 0, 0
    begin = np.zeros((1, position.shape[1]))
    path = np.vstack([begin, np.cumsum(change, axis=0)])
    if np.ptp(path, axis=0).max() < MOVED:
        return None
    way = np.vstack([begin, np.cumsum((velocity[1:] + velocity[:-1]) / 2 * step[:, None], axis=0)])
    by_velocity, moved = way[apart:] - way[:-apart], path[apart:] - path[:-apart]
    shared, own, size = (float(np.sum(x)) for x in (by_velocity * moved, moved**2, by_velocity**2))
    return shared / max(own, 1e-12) if shared > TOGETHER * np.sqrt(own * size) else 0.0
