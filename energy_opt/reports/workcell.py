"""The page of a cell: all arms moving, a Gantt chart of all robots with their power, and what each lever saves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from energy_opt.reports.page import Report
from energy_opt.reports.timeline import FILLS, GAP, LANE, LEFT, RIGHT, WIDE, block, drawing, text, with_time

MODES = ("#b8bfc8", "#e5d7a8", "#c9b3dc", "#a9d6c0", "#e7b9a6")  # fills of waits, by mode
ZONES = ("#c23b6b", "#8a6d00", "#00797a", "#6a4fb3")
STRIP = 7.0  # height of a zone's strip
TOTAL, SAVED, MORE = "#2f74c0", "#2e9a60", "#d1691c"
HIGH, BAR = 240.0, 0.6  # height of the waterfall, and the share of its place that a bar takes
LETTERS = 16  # of a robot's name


def gantt(robots: Sequence[Mapping[str, Any]], cycle: float, power: tuple[np.ndarray, np.ndarray] | None = None) -> str:
    """An SVG drawing of a periodic cycle: a lane for every robot, zones below it, the power of all at the bottom.

    Args:
        robots: name and steps: name, start, duration [s], mode (None: it moves) and zone.
        power: time (N,) [s] and power (N,) [W].
    """
    scale = (WIDE - LEFT - RIGHT) / cycle
    fills = dict(zip(_names(robots, "mode"), [*MODES] * 9, strict=False))
    zones = dict(zip(_names(robots, "zone"), [*ZONES] * 9, strict=False))

    def at(time: float) -> float:
        return LEFT + scale * float(time)

    parts, y = [], 0.0
    for robot in robots:
        parts.append(text(LEFT - 6, y + LANE / 2, str(robot["name"])[:LETTERS], "end"))
        for step in robot["steps"]:
            mode, zone = step["mode"], step.get("zone")
            what = str(step["name"]) if mode is None else f"{step['name']} ({mode})"
            for begin, end in _within(step["start"], step["duration"], cycle):
                parts.append(
                    block(at(begin), y, scale * (end - begin), what, fills.get(mode, FILLS["move"]), mode is None)
                )
                if zone is not None:
                    place = f'x="{at(begin):.1f}" y="{y + LANE + 1:.1f}" width="{scale * (end - begin):.1f}"'
                    parts.append(f'<rect {place} height="{STRIP:.0f}" fill="{zones[zone]}"/>')
        y += LANE + GAP + (STRIP if zones else 0.0)
    lines, marks, y = with_time(parts, power, cycle, at, y)
    y += 32
    x = LEFT
    for name, fill in [("moves", FILLS["move"]), *((f"waits: {m}", f) for m, f in fills.items()),
                       *((f"zone {z}", f) for z, f in zones.items())]:  # fmt: skip
        marks.append(f'<rect x="{x:.0f}" y="{y - 6:.0f}" width="14" height="12" fill="{fill}"/>')
        marks.append(text(x + 20, y, name, "start"))
        x += 40 + 7 * len(name)
    return drawing([*lines, *parts, *marks], y + 14, "Gantt chart of all robots")


def waterfall(levers: Sequence[tuple[str, float]]) -> str:
    """An SVG drawing: the energy [J] of the first, what each of the others saves, and what is left."""
    total, left = levers[0][1], levers[-1][1]
    low = min(energy for _, energy in levers)
    floor = max(0.0, low - 2 * (max(e for _, e in levers) - low)) if low > 0 else 0.0  # where bars begin
    top = max(energy for _, energy in levers)

    def up(energy: float) -> float:
        return 20 + HIGH * (1 - (energy - floor) / max(top - floor, 1e-9))

    bars = [(levers[0][0], floor, total, TOTAL, f"{total:.6g} J")]
    for (_, before), (name, energy) in zip(levers, levers[1:], strict=False):
        bars.append((name, min(before, energy), max(before, energy), SAVED if energy <= before else MORE,
                     f"{energy - before:+.4g} J"))  # fmt: skip
    bars.append(("the plan", floor, left, TOTAL, f"{left:.6g} J"))
    width, parts = (WIDE - LEFT - RIGHT) / len(bars), []
    for k, (name, begin, end, fill, words) in enumerate(bars):
        x = LEFT + k * width
        high = max(up(begin) - up(end), 1.5)
        place = f'x="{x + (1 - BAR) / 2 * width:.1f}" y="{up(end):.1f}" width="{BAR * width:.1f}"'
        parts.append(f'<rect {place} height="{high:.1f}" fill="{fill}"/>')
        parts.append(text(x + width / 2, up(end) - 9, words))
        parts.append(text(x + width / 2, HIGH + 34, name))
    if floor > 0:
        parts.append(text(LEFT, HIGH + 54, f"bars of totals begin at {floor:.4g} J", "start"))
    return drawing(parts, HIGH + 64, "what each lever saves")


def _names(robots: Sequence[Mapping[str, Any]], key: str) -> list[str]:
    found = (step.get(key) for robot in robots for step in robot["steps"])
    return list(dict.fromkeys(name for name in found if name is not None))


def _within(start: float, duration: float, cycle: float) -> list[tuple[float, float]]:
    """An interval of a periodic cycle as parts of [0, cycle]."""
    if duration <= 0:
        return []
    begin = start % cycle
    end = begin + min(duration, cycle)
    return [(begin, end)] if end <= cycle else [(begin, cycle), (0.0, end - cycle)]


BRIEF = 1e-6  # [s] shorter waits are not shown
SLOWED = (
    "Up to paths, levers are schedules of moves slowed evenly along their first paths: exact for these, but not kept "
    "apart from other arms. From paths on, moves are optimized and the arms are proven apart."
)


def page(
    document: Mapping[str, Any],
    power: tuple[np.ndarray, np.ndarray] | None = None,
    scene: Mapping[str, Any] | None = None,
) -> Report:
    """The report of a job.json of several robots.

    Args:
        power: of all robots over the cycle: time (N,) [s] and power (N,) [W].
        scene: all arms in one scene, as `cell_player` gives it.
    """
    report = Report(f"A cell of {len(document['robots'])} robots: a cycle of {document['cycle_time']:.5g} s")
    report.headline(headline(document))
    for warning in document["warnings"]:
        report.warning(warning)
    report.player(scene)
    report.section("The cycle of all robots").drawing(gantt(document["robots"], document["cycle_time"], power))
    if power is not None:
        where = float(power[0][int(np.argmax(power[1]))])
        report.text(f"At the bottom the power of all robots: {power[1].max():.4g} W at most, at {where:.4g} s.")
    levers = document["levers"]
    report.section("What each lever saves").drawing(waterfall([(_said(x), x["energy_total"]) for x in levers]))
    first = levers[0]["energy_total"]

    def row(name: str, lever: Mapping[str, Any]) -> list[Any]:
        energy, year = lever["energy_total"], lever.get("per_year", {})
        return [name, energy, first - energy, 100 * (1 - energy / first), year.get("kwh"), year.get("money")]

    records = [row(_said(x), x) for x in levers]
    records += [row(f"{_said(x)} alone", x) for x in document["levers_alone"]]
    if document["bound"] is not None:
        records.append(["lower bound of these curves", document["bound"], *[None] * 4])
    header = ["with", "energy of the cycle [J]", "saved [J]", "saved [%]", "saved [kWh a year]", "saved [money a year]"]
    report.table(header, records, digits=6)
    if any(lever["moves"] == "evenly_slowed" for lever in levers):
        report.text(SLOWED)
    for robot in document["robots"]:
        report.section(str(robot["name"])).table(
            ["step", "begins [s]", "takes [s]", "mode", "zone", "energy [J]"],
            [
                [s["name"], s["start"], s["duration"], s["mode"] or "moves", s["zone"], s["energy_total"]]
                for s in robot["steps"]
                if s["duration"] > BRIEF
            ],
            digits=6,
        )
    report.section("Files for controllers").table(
        ["file", "robot", "begins [s]", "within all limits"],
        [[w["file"], w["robot"], w["starts_at"], w["valid"]] for w in document["written"]],
    )
    return report.command(document.get("request"))


def headline(document: Mapping[str, Any]) -> str:
    """One sentence: energy, bound, and what was saved."""
    total, first = document["energy_total"], document["levers"][0]["energy_total"]
    gap = document["optimality"]["gap_percent"]
    text = f"{total:.6g} J a cycle"
    if gap is not None:
        text += f", at most {gap:.2g} % above the least of these curves"
    return f"{text}; {100 * (1 - total / first):.3g} % less than at full speed." if total < first else f"{text}."


def _said(lever: Mapping[str, Any]) -> str:
    return str(lever["name"]).replace("_", " ")
