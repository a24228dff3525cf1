"""The page of a cell: all arms moving, a Gantt chart of all robots with their power, and what each lever saves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from energy_opt.reports.gantt import gantt, waterfall
from energy_opt.reports.page import Report

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
