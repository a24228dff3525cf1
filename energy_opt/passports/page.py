"""The page of a passport: values with intervals and sources, friction curves, loss over torque and speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from energy_opt.passports.changes import Change
from energy_opt.passports.sources import Arm, Number, friction, loss
from energy_opt.reports.charts import Chart, Line
from energy_opt.reports.page import Report, shown
from energy_opt.reports.plots import loss_maps, png

POINTS = 41  # points of a curve
GRID = 25  # points of a map along each axis


def page(arms: Sequence[Arm], changes: Sequence[Change], headline: str, request: Mapping[str, Any]) -> Report:
    """The report of a passport.

    Args:
        arms: with their values. changes: between the first and the others. headline: one sentence. request: as asked.
    """
    names = ", ".join(arm.label for arm in arms)
    report = Report(f"Electrical passport: {names}").headline(headline)
    for arm in arms:
        _values(report, arm)
    report.section("Friction").text(
        "Torque against the motion without load, the mean of both directions; bands are 95 % intervals if the model "
        "has a covariance."
    )
    report.charts(*_curves(arms))
    for arm in arms:
        report.section(f"Loss of {arm.label} over torque and speed").text(
            "Power at the meter less mechanical power and standby, of one joint alone."
        )
        report.picture(_maps(arm), f"loss of {arm.label} in W, by joint")
    if changes:
        report.section("What differs")
        report.text(
            "A change is real where 0 lies outside of its interval; the intervals are so wide that all of them hold at "
            "once in 95 % of cases."
        )
        header = ["from", "to", "quantity", "joint", "speed [rad/s]", "before", "after", "unit"]
        report.table(
            [*header, "change [%]", "95 %", "real"],
            [
                [c.before_label, c.after_label, c.quantity, c.joint, c.speed, c.before, c.after, c.unit]
                + [c.percent, c.ci95, c.real]
                for c in sorted(changes, key=lambda c: (not c.real, -abs(c.percent or 0.0)))
            ],
        )
    return report.command(request)


def _values(report: Report, arm: Arm) -> None:
    """A section of an arm: its values with intervals, status and source."""
    n = arm.robot.n
    report.section(f"{arm.label}: {arm.robot.name}")
    if not any(arm.measured(e.name) for e in arm.model.effects):
        report.text("Nothing here was measured on this arm: the values are published, declared or assumed, as stated.")
    if len(arm.modes) > 1:
        report.text("Levels of power at rest (for example motors on, brakes on, drives off):")
        report.table(
            ["power [W]", "seconds", "standstills"], [[m["power"], m["seconds"], m["standstills"]] for m in arm.modes]
        )
    records = [["standby", None, *_cells(arm.number("standby", "power"))]]
    records += [["R/Kt²", arm.robot.joints[j], *_cells(arm.number("copper_loss", "r_over_kt2", j))] for j in range(n)]
    for j in range(n):
        records += [
            [f"friction at {arm.speeds[j, k]:.3g} rad/s", arm.robot.joints[j], *_cells(arm.friction_at(j, k))]
            for k in range(arm.speeds.shape[1])
        ]
    report.table(["quantity", "joint", "value", "95 %", "unit", "status", "source"], records)
    shown_above = ("standby", "copper_loss")
    others = [row for row in arm.numbers() if row["effect"] not in shown_above]
    report.table(
        ["effect", "parameter", "joint", "value", "95 %", "unit", "status"],
        [[r["effect"], r["parameter"], r["joint"], r["value"], r["ci95"], r["unit"], r["status"]] for r in others],
    )


def _cells(number: Number) -> list[object]:
    """A number as cells of a table."""
    value = "unknown" if number.value is None else shown(number.value)
    return [value, number.ci95, number.unit, number.status, number.source]


def _curves(arms: Sequence[Arm]) -> list[Chart]:
    """One chart per joint, one line per arm."""
    lines: dict[str, list[Line]] = {}
    for arm in arms:
        if not arm.friction_effects:
            continue
        speed = np.linspace(0.0, 1.0, POINTS) * arm.speeds[:, -1:]
        speed[:, 0] = speed[:, 1] / 20  # at rest friction has no direction
        here = friction([arm.model], speed)[0]
        low = high = None
        if arm.draws and np.ptp(arm.friction_draws, axis=0).any():
            low, high = np.quantile(friction(arm.draws, speed), [0.025, 0.975], axis=0)
        for j, joint in enumerate(arm.robot.joints):
            band = {} if low is None or high is None else {"low": low[j], "high": high[j]}
            lines.setdefault(joint, []).append(Line(arm.label, speed[j], here[j], "line", arm.label, **band))
    return [Chart(joint, "speed [rad/s]", "friction [N m]", records) for joint, records in lines.items()]


def _maps(arm: Arm) -> bytes:
    """Colour maps of the loss of each joint over torque and speed, as PNG."""
    limits, maps = arm.robot.limits, {}
    for j, joint in enumerate(arm.robot.joints):
        most = limits.effort[j] if np.isfinite(limits.effort[j]) and limits.effort[j] > 0 else 50.0
        torque = np.linspace(-0.6, 0.6, GRID) * most
        speed = np.linspace(-1.0, 1.0, GRID) * arm.speeds[j, -1]
        maps[joint] = (speed, torque, loss(arm.model, arm.robot.n, j, torque, speed))
    return png(loss_maps(maps))
