"""The verbs `robots` and `effects`: lists of the known names."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.effects import effect_class, known_effects
from energy_opt.effects.registry import described_effect
from energy_opt.front.desk import Desk, verb
from energy_opt.power.assumptions import default_assumptions, grouped
from energy_opt.requests.verbs import EffectsRequest, RobotsRequest
from energy_opt.results import Found, Listing
from energy_opt.robot import Robot, known_robots, load_robot

KINDS = ("lower", "upper", "velocity", "acceleration", "jerk", "effort")


@dataclass(frozen=True, eq=False)
class Robots(Found):
    """`robots`, each a `Robot` with its joints and limits."""

    robots: tuple[Robot, ...]

    def document(self) -> dict[str, Any]:
        """Name, URDF, joints with units and limits, joints that do not move or follow, warnings and assumptions."""
        return {"robots": [_row(robot) for robot in self.robots]}

    def text(self, out: Path) -> str:
        """A table for each, for a terminal."""
        return "\n".join(_text(robot) for robot in self.robots)


def run(request: RobotsRequest, desk: Desk) -> Robots:
    """The robots known by name, or those of names and URDFs, with joints and limits."""
    found = Robots(tuple(load_robot(name) for name in (request.names or known_robots())))
    for robot in found.robots:
        for warning in robot.warnings:
            desk.say(f"  warning: {robot.name}: {warning}")
    return found


robots = verb(RobotsRequest, run)


def _row(r: Robot) -> dict[str, Any]:
    """A robot as a document."""
    return {
        "name": r.name,
        "urdf": r.urdf.name,
        "locked": r.locked,
        "followers": {
            name: {"joint": leader, "multiplier": ratio, "offset": offset}
            for name, (leader, ratio, offset) in r.followers.items()
        },
        "warnings": r.warnings,
        "assumptions": [asdict(row) for row in default_assumptions(r)],
        "joints": [
            {"name": joint, "unit": r.units[j], **{kind: getattr(r.limits, kind)[j] for kind in KINDS}}
            for j, joint in enumerate(r.joints)
        ],
    }


def _text(r: Robot) -> str:
    """A robot as a table for a terminal."""
    lines = [f"{r.name}  ({r.n} joints, {r.urdf.name})"]
    lines.append(f"  {'joint':<24}{'position':>24}{'velocity':>10}{'accel.':>9}{'jerk':>9}{'effort':>9}")
    for j, joint in enumerate(r.joints):
        m = r.limits
        bounded = np.isfinite([m.lower[j], m.upper[j]]).all()
        span = f"{m.lower[j]:.4g} … {m.upper[j]:.4g} {r.units[j]}" if bounded else "continuous"
        rates = f"{m.velocity[j]:>10.4g}{m.acceleration[j]:>9.4g}{m.jerk[j]:>9.4g}"
        lines.append(f"  {joint:<24}{span:>24}{rates}{m.effort[j]:>9.4g}")
    for name, (leader, ratio, offset) in r.followers.items():
        lines.append(f"  {name:<24} follows: {ratio:g} times {leader}" + (f" plus {offset:g}" if offset else ""))
    for what, value, source, note in grouped(
        row for row in default_assumptions(r) if row.source in ("published", "assumed")
    ):
        lines.append(f"  {source}: {what} {value}" + (f" ({note})" if note else ""))
    return "\n".join(lines)


def run_effects(request: EffectsRequest, desk: Desk) -> Listing:
    """The effects known, with parameters, units and bounds, laws, options and traits."""
    kinds = [effect_class(name) for name in request.names] or list(known_effects().values())
    found = [described_effect(kind) for kind in kinds]
    return Listing({"effects": found}, "\n\n".join(map(_paragraph, found)))


effects = verb(EffectsRequest, run_effects)


def _paragraph(row: dict[str, Any]) -> str:
    """An effect as lines for a terminal."""
    lines = [row["name"], f"  {row['law']}"]
    for p in row["parameters"]:
        lines.append(f"  {p['name']:<16} {p['words']}; {p['lower']:g} to {p['upper']:g}")
    lines += [f"  {key:<16} {' or '.join(words)}" for key, words in row["options"].items()]
    return "\n".join([*lines, f"  {', '.join(row['traits'])}"])
