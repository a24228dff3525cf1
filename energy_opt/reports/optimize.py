"""The page of one optimized move: saving, the arm in motion, limits, energies, certificate."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.cell.words import clearance_words
from energy_opt.power.assumptions import Assumption, grouped, until
from energy_opt.reports.charts import Chart, Line
from energy_opt.reports.motion import Closest, Motion, Played, player
from energy_opt.reports.page import Report
from energy_opt.reports.words import (
    energy_records,
    first_path_words,
    goals_words,
    input_words,
    limits_words,
    yearly,
)
from energy_opt.robot import Robot

BESIDE = "scaled"  # the baseline that savings are stated against


def page(
    document: Mapping[str, Any],
    result: Motion,
    baselines: Mapping[str, Motion],
    robot: Robot,
    cell: Cell | None = None,
    lost: Mapping[str, Mapping[str, np.ndarray]] | None = None,
) -> Report:
    """The report of a result.json and the trajectories that belong to it.

    Args:
        document: the content of result.json.
        baselines: trajectories by name; "scaled" is drawn beside the result, if it is valid.
        cell: bodies for drawing the moving arm; None: the arm's own.
        lost: loss by each effect at each joint (n,) [J], by motion.
    """
    report = Report(f"{document['robot']}: {document['mode']} in {document['duration']:.4g} s")
    report.headline(headline(document)).numbers(_numbers(document))
    if goals := goals_words(document):
        report.text(f"{goals[0].upper()}{goals[1:]}.")
    report.warning(*document.get("warnings", ()))
    if document.get("message"):
        report.warning(f"{document['status']}: {document['message']}")
    beside = {} if _slowed(document) is None else {BESIDE: baselines[BESIDE]}
    motions = [Played("result", result), *(Played(name, motion, ghost=True) for name, motion in beside.items())]
    report.player(player(robot, motions, cell, _closest(document)))
    report.section("Motion").charts(*motion_charts(result, beside, robot))
    _energy(report, document)
    standby = document["energy"]["standby"] / document["duration"]
    report.charts(_cumulative(result, beside, standby), *_by_joint(lost or {}, robot))
    columns = {"total [J]": "total", "loss [J]": "loss", "loss saved [%]": "saving_loss_percent"}
    columns["95 % interval [%]"] = "saving_interval"
    report.models("The same move under other models", document.get("models"), columns)
    assumed(report, document)
    _certificate(report, document, robot)
    report.section("Search")
    optimality, solver, robust = document["optimality"], document["solver"], document.get("robust")
    first = document.get("first_path")
    found = {"first path": first["source"], "found in [s]": first["seconds"]} if first else {}
    report.facts({"taken from": document.get("chosen"), **found, **_in_seconds(solver)})
    report.facts(
        {
            "minimised": f"the {robust['kind']} of the models' energies" if robust else None,
            "optimum": optimality["kind"],
            "lower bound [J]": (robust or optimality)["lower_bound"],
            "gap to it [%]": optimality["gap_percent"],
        }
    )
    if len(document.get("progress", ())) > 1:
        report.charts(_progress(document["progress"]))
    return report.command(document.get("request"))


def headline(document: Mapping[str, Any]) -> str:
    """One sentence: energy and saving of the move, and whether it is clear."""
    energy, saving = document["energy"], document["saving"]
    text = f"{energy['total']:.4g} J in {document['duration']:.4g} s"
    if saving is not None and saving["joules"] is not None:
        share = "" if saving["loss_percent"] is None else f", {saving['loss_percent']:.3g} % of that one's loss"
        path = first_path_words((document.get("first_path") or {}).get("source"))
        text += f": {saving['joules']:.3g} J less than the evenly slowed {path}{share}"
    elif document.get("remark"):
        text += f"; {document['remark']}"
    beside = input_words(document)
    text += f". {beside[0].upper()}{beside[1:]}" if beside else ""
    clearance = document["certificate"].get("clearance")
    if clearance is None:
        return f"{text}. Collisions were not checked."
    words = clearance_words(clearance)
    return f"{text}. {words[0].upper()}{words[1:]}."


def _numbers(document: Mapping[str, Any]) -> dict[str, str]:
    """The figures at the top of the page: savings, energy, duration, peak power, clearance."""
    saving, out = document["saving"] or {}, {}
    for name, key in (("of the loss saved", "loss_percent"), ("of the total saved", "total_percent")):
        if saving.get(key) is not None:
            out[name] = f"{saving[key]:.3g} %"
    out |= yearly(document)
    out["energy"] = f"{document['energy']['total']:.4g} J"
    out["duration"] = f"{document['duration']:.4g} s"
    if document.get("peak_power") is not None:
        peak = (_slowed(document) or {}).get("peak_power")
        slowed = "" if peak is None else f"; evenly slowed {peak:.4g} W"
        out[f"peak power{slowed}"] = f"{document['peak_power']:.4g} W"
    clearance = document["certificate"].get("clearance")
    if clearance and clearance["verdict"] == "proven":
        before, _, near = clearance_words(clearance).rstrip(")").partition(" (")
        what, _, bound = before.partition(" ≥ ")
        out[f"{what}; {near}"] = f"≥ {bound}" if bound else "yes"
    elif clearance:
        what, _, near = clearance_words(clearance).partition(": ")
        out[near or "of the arm and its cell"] = what
    return out


def _slowed(document: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """The record of the baseline that savings are stated against; None if it is not valid."""
    return next((b for b in document["baselines"] if b["name"] == BESIDE and b["valid"]), None)


def _closest(document: Mapping[str, Any]) -> Closest | None:
    """The closest pair of bodies for the player; None if it is not known."""
    found = document["certificate"].get("clearance")
    if not found or found.get("time") is None or found.get("min_distance") is None or not found["pair"]:
        return None
    return Closest(tuple(found["pair"]), float(found["min_distance"]), float(found["time"]))


def motion_charts(result: Motion, beside: Mapping[str, Motion], robot: Robot) -> list[Chart]:
    """Charts of positions, then of limited quantities as shares of their bounds, then of power.

    Args:
        result: the motion. beside: others by name, whose power is drawn, too. robot: for limits and units.
    """
    limits, t = robot.limits, result.time - result.time[0]
    charts, slides = [], np.array(robot.slides)
    for title, unit, chosen in (("Position", "rad", ~slides), ("Position of joints that slide", "m", slides)):
        lines = _joints(robot, t, np.where(chosen, result.position, np.nan))
        charts.append(Chart(title, "time [s]", f"position [{unit}]", lines, timed=True))
    bounded: list[tuple[str, np.ndarray | None, np.ndarray]] = [
        ("velocity", result.velocity, limits.velocity),
        ("acceleration", result.acceleration, limits.acceleration),
        ("torque", result.effort, limits.effort),
    ]
    for name, values, bound in bounded:
        has = np.isfinite(bound)
        if values is None or not has.any():
            continue
        title, marks = f"{_title(name, slides)}, as a share of its limit", {"limit": 1.0, "-limit": -1.0}
        lines = _joints(robot, t, np.where(has, values / np.where(has, bound, 1.0), np.nan))
        shown = name != "acceleration"
        charts.append(Chart(title, "time [s]", f"{name} / limit [1]", lines, marks, timed=True, pictured=shown))
    both = {**beside, "result": result}
    power = [Line(name, m.time - m.time[0], m.power) for name, m in both.items() if m.power is not None]
    charts.append(Chart("Electrical power", "time [s]", "power [W]", power, timed=True, pictured=True))
    return charts


def _cumulative(result: Motion, beside: Mapping[str, Motion], standby: float) -> Chart:
    """Energy since the start, of both motions, above `standby` [W], which would hide the rest."""
    lines = []
    for name, m in {**beside, "result": result}.items():
        if m.power is not None:
            t, above = m.time - m.time[0], m.power - standby
            steps = np.diff(t) * (above[1:] + above[:-1]) / 2
            lines.append(Line(name, t, np.concatenate([[0.0], np.cumsum(steps)])))
    return Chart("Energy used so far, standby left out", "time [s]", "energy [J]", lines, timed=True)


def _progress(records: Sequence[Mapping[str, float]]) -> Chart:
    """Least loss of a proven answer over the time of the search; it stays until a better one is found."""
    seconds, loss = (np.array([row[key] for row in records]) for key in ("seconds", "loss"))
    line = Line("best proven answer", np.repeat(seconds, 2)[1:], np.repeat(loss, 2)[:-1])
    return Chart("Best proven answer while the search ran", "time of the search [s]", "loss [J]", [line])


def _by_joint(lost: Mapping[str, Mapping[str, np.ndarray]], robot: Robot) -> list[Chart]:
    """A joint's losses by all effects together, of both motions."""
    bars = {}
    for name, by_effect in lost.items():
        if by_effect:
            total = np.sum(list(by_effect.values()), axis=0).tolist()
            bars[name] = dict(zip(robot.joints, total, strict=True))
    return [Chart("Loss by joint", "energy [J]", "", bars=bars)] if bars else []


def _title(name: str, slides: np.ndarray) -> str:
    if name == "torque" and slides.any():
        return "Force" if slides.all() else "Torque and force"
    return name.capitalize()


def _joints(robot: Robot, t: np.ndarray, values: np.ndarray) -> list[Line]:
    columns = enumerate(robot.joints)
    return [Line(joint, t, values[:, j]) for j, joint in columns if np.isfinite(values[:, j]).any()]


def _energy(report: Report, document: Mapping[str, Any]) -> None:
    """Energies of the result and of its baselines, by part and by effect."""
    columns = [("result", document["duration"], document["energy"], True)]
    columns += [(b["name"], b["duration"], b["energy"], b.get("valid", True)) for b in document["baselines"]]
    compared = {name: energy["by_effect"] for name, _, energy, valid in columns if valid and name in ("result", BESIDE)}
    bars = {name: {k: v for k, v in parts.items() if k != "standby"} for name, parts in compared.items()}
    report.section("Energy")
    report.charts(Chart("Energy by effect, standby left out", "energy [J]", "", bars=bars, pictured=True))
    records = energy_records([(d, e) for _, d, e, _ in columns], "{} [J]", "of the total: {} [J]")
    records.append(["valid: all checked limits are kept", *(valid for _, _, _, valid in columns)])
    report.table(["", *(name for name, _, _, _ in columns)], records)


def assumed(report: Report, document: Mapping[str, Any]) -> None:
    """The section of values that were not given, with sources; of friction that ends the saving; of long travel."""
    records = [Assumption(**row) for row in document.get("assumptions", ())]
    if records:
        report.section("Values that were not given")
        report.table(["what", "value", "source", "note"], [list(row) for row in grouped(records)])
    share = document.get("break_even_friction")
    if records and share is not None:
        report.text(f"{until(share).capitalize()}.")
    if far := document.get("travel"):
        joints = [f"{row['step']}: {row['joint']}" if "step" in row else row["joint"] for row in far]
        lengths = [[round(row[key], 5) for key in ("path", "straight")] for row in far]  # hundredths of a mrad or mm
        report.section("Joints that travel more than 1.5 times the distance to their goal").table(
            ["joint", "travels [rad, m]", "distance to the goal [rad, m]"],
            [[joint, *both] for joint, both in zip(joints, lengths, strict=True)],
        )


def _certificate(report: Report, document: Mapping[str, Any], robot: Robot) -> None:
    """The use of the limits, and the clearance."""
    certificate = document["certificate"]
    report.section("Certificate")
    report.text(
        f"Recomputed from trajectory.csv on {certificate['samples']} samples with Pinocchio's torque. A violation is a "
        "share of the bound; at or below zero is inside."
    )
    report.table(
        ["limit", "largest violation [share of the bound]"], list(map(list, certificate["max_violation"].items()))
    )
    if certificate["worst"]:
        words = limits_words(certificate, robot.unit)
        report.text(f"{words[0].upper()}{words[1:]}.")
    if certificate.get("clearance"):
        c = certificate["clearance"]
        report.facts(
            {
                "clearance": c["verdict"],
                "proven lower bound [m]": c["lower_bound"],
                "smallest measured distance [m]": c["min_distance"],
                "nearest pair": c["pair"],
                "at [s]": c["time"],
                "pairs checked": _count(c.get("pairs")),
                "pairs left out": _count(c.get("disabled_pairs")),
                "left out by": c.get("source"),
            }
        )


def _count(value: Any) -> Any:
    return len(value) if isinstance(value, (list, tuple)) else value


def _in_seconds(values: Mapping[str, Any]) -> dict[str, Any]:
    """build_seconds -> "build [s]"; compiled -> "model compiled"."""
    named = {"compiled": "model compiled"}
    return {named.get(name, re.sub("_seconds$", " [s]", name)): value for name, value in values.items()}
