"""report.html of a diagnosis: power over time, residual against signals, evidence and errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from energy_opt.diagnosis.data.predict import friction_torque, predict
from energy_opt.diagnosis.data.samples import Samples
from energy_opt.diagnosis.evidence.errors import reading_of
from energy_opt.diagnosis.joint_side import STILL, JointSide
from energy_opt.diagnosis.verdict.findings import Result
from energy_opt.power.variants import draws_of
from energy_opt.reports.charts import Chart, Line
from energy_opt.reports.page import Report
from energy_opt.robot import Robot

WORDS = {
    "explained": "Effects were found, and the remaining error is no larger than the noise.",
    "partly": "Effects were found that hold on held-out motions, but the remaining error is larger than the noise.",
    "ambiguous": "The data cannot tell some effects apart; they are listed together.",
    "nothing_missing": "The error of the declared model is no larger than the noise.",
    "unexplained": "The error is larger than the noise, and no known effect explains it.",
    "insufficient": "The motions do not excite the effects enough.",
}
SHOWN = 12  # most runs with a chart
WILD = 3.0  # measured points above this multiple of a joint's largest friction are not drawn (slow, noisy)
MOSTLY = 0.5  # least share of all joints' speed for a reading to be shown as one joint's friction


def page(result: Result) -> Report:
    """Build the HTML report."""
    d = result.document()
    report = Report(f"Diagnosis of {result.measured.path.name}: {d['verdict'] or 'stopped'}")
    report.headline(d["headline"])
    report.text(WORDS.get(d["verdict"], "Stopped before a verdict was reached; this page shows the results so far."))
    report.text(d["next_step"])
    report.warning(*d["remarks"])
    if result.samples is None:
        _effects(report, result)
        assert result.side is not None
        joints_section(report, d["joint_side"], result.side)
        return report.command(d.get("request"))
    _effects(report, result)
    if d["alternatives"]:
        report.text("Sets that fit equally well: " + "; ".join(" + ".join(names) for names in d["alternatives"]))
    report.section("Error before and after")
    records = []
    for when in ("before", "after"):
        for part in ("train", "holdout"):
            e = d["error"][when][part]
            if e is not None:
                records.append([f"{when}, {part}", e["energy_percent"], e["energy_percent_ci95"], e["power_rmse"],
                             e["power_rmse_ci95"]])  # fmt: skip
    report.table(["", "error of energy [%]", "95 % [%]", "power RMSE [W]", "95 % [W]"], records)
    report.facts({"noise floor [W]": d["error"]["noise_floor"]})
    worth = d.get("worth")
    if worth is not None:
        report.section("What the diagnosis is worth")
        report.text(
            f"The longest move of the set ({worth['file']}, {worth['duration']:.3g} s), planned and evaluated anew. "
            "All energies are under the diagnosed model."
        )
        report.table(
            ["the move", "energy [J]"],
            [
                ["planned with the diagnosed model", worth["diagnosed_plan"]],
                ["planned with the declared model", worth["declared_plan"]],
                ["evenly slowed", worth["evenly_slowed"]],
            ],
        )
    report.section("Signals that the residual depends on")
    if d["residual_goes_with"]:
        watts = [r["watts"] for r in d["remainder"]]
        goes = d["residual_goes_with"]
        records = [[r["signal"], r["joint"], r["strength"], w] for r, w in zip(goes, watts, strict=True)]
        report.table(["signal", "joint", "share of what is left [1]", "rms [W]"], records, 3)
    else:
        report.text("None: the residual is noise.")
    report.charts(*_residuals(result, result.samples))
    if any(e.stage == "torque" and e.dissipates for e in result.model.effects):
        report.section("Friction against speed")
        report.text(
            "Friction of the calibrated model with its 95 % band; dots are what is measured beside it where a joint "
            "does most of the motion."
        )
        report.charts(*_friction(result, result.samples))
    if result.side is not None:
        joints_section(report, d["joint_side"], result.side)
    report.section("Power over time")
    report.charts(*_power(result, result.samples))
    report.section("Evidence for each hypothesis")
    report.text(
        "Hypotheses that were fitted, likeliest first. Loss is the mean square of the whitened residual, 1 where only "
        "noise is left; the score is the logarithm of the odds against the declared model."
    )
    report.table(
        ["effects", "structures outside the table", "numbers", "loss per sample", "score"],
        [[", ".join(r["effects"]) or "declared model", ", ".join(r["structures"]), r["numbers"], r["loss_per_sample"],
          r["score"]] for r in d["evidence"]],
    )  # fmt: skip
    return report.command(d.get("request"))


def _effects(report: Report, result: Result) -> None:
    """Section on the claimed effects with all their numbers."""
    report.section("Effects")
    if not result.effects:
        report.text("None is claimed.")
        return
    table = [[x.name, 100 * x.share_of_residual, x.log_odds] for x in result.effects]
    report.table(["effect", "share of the explained part that is lost without it [%]", "log odds"], table, digits=3)
    header = ["effect", "parameter", "joint", "value", "95 % interval", "unit"]
    report.table(header, [line for x in result.effects for line in _values(x.document(), result.measured.robot)])


def _values(row: Mapping[str, Any], robot: Robot) -> list[list[object]]:
    """Table records of an effect, one for each number."""
    out: list[list[object]] = []
    for name, value in row["parameters"].items():
        unit, interval = row["units"].get(name), row["ci95"].get(name)
        if not isinstance(value, list):
            out.append([row["name"], name, None, value, interval, unit])
            continue
        each = len(value) == robot.n
        owners = robot.joints if each else [str(k) for k in range(1, len(value) + 1)]
        units = unit if isinstance(unit, list) else [unit] * len(value)
        for line in zip(owners, value, interval or [None] * len(value), units, strict=True):
            out.append([row["name"], name, *line])
    return out


def _power(result: Result, samples: Samples) -> list[Chart]:
    """Measured, declared and calibrated power of every run (the first `SHOWN` of them)."""
    moving = [k for k, kind in enumerate(samples.kinds) if kind == "motion"] or list(range(len(samples.kinds)))
    declared, after = reading_of(result.declared, samples), reading_of(result.model, samples)
    charts = []
    for run in moving[:SHOWN]:
        time, power = samples.single[run]
        where = "held out" if run in result.holdout else "train"
        lines = [
            Line("measured", time, power, "faint"),
            Line("declared", time, declared[run]),
            Line("calibrated", time, after[run]),
        ]
        charts.append(Chart(f"{samples.files[run]} ({where})", "set time [s]", "power [W]", lines))
    return charts


def _residuals(result: Result, samples: Samples) -> list[Chart]:
    """The residual before and after against time, speed, torque and temperature."""
    p = predict(result.model, samples)
    before, after = samples.power - predict(result.declared, samples).reading, samples.power - p.reading
    speed = samples.shown(np.abs(samples.v).max(axis=1))
    torque = samples.shown(np.linalg.norm(p.tau, axis=1))
    panels = [("set time [s]", samples.at), ("fastest joint [rad/s]", speed), ("torque, norm [N m]", torque)]
    if np.isfinite(samples.temperature).all():
        panels.append(("mean joint temperature [degC]", samples.shown(samples.temperature.mean(axis=1))))
    return [
        Chart(
            f"Residual against {name.partition(' [')[0]}",
            name,
            "measured - model [W]",
            [Line("declared", x, before, "points"), Line("calibrated", x, after, "points")],
        )
        for name, x in panels
    ]


def _friction(result: Result, samples: Samples) -> list[Chart]:
    """Friction of every joint over speed: the model with its band, points where the joint does most of the motion."""
    model, n = result.model, samples.n
    p = predict(model, samples)
    bare = model.kept(lambda e: not (e.stage == "torque" and e.dissipates))
    excess = samples.power - predict(bare, samples).reading
    mean = friction_torque(model, n)
    draws = [friction_torque(drawn, n) for drawn in draws_of(model, 60)]
    rest = samples.power - p.reading
    charts = []
    robot = result.measured.robot
    for j, joint in enumerate(robot.joints):
        v = samples.shown(samples.v[:, j])
        fastest = max(float(np.abs(v).max()), 0.05)
        grid = np.linspace(-fastest, fastest, 121)
        own = mean(grid, j)
        low = high = None
        if draws:
            low, high = np.quantile([draw(grid, j) for draw in draws], [0.025, 0.975], axis=0)
        lines = []
        share = np.abs(v) / np.maximum(samples.shown(np.abs(samples.v).sum(axis=1)), 1e-9)
        mostly = (share > MOSTLY) & (np.abs(v) > 0.05)
        if mostly.any() and np.any(excess[mostly]):
            measured = mean(v[mostly], j) + rest[mostly] / v[mostly]
            near = np.abs(measured) < WILD * max(float(np.abs(own).max()), 0.05)
            lines.append(Line("measured", v[mostly][near], measured[near], "points"))
        lines.append(Line("calibrated", grid, own, low=low, high=high))
        speed, force = (robot.unit(kind, joint) for kind in ("velocity", "effort"))
        charts.append(Chart(f"Friction of {joint}", f"speed [{speed}]", f"friction [{force}]", lines))
    return charts


def joints_section(report: Report, records: Sequence[dict[str, Any]], side: JointSide) -> None:
    """Add a section on the joints' own readings: drive constants, friction by readings and by the power, charts.

    Args:
        records: as `joint_report.side_records` gives them. side: the fit that they state.
    """
    report.section("The joints' own readings")
    table = []
    for row in records:
        words = [row[key] for key in ("own", "power", "together")]
        shown = [x for w in words for x in ((w["friction"], w["ci95"]) if w else (None, None))]
        kt = [row["scale"], row["scale_ci95"], row["unit"]]
        table.append([row["joint"], *kt, row["speed"], row["units"]["speed"], *shown, row["units"]["friction"]])
    report.table(
        ["joint", "Kt" if side.unit == "A" else "reading / torque", "95 %", "unit", "speed", "unit", "friction there",
         "95 %", "by the power alone", "95 %", "by both", "95 %", "unit"],
        table,
        digits=3,
    )  # fmt: skip
    report.charts(*_charts(records, side))


def _charts(records: Sequence[dict[str, Any]], side: JointSide) -> list[Chart]:
    charts = []
    for j, row in enumerate(records):
        if row["own"] is None:
            continue
        v = side.samples.v[:, j]
        moves = np.abs(v) > STILL
        grid = np.linspace(v.min(), v.max(), 121)
        seen = [side.friction(j, abs(x)) for x in grid]
        own, wide = (np.array([s[k] for s in seen]) for k in (0, 1))
        way = np.sign(grid)
        here = np.array([side.friction(j, abs(x))[0] for x in v[moves]]) * np.sign(v[moves])
        charts.append(
            Chart(
                f"Friction of {row['joint']} by its own readings",
                f"speed [{row['units']['speed']}]",
                f"friction [{row['units']['friction']}]",
                [
                    Line("measured", v[moves], here + side.left[moves, j], "points"),
                    Line("fitted", grid, own * way, low=own * way - 2 * wide, high=own * way + 2 * wide),
                ],
            )
        )
    return charts
