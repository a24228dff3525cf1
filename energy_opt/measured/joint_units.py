"""Units of the joints' columns of a file: named by headers or a row of units, else guessed from the values.

Every joint has a unit of its own: an arm may turn in degrees and slide in millimetres.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.measured.columns import named_unit
from energy_opt.measured.header import BY_SIGNAL, LENGTHS, POSITIONS, UNITS, known_unit
from energy_opt.measured.joints import FEWEST
from energy_opt.measured.plausible import are_degrees, continued, degrees_fault, into_limits, leaps, spikes
from energy_opt.measured.run import Run
from energy_opt.measured.stated_units import stated_unit
from energy_opt.measured.table import Table
from energy_opt.numerics.signals import SHORTEST
from energy_opt.numerics.stamps import clean
from energy_opt.numerics.turns import TURN
from energy_opt.robot import Robot

ALIKE = 0.25  # relative deviation up to which a measured ratio identifies a unit
BEYOND = 3.0  # multiple of a sliding joint's range from which its positions cannot be metres
MOVED = 0.02  # [rad, m] least motion that shows the unit of a velocity
MOVES = 0.3  # [rad] least range of a joint that moves
LASTS = 0.1  # [s] over which velocities are compared with the change of positions
MOST_AMPERES = 100.0  # [A] largest plausible current of a joint or a supply: 20 kW from the mains are 87 A
TOGETHER = 0.6  # least correlation of velocities with the slope of the positions

FAST = " (as radians the joints would be too fast)"
TOO_FAST = f"positions are degrees{FAST}: converted"  # said of a guess

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
    time: np.ndarray, words: list[str], sure: dict[str, bool],
) -> dict[str, Units]:  # fmt: skip
    """The unit of every joint's column, by signal. Velocities in no known unit are left out.

    Args:
        columns: header by signal and joint. values: by signal (N, n), as written. time: (N,) [s].
        words: receives what was guessed. sure: receives by column of an angle: True if its values show that it is in
            degrees; False if it has the unit of other angles, though it may be in radians.

    Raises:
        BadInput: an angle's unit is named for a joint that slides, or a length's for one that turns.
    """
    named = {signal: _named(table, robot, signal, by) for signal, by in columns.items()}
    by_hand = {joint for joint, column in columns["position"].items() if column in table.by_hand}
    angles, shown = _angle_units(values, time, robot, named, words, by_hand)
    sure |= {columns["position"][joint]: clear for joint, clear in shown.items()}
    out = {"position": _with_lengths(values["position"], robot, angles, words)}
    position = values["position"] * _factors(out["position"], robot)
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
    """The unit that the file names for each joint; without one, an angle has none, else it is that of the others."""
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
    kinds = (True,) if signal == "position" else (False, True)
    groups = [[j for j, s in zip(robot.joints, robot.slides, strict=True) if s == kind] for kind in kinds]
    return out | {joint: unit for group in groups for joint, unit in _shared(out, group).items()}


def _shared(units: Units, joints: Sequence[str]) -> Units:
    """The units of some joints; those without one have the first that is named."""
    first = next((units[joint] for joint in joints if units[joint] is not None), None)
    return {joint: units[joint] or first for joint in joints}


def _with_lengths(values: np.ndarray, robot: Robot, named: Units, words: list[str]) -> Units:
    """Units of the positions (N, n): those of lengths are found joint by joint."""
    out = dict(named)
    for k, joint in enumerate(robot.joints):
        if robot.slides[k] and out[joint] is None:
            far = float(np.nanmax(np.abs(values[:, k]), initial=0.0))
            reach = BEYOND * float(max(abs(robot.limits.lower[k]), abs(robot.limits.upper[k])))
            out[joint] = "mm" if reach < far < 1000 * reach else "m"
            if out[joint] == "mm":
                words.append(f"positions of {joint} are mm (as metres they are far outside the limits): converted")
    return out


def _angle_units(
    columns: Mapping[str, np.ndarray], time: np.ndarray, robot: Robot, named: Mapping[str, Units], words: list[str],
    by_hand: Collection[str],
) -> tuple[Units, dict[str, bool]]:  # fmt: skip
    """Units of the angles, and what `joint_units` says of `sure`, by joint.

    Degrees are shown by positions, or speeds between samples, that are far outside the limits as radians, unless the
    file states another unit, or the user states any (for the joints `by_hand`). An angle without a unit has that of
    the others, unless the logged velocities show another.
    """
    turning = [k for k, slides in enumerate(robot.slides) if not slides]
    out, values, time = dict(named["position"]), columns["position"], time[: len(columns["position"])]
    good = np.isfinite(values).all(axis=1) & np.isfinite(time)
    values, at = values[good] * _factors(out, robot), time[good]
    if len(at) > 2:  # a few damaged samples say nothing about the unit of all
        real = ~spikes(at, values, robot)
        recorded = values[real]
        values, at = continued(at[real], recorded, robot)[0], at[real]
        piece = np.searchsorted(leaps(at, values, robot), np.arange(len(at)))
        real = np.bincount(piece)[piece] >= min(FEWEST, len(at))
        at, gaps = at[real], np.flatnonzero(np.diff(at[real]) > SHORTEST)
        values = into_limits(values[real], robot, gaps.tolist(), recorded[real])[0]
    usual = {out[robot.joints[k]] for k in turning} <= {None, "rad", "deg"}
    doubtful = [
        k for k in turning if usual and robot.joints[k] not in by_hand and out[robot.joints[k]] in (None, "rad")
    ]
    shown = [robot.joints[k] for k in doubtful if _far(values, k, robot, out)]
    why = " (as radians they are far outside the limits)" if shown else ""
    if any(out[joint] for joint in shown):  # the file says rad of all alike
        why = f"{why[:-1]}, though the file says rad)"
        out = {joint: None if unit == "rad" and joint not in by_hand else unit for joint, unit in out.items()}
    if not shown:
        fast = _too_fast(values, at, robot)
        shown = [robot.joints[k] for k in doubtful if fast[k] and out[robot.joints[k]] is None]
        why = FAST if shown else ""
    out |= dict.fromkeys(shown, "deg")
    others = list(dict.fromkeys(unit for k in turning if (unit := out[robot.joints[k]])))
    sure = dict.fromkeys(shown, True)
    if others not in ([], ["rad"]):
        out |= _by_velocities(columns, time, robot, out, named)
    for k in turning:
        joint = robot.joints[k]
        if out[joint] is None:
            out[joint] = others[0] if others else "rad"
            if len(others) > 1 or _may_be_radians(values[:, k], UNITS["position"][out[joint] or "rad"], robot, k):
                sure[joint] = False
    for unit in dict.fromkeys(out[robot.joints[k]] for k in turning):
        having = [robot.joints[k] for k in turning if out[robot.joints[k]] == unit]
        of = "" if len(having) == len(turning) else f" of {', '.join(having)}"
        if unit != "rad":
            name, reason = ("degrees", why) if unit == "deg" else (unit, "")
            words.append(f"positions{of} are {name}{reason}: converted")
    return out, sure


def _factors(units: Units, robot: Robot) -> np.ndarray:
    """Factors (n,) to SI units of positions."""
    return np.array([UNITS["position"][units[joint] or "rad"] for joint in robot.joints])


def _far(values: np.ndarray, k: int, robot: Robot, named: Units) -> bool:
    """Whether joint k of positions (N, n) is far outside its limits as radians, and no joint is as degrees."""
    alone = np.tile(robot.limits.near_zero, (len(values), 1))
    alone[:, k] = values[:, k]
    shows = are_degrees if named[robot.joints[k]] is None else degrees_fault
    return bool(shows(values, robot)) and bool(shows(alone, robot))


def _too_fast(values: np.ndarray, time: np.ndarray, robot: Robot) -> np.ndarray:
    """Which joints (n,) are too fast for positions (N, n) in radians, by speeds over a tenth of a second."""
    apart = max(1, int(0.1 / max(float(np.median(np.diff(time))), 1e-6))) if len(time) > 20 else len(time)
    if len(time) <= apart:
        return np.zeros(robot.n, dtype=bool)
    rate = np.abs(values[apart:] - values[:-apart]) / np.maximum(time[apart:] - time[:-apart], 1e-9)[:, None]
    jumps = leaps(time, values, robot)[:, None] - np.arange(apart)  # no speed can be taken over these
    rate = np.delete(rate, jumps[(jumps >= 0) & (jumps < len(rate))], axis=0)
    limit = np.where(np.isfinite(robot.limits.velocity), robot.limits.velocity, np.pi)
    return np.asarray(np.percentile(rate, 99, axis=0) > 3 * limit)


def _may_be_radians(values: np.ndarray, factor: float, robot: Robot, k: int) -> bool:
    """Whether angles (N,) of joint k are inside its limits as radians, where the joint moves, but not by the factor."""
    low, high = (np.clip(end[k], -TURN, TURN) for end in (robot.limits.lower, robot.limits.upper))
    reach = float(np.ptp(values)) if len(values) else 0.0
    inside = bool(((values > low - MOVES) & (values < high + MOVES)).all())
    return inside and reach * factor < MOVES < reach


def _by_velocities(
    columns: Mapping[str, np.ndarray], time: np.ndarray, robot: Robot, units: Units, named: Mapping[str, Units]
) -> Units:
    """Units of angles without one whose logged velocities show them.

    Velocities without a unit are of use only if those of other angles are in rad/s or rpm: in the angles' own unit,
    they are their slope whatever it is.
    """
    if "velocity" not in columns:
        return {}
    raw, velocity = columns["position"], columns["velocity"]
    known = [k for k, joint in enumerate(robot.joints) if not robot.slides[k] and units[joint]]
    position = raw * _factors(units, robot)
    good, time, cuts = _in_order(time, position, velocity, robot)
    shared = _slope_ratio(velocity[good][:, known], position[good][:, known], time, cuts) or 0.0
    fit = next((unit for unit in ("rad/s", "rpm") if abs(shared * UNITS["velocity"][unit] - 1) < ALIKE), None)
    out: Units = {}
    for k, joint in enumerate(robot.joints):
        of = named["velocity"][joint] or fit
        if not robot.slides[k] and units[joint] is None and of is not None:
            ratio = _slope_ratio(velocity[good, k : k + 1] * UNITS["velocity"][of], raw[good, k : k + 1], time, cuts)
            off = {u: abs((ratio or np.inf) / factor - 1) for u, factor in POSITIONS.items() if u not in LENGTHS}
            nearest = min(off, key=off.__getitem__)
            out[joint] = nearest if off[nearest] < ALIKE else None
    return out


def _velocity_units(
    values: np.ndarray, position: np.ndarray, time: np.ndarray, robot: Robot, named: Units, of_position: Units,
    words: list[str],
) -> Units | None:  # fmt: skip
    """Units in which logged velocities (N, n) are the slope of the positions [SI]; None if no unit fits.

    Joints whose positions have one unit share one. Samples are those of the reading, cut where it cuts.
    """
    out = dict(named)
    good, time, cuts = _in_order(time, position, values, robot)
    values, position = values[good], position[good]
    for of in dict.fromkeys(of_position.values()):
        group = [k for k, joint in enumerate(robot.joints) if of_position[joint] == of]
        if named[robot.joints[group[0]]] is not None:
            continue
        units, assumed = ("m/s", "mm/s") if of in LENGTHS else ("rad/s", "deg/s", "rpm"), f"{of}{BY_SIGNAL['velocity']}"
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


def _in_order(
    time: np.ndarray, position: np.ndarray, rates: np.ndarray, robot: Robot
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Indices (M,) of samples that are not damaged, their times (M,), and after which of them there is a gap."""
    time = time[: len(rates)]
    good = np.flatnonzero(np.isfinite(np.column_stack([time, position, rates])).all(axis=1))
    if len(good) <= 2:
        return good, time[good], np.zeros(0, dtype=int)
    good = good[~spikes(time[good], position[good], robot)]
    samples = clean(time[good], np.column_stack([position[good], rates[good]]))
    good = good[samples.kept]
    return good, samples.time, np.union1d(samples.gaps, leaps(samples.time, position[good], robot)).astype(int)


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
