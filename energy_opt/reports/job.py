"""The page of a job: energy of the cycle, use of its time, and the arm through the whole of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.power.per_year import per_year_words
from energy_opt.reports.charts import Block, Chart, Line
from energy_opt.reports.motion import Motion, Played, player
from energy_opt.reports.optimize import assumed, motion_charts
from energy_opt.reports.page import Report
from energy_opt.reports.words import of_models, yearly
from energy_opt.robot import Robot

LANES = {"move": "moves", "wait": "waits", "standby": "standby"}
GIVEN = "through the poses"  # a job's words for a given path: the curve through its poses


def page(
    document: Mapping[str, Any],
    cycle: Motion,
    robot: Robot,
    cell: Cell | None = None,
    power: tuple[np.ndarray, np.ndarray] | None = None,
) -> Report:
    """The report of a job.json.

    Args:
        cycle: the whole cycle as one motion.
        cell: bodies for drawing the moving arm; None: the arm's own.
        power: over the cycle, time (N,) [s] and power (N,) [W].
    """
    report = Report(f"{document['robot']}: a cycle of {document['cycle_time']:.4g} s")
    report.headline(headline(document)).numbers(yearly(document))
    if document["status"] != "solved":
        report.warning("Not every step is solved; the table marks them.")
    report.warning(*document.get("warnings", ()))
    steps = document["steps"]
    names = [f"{k}. {row['name']}" for k, row in enumerate(steps, start=1)]
    phases = [(row["start"], name) for name, row in zip(names, steps, strict=True)]
    report.player(player(robot, [Played("result", cycle)], cell, phases=phases))
    drawn = [] if power is None else [Line("power", *power)]
    report.section("Timeline").charts(
        Chart("Motion of the arm", "time [s]", "", timed=True, blocks=timeline(steps)),
        Chart("Electrical power of the cycle", "time [s]", "power [W]", drawn, timed=True),
    )
    durations, energies = (
        {name: float(row[key]) for name, row in zip(names, steps, strict=True)} for key in ("duration", "energy_total")
    )
    report.section("Time and energy of the steps").charts(
        Chart("Time of each step", "duration [s]", "", bars={"result": durations}),
        Chart("Energy of each step", "energy, standby included [J]", "", bars={"result": energies}),
    )
    shown = [{**row, "name": name} for name, row in zip(names, steps, strict=True)]
    shown = [{**row, "first_path": GIVEN} if row.get("first_path") == "given" else row for row in shown]
    columns = {"step": "name", "begins [s]": "start", "takes [s]": "duration", "energy [J]": "energy_total"}
    columns |= {"payload [kg]": "payload", "mode": "source", "first path": "first_path", "status": "status"}
    report.records(shown, columns)
    total, baselines, of = _minimised(document)
    bound = (document.get("robust") or document["optimality"])["lower_bound"]
    report.section("Comparison with simple cycles").table(
        ["", f"energy of the cycle [J]{of}"],
        [
            ["this plan", total],
            *([name, energy] for name, energy in baselines.items()),
            *([] if bound is None else [["proven lower bound of retiming", bound]]),
        ],
        digits=7,
    )
    columns = {"energy of the cycle [J]": "total", "saved against evenly slowed [J]": "saving_joules"}
    columns["saved [%]"] = "saving_total_percent"
    report.models("The same cycle under other models", document.get("models"), columns)
    assumed(report, document)
    charts = [chart for chart in motion_charts(cycle, {}, robot) if not chart.empty]
    report.section("Motion").charts(*charts)
    return report.command(document.get("request"))


def timeline(steps: Sequence[Mapping[str, Any]]) -> list[Block]:
    """A cycle's moves and waits as bars along its time, and each payload for as long as it stays.

    Args:
        steps: name, kind ("move", "wait" or "standby"), start, duration [s] and payload [kg].
    """
    out = [Block(LANES[s["kind"]], str(s["name"]), s["start"], s["duration"], s["kind"]) for s in steps]
    for mass, held in groupby(steps, lambda step: float(step["payload"] or 0.0)):
        carrying = list(held)
        seconds = sum(step["duration"] for step in carrying)
        out += [Block("payload", f"{mass:.3g} kg", carrying[0]["start"], seconds, "payload")] if mass else []
    return out


def headline(document: Mapping[str, Any]) -> str:
    """One sentence: energy of the cycle, compared with simple timings of it."""
    total, baselines, of = _minimised(document)
    text = f"{total:.5g} J a cycle{of}"
    for name, energy in baselines.items():
        if energy is not None:
            text += f", {less(total, energy)} than {name}"
    return text + "."


def _minimised(document: Mapping[str, Any]) -> tuple[float, dict[str, float | None], str]:
    """Energies [J] of the cycle and its baselines, in the mean of several models, and the words on this mean."""
    several = document.get("robust")
    energies = several["baselines"] if several else {r["name"]: r["energy_total"] for r in document["baselines"]}
    named = {name.replace("_", " "): energy for name, energy in energies.items()}
    return several["total"] if several else document["energy_total"], named, of_models(several)


def less(energy: float, other: float) -> str:
    """How much less, or more, than another energy [J] one is."""
    percent = round(100 * (1 - energy / other), 3)  # both may be the same plan, but for rounding
    return f"{abs(percent):.3g} % {'more' if percent < 0 else 'less'}"


def table(found: Mapping[str, Any], cycles: float | None) -> str:
    """Table of the steps and savings, for a terminal.

    Args:
        found: the content of job.json. cycles: how many a year, if asked for.
    """
    lines = [f"{'step':<24} {'begins [s]':>10} {'takes [s]':>10} {'energy [J]':>11} {'kg':>5}"]
    for row in found["steps"]:
        lines.append(
            f"{row['name'][:24]:<24} {row['start']:>10.3f} {row['duration']:>10.3f} {row['energy_total']:>11.3f} "
            f"{row['payload']:>5.2g}"
        )
    several, (total, baselines, of) = found.get("robust"), _minimised(found)
    lines.append(f"in a {found['cycle_time']:g} s cycle{of}: this plan {total:.3f} J")
    for name, energy in baselines.items():
        words = ": not possible within the limits"
        lines.append(
            f"  {name}" + (words if energy is None else f" {energy:.3f} J (this plan takes {less(total, energy)})")
        )
    for row in found["models"] if several else []:
        saved = row["saving_total_percent"]
        than = "" if saved is None else f", {less(100 - saved, 100)} than {list(baselines)[-1]}"
        lines.append(f"  under {row['name']}: {row['total']:.3f} J{than}")
    choice = found.get("choice")
    if choice and choice["greedy_nearest"] is not None:
        chosen, nearest = choice["energy_total"], choice["greedy_nearest"]
        lines.append(f"positions at the poses: {chosen:.3f} J a cycle, with the nearest ones {nearest:.3f} J{of}")
    if "per_year" in found:
        lines.append(per_year_words(found["per_year"], cycles or 0.0))
    bound = (several or found["optimality"])["lower_bound"]
    if bound is not None:
        gap = found["optimality"]["gap_percent"]
        lines.append(f"no timing of these paths takes less than {bound:.3f} J{of} (gap {gap:.2g} %)")
    return "\n".join(lines)
