"""Values that a plan uses and the user did not give: bounds, friction and electrical values, with their sources.

`break_even` finds the dry friction up to which a saving remains, whatever friction is assumed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import brentq

from energy_opt.effects import CoulombFriction
from energy_opt.power.known import Known, careful, electrical, friction, source_method_2
from energy_opt.power.model import PowerModel
from energy_opt.robot import Robot
from energy_opt.robot.limits import sliding

BOUNDS = ("velocity", "acceleration", "jerk", "effort")
NOTES = {
    ("acceleration", "assumed"): "full speed in no less than 0.2 s, and no more than 50 {unit}",
    ("jerk", "assumed"): "full acceleration in no less than 0.01 s",
    ("velocity", "assumed"): "no usable limit is stated",
    ("effort", "assumed"): "no limit is used; a rating of the drive, for friction and electrical values",
}
ELECTRICAL, FRICTION = "electrical values", "friction"
SIGNS = {"rad/s^2": "rad/s²", "m/s^2": "m/s²"}


@dataclass(frozen=True)
class Assumption:
    """One value: its quantity `what`, its joint (None: the whole arm), its unit and its source.

    `source` is "urdf", "limits" (the user's file), "published" or "assumed"; `note` explains it in words.
    """

    what: str
    joint: str | None
    value: float
    unit: str
    source: str
    note: str = ""


def assumptions(robot: Robot, models: Sequence[PowerModel]) -> tuple[Assumption, ...]:
    """Values that a plan uses: bounds of the robot, and those values of the models that the user did not give.

    Acceleration, jerk and effort of every joint are listed with their source; velocities only if they are assumed.

    Args:
        robot: the arm. models: those that the plan is made under.
    """
    out = []
    for kind in BOUNDS:
        for j, joint in enumerate(robot.joints):
            source, value = robot.sources[kind][j], float(getattr(robot.limits, kind)[j])
            if not np.isfinite(value):
                source, value = "assumed", float(robot.rated.effort[j])
            if kind != "velocity" or source == "assumed":
                unit = robot.unit(kind, joint)
                note = NOTES.get((kind, source), "").format(unit=SIGNS.get(unit, unit))
                out.append(Assumption(kind, joint, value, unit, source, note))
    for what, found in ((ELECTRICAL, electrical(robot)), (FRICTION, friction(robot))):
        for known in found:
            if any(model.get(known.effect.name) == known.effect for model in models):
                out += _records(robot, what, known)
    return tuple(out)


def default_assumptions(robot: Robot) -> tuple[Assumption, ...]:
    """Assumptions of a plan of `robot` if no model is given: under source-method-2 and careful."""
    return assumptions(robot, [source_method_2(robot), careful(robot)])


def _records(robot: Robot, what: str, known: Known) -> list[Assumption]:
    """Assumptions for the first parameter of an effect that is no shape; of a table, its first column."""
    effect, n = known.effect, robot.n
    p = next(p for p in effect.parameters if not p.shapes)
    note = f"{effect.name.replace('_', ' ')}, {p.name}: {known.note}"
    values = effect.values[p.name]
    if not p.per_joint:
        return [Assumption(what, None, float(values[0]), p.unit, known.source, note)]
    if values.ndim > 1:
        note = f"{note}; the value holds for very slow motion"
        values = values[:, 0]
    numbers = np.broadcast_to(values, n).tolist()
    units = [sliding(p.unit) if slides else p.unit for slides in robot.slides]
    return [
        Assumption(what, joint, value, unit, known.source, note)
        for joint, value, unit in zip(robot.joints, numbers, units, strict=True)
    ]


def assumptions_line(records: Sequence[Assumption]) -> str:
    """One line on what is assumed and which options replace it; empty if nothing is assumed."""
    assumed = [row for row in records if row.source == "assumed"]
    kinds = list(dict.fromkeys(row.what for row in assumed))
    bounds = [_range_text(kind, [row for row in assumed if row.what == kind]) for kind in kinds if kind in BOUNDS]
    if bounds:
        bounds[-1] += " (no source)"
    models = [kind for kind in (FRICTION, ELECTRICAL) if kind in kinds]
    if not bounds and not models:
        return ""
    options = ["`--limits`"] * bool(bounds) + ["`--model`"] * bool(models)
    remedy = f"give {', '.join(options)}"
    return f"assumed: {', '.join(bounds + models)}: {'run `diagnose` or ' if models else ''}{remedy}"


def _range_text(kind: str, records: Sequence[Assumption]) -> str:
    """A bound with its value, or the least and the largest of its joints'."""
    if kind not in ("acceleration", "velocity"):
        return kind
    units = {row.unit for row in records}
    if len(units) > 1:
        return kind
    ends = [f"{f([row.value for row in records]):.3g}" for f in (min, max)]
    unit = units.pop()
    return f"{kind} {' to '.join(dict.fromkeys(ends))} {SIGNS.get(unit, unit)}"


def grouped(given: Iterable[Assumption]) -> list[tuple[str, str, str, str]]:
    """Records for a table: what, values with unit, source and note; joints with the same source and note in one."""
    records = tuple(given)
    out: dict[tuple[str, str, str, str], list[Assumption]] = {}
    for row in records:
        out.setdefault((row.what, row.unit, row.source, row.note), []).append(row)
    table = []
    for (what, unit, source, note), same in out.items():
        numbers = [f"{row.value:.4g}" for row in same]
        shown = numbers[0] if len(set(numbers)) == 1 else ", ".join(numbers)
        names = [row.joint for row in same if row.joint is not None]
        partly = 0 < len(names) < len({row.joint for row in records} - {None})
        table.append((what, f"{shown} {unit}" + (f" ({', '.join(names)})" if partly else ""), source, note))
    return table


MOST_FRICTION = 0.2  # largest share of the effort limits at which a break-even is sought; arms have 0.01 to 0.06
TRIALS = 8  # shares that are tried to find the first one without a saving
CLOSE = 1e-5  # tolerance of the break-even, as a share of the effort limits


def break_even(saved: Callable[[PowerModel], float], model: PowerModel, robot: Robot) -> float | None:
    """The share of the effort limits at which dry friction, added to `model`, ends a saving.

    It is sought below the first of TRIALS shares without a saving, to CLOSE.

    Args:
        saved: the saving [J] under a model. model: the model without the added friction. robot: for its effort limits.

    Returns:
        The share; None if the saving lasts up to MOST_FRICTION, or if there is none under `model` itself.
    """
    own = model.get("coulomb_friction")
    held = np.zeros(robot.n) if own is None else np.broadcast_to(own.values["tau_c"], robot.n)

    @cache
    def with_share(share: float) -> float:
        return saved(model.replaced(CoulombFriction(tau_c=held + share * robot.rated.effort)))

    if with_share(0.0) <= 0:
        return None
    low = 0.0
    for high in np.linspace(0, MOST_FRICTION, TRIALS + 1)[1:].tolist():
        if with_share(high) <= 0:
            return float(brentq(with_share, low, high, xtol=CLOSE))
        low = high
    return None


def until(share: float | None) -> str:
    """Sentence on the dry friction, beyond that of the model, up to which a plan saves."""
    size = f"up to {100 * MOST_FRICTION:g}" if share is None else f"less than {100 * share:.2g}"
    return f"the plan still saves energy if each joint has {size} % of its effort limit as further dry friction"
