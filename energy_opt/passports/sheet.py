"""The passport of one arm, or of several side by side, and its page: values, friction curves, loss."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.files import write_json
from energy_opt.folders import written_whole
from energy_opt.passports.changes import Change, changes
from energy_opt.passports.sources import Arm, Number, friction, loss, read_arm
from energy_opt.power import PowerModel
from energy_opt.reports.charts import Chart, Line
from energy_opt.reports.page import Report, shown
from energy_opt.results import Found
from energy_opt.robot import Robot, load_robot

FORMAT = "energy-opt/passport/1"
MOST = 12  # most arms in a comparison


@dataclass(frozen=True, repr=False, eq=False)
class Passport(Found):
    """One or several `arms`, `changes` from the first to each other one; by name the values of passport.json."""

    arms: tuple[Arm, ...]
    changes: tuple[Change, ...]
    request: dict[str, Any] = field(default_factory=dict)
    answer = "passport.json"

    @property
    def headline(self) -> str:
        """What the passport says in one sentence, and what is not compared."""
        if len(self.arms) == 1:
            return _summary(self.arms[0])
        compared = [arm for arm in self.arms if arm.robot.joints == self.arms[0].robot.joints]
        if len(compared) == 1:
            return f"{len(self.arms)} arms with different joints, which cannot be compared one by one."
        real = [change for change in self.changes if change.real]
        if real:
            worst = max(real, key=lambda x: abs(x.percent or 0.0))
            said = f"{len(real)} of {len(self.changes)} quantities really changed, most of all {worst}."
        elif any(change.real is not None for change in self.changes):
            said = "No change is outside of the intervals."
        else:
            differing = sum(change.difference != 0 for change in self.changes)
            said = (
                f"{differing} of the {len(self.changes)} quantities that both models state differ; without the "
                "covariances of both models, it is unknown whether these changes are real."
            )
        for what, known in (("standby", "standby"), ("R/Kt²", "copper_loss"), ("friction", "")):
            having = [arm for arm in compared if (arm.model.get(known) if known else arm.friction_effects)]
            if 0 < len(having) < len(compared):
                labels = ", ".join(arm.label for arm in compared if arm not in having)
                said += f" {labels}: no {what} is stated, so it is not compared."
        return said

    def document(self) -> dict[str, Any]:
        """The content of passport.json."""
        return {
            "format": FORMAT,
            "headline": self.headline,
            "arms": [_document(arm) for arm in self.arms],
            "changes": [asdict(change) for change in self.changes],
            "request": self.request,
        }

    def kept(self, out: Path) -> Passport:
        """Write passport.json and report.html into the folder `out`."""
        with written_whole(out, self.answer) as aside:
            write_json(aside / self.answer, self.document())
            page(self.arms, self.changes, self.headline, self.request).write(aside / "report.html")
        return self

    def __str__(self) -> str:
        lines = [self.headline]
        for arm in self.arms:
            lines += _in_words(arm)
        found = [c for c in self.changes if c.real or (c.real is None and c.difference)]
        lines += [f"changed: {change}" for change in found]
        if len(found) < len(self.changes):
            lines.append(f"{len(self.changes) - len(found)} other quantities are in report.html")
        return "\n".join(lines)

    def __repr__(self) -> str:
        return f"Passport({', '.join(arm.label for arm in self.arms)}): {self.headline}"


def passport(
    models: str | PathLike[str] | PowerModel | Sequence[str | PathLike[str] | PowerModel],
    robot: str | PathLike[str] | Robot | None = None,
    limits: str | PathLike[str] | None = None,
    lock: Mapping[str, float] | None = None,
) -> Passport:
    """The electrical passport of one model of an arm, or of several side by side.

    Args:
        models: model files, names of robots, or models in memory; one or several.
        robot: their robot; by default the one that each model names.
        limits: a joint_limits.yaml in MoveIt's format. lock: positions of joints that do not move, by name.

    Raises:
        BadInput: a file is at fault, a name or a robot is not known, or lists do not fit the robot.
    """
    several = [models] if isinstance(models, (str, PathLike, PowerModel)) else list(models)
    given = [m if isinstance(m, PowerModel) else str(m) for m in several]
    if not given:
        raise BadInput("passport needs a model file, or a robot's name")
    if len(given) > MOST:
        raise BadInput(f"passport compares at most {MOST} models; {len(given)} are given")
    file = None if limits is None else Path(limits)
    body = robot if isinstance(robot, Robot) or robot is None else load_robot(str(robot), limits=file, lock=lock)
    arms = []
    for k, (model, label) in enumerate(zip(given, _labels(given), strict=True), start=1):
        if isinstance(model, PowerModel):
            known = body or load_robot(model.robot, limits=file, lock=lock)
            arms.append(Arm(label or f"model {k}", known, model, "", {}))
        else:
            arm = read_arm(model, body, file, lock)
            arms.append(replace(arm, label=label))
    found = [change for arm in arms[1:] for change in changes(arms[0], arm)]
    return Passport(tuple(arms), tuple(found))


def _labels(models: Sequence[str | PowerModel]) -> list[str]:
    """Label of each model: the shortest end of its path that is unique."""
    paths = [Path(m).parts if isinstance(m, str) else (f"model {k}",) for k, m in enumerate(models, start=1)]
    out = []
    for parts in paths:
        size = 1
        while size < len(parts) and sum(other[-size:] == parts[-size:] for other in paths) > 1:
            size += 1
        out.append("/".join(parts[-size:]).removesuffix(".toml"))
    return out


def _summary(arm: Arm) -> str:
    """One sentence on an arm."""
    standby, name = arm.number("standby", "power"), arm.robot.name
    parts = [f"standby {standby.value:.4g} W ({standby.status})" if standby.value is not None else "standby unknown"]
    if arm.model.get("copper_loss") is not None:
        heat = [arm.number("copper_loss", "r_over_kt2", j) for j in range(arm.robot.n)]
        parts.append(f"R/Kt² {_range_text(heat)} ({arm.status('copper_loss')})")
    if arm.friction_effects:
        fast = [arm.friction_at(j, 2) for j in range(arm.robot.n)]
        parts.append(f"friction {_range_text(fast)} at half of the joints' speed ({fast[0].status})")
    else:
        parts.append("friction unknown")
    return f"{name}: {', '.join(parts)}."


def _range_text(numbers: Sequence[Number]) -> str:
    """The least and the largest value of each unit as text."""
    out = []
    for unit in dict.fromkeys(x.unit for x in numbers):
        values = [x.value or 0.0 for x in numbers if x.unit == unit]
        low, high = min(values), max(values)
        out.append(f"{low:.3g}{'' if low == high else f' to {high:.3g}'} {unit.replace('^2', '²')}")
    return " and ".join(out)


def _document(arm: Arm) -> dict[str, Any]:
    """An arm as an entry of passport.json."""
    limits = arm.robot.limits
    joints = []
    for j, joint in enumerate(arm.robot.joints):
        curve = [
            {"speed": float(arm.speeds[j, k]), **{("torque" if key == "value" else key): x for key, x in row.items()}}
            for k in range(arm.speeds.shape[1])
            if (row := arm.friction_at(j, k).document())["value"] is not None
        ]
        joints.append(
            {
                "joint": joint,
                "velocity_limit": float(limits.velocity[j]),
                "effort_limit": float(limits.effort[j]),
                "r_over_kt2": arm.number("copper_loss", "r_over_kt2", j).document(),
                "friction": curve,
            }
        )
    known = arm.model.uncertainty
    return {
        "label": arm.label,
        "robot": arm.robot.name,
        "file": arm.file or None,
        "standby": arm.number("standby", "power").document(),
        "modes": list(arm.modes),
        "joints": joints,
        "values": arm.numbers(),
        "rivals": [[e.name for e in rival.effects] for rival in known.rivals] if known is not None else [],
    }


def _in_words(arm: Arm) -> list[str]:
    """An arm as lines for a terminal."""
    shares = "friction at 1, 10, 50 and 100 % of the velocity limit [N m]"
    shares += "; W/N² and N of joints that slide" if any(arm.robot.slides) else ""
    lines = [f"{arm.label} ({arm.robot.name})", f"  {'joint':<24}{'R/Kt² [W/(N m)²]':>20}   {shares}"]
    if len(arm.modes) > 1:
        levels = ", ".join(f"{mode['power']:.4g} W for {mode['seconds']:.3g} s" for mode in arm.modes)
        lines.insert(1, f"  power at rest: {levels}")
    for j, joint in enumerate(arm.robot.joints):
        heat = arm.number("copper_loss", "r_over_kt2", j)
        rubs = [arm.friction_at(j, k).value for k in range(arm.speeds.shape[1])]
        words = " / ".join(f"{x:.3g}" for x in rubs if x is not None) or "unknown"
        lines.append(f"  {joint:<24}{'unknown' if heat.value is None else f'{heat.value:.4g}':>20}   {words}")
    return lines


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
        columns = {"from": "before_label", "to": "after_label", "quantity": "quantity", "joint": "joint"}
        columns |= {"speed [rad/s, m/s]": "speed", "before": "before", "after": "after", "unit": "unit"}
        columns |= {"change [%]": "percent", "95 %": "ci95", "real": "real"}
        report.records(map(vars, sorted(changes, key=lambda c: (not c.real, -abs(c.percent or 0.0)))), columns)
    return report.command(request)


def _values(report: Report, arm: Arm) -> None:
    """A section of an arm: its values with intervals, status and source."""
    n = arm.robot.n
    report.section(f"{arm.label}: {arm.robot.name}")
    if not any(arm.measured(e.name) for e in arm.model.effects):
        report.text("Nothing here was measured on this arm: the values are published, declared or assumed, as stated.")
    if len(arm.modes) > 1:
        report.text("Levels of power at rest (for example motors on, brakes on, drives off):")
        columns = {"power [W]": "power", "seconds": "seconds", "standstills": "standstills"}
        report.records(arm.modes, columns)
    records = [["standby", None, *_cells(arm.number("standby", "power"))]]
    records += [["R/Kt²", arm.robot.joints[j], *_cells(arm.number("copper_loss", "r_over_kt2", j))] for j in range(n)]
    for j in range(n):
        speed = arm.robot.unit("velocity", arm.robot.joints[j])
        records += [
            [f"friction at {arm.speeds[j, k]:.3g} {speed}", arm.robot.joints[j], *_cells(arm.friction_at(j, k))]
            for k in range(arm.speeds.shape[1])
        ]
    report.table(["quantity", "joint", "value", "95 %", "unit", "status", "source"], records)
    shown_above = ("standby", "copper_loss")
    others = [row for row in arm.numbers() if row["effect"] not in shown_above]
    heads = {name: name for name in ("effect", "parameter", "joint", "value")}
    report.records(others, {**heads, "95 %": "ci95", "unit": "unit", "status": "status"})


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
    robots = {joint: arm.robot for arm in arms for joint in arm.robot.joints}
    units = {joint: [robot.unit(kind, joint) for kind in ("velocity", "effort")] for joint, robot in robots.items()}
    return [
        Chart(joint, f"speed [{units[joint][0]}]", f"friction [{units[joint][1]}]", records)
        for joint, records in lines.items()
    ]


def _maps(arm: Arm) -> bytes:
    """Colour maps of the loss of each joint over torque and speed, as PNG."""
    from energy_opt.reports.plots import loss_maps, png  # slow to import

    limits, maps = arm.robot.limits, {}
    for j, joint in enumerate(arm.robot.joints):
        most = limits.effort[j] if np.isfinite(limits.effort[j]) and limits.effort[j] > 0 else 50.0
        torque = np.linspace(-0.6, 0.6, GRID) * most
        speed = np.linspace(-1.0, 1.0, GRID) * arm.speeds[j, -1]
        maps[joint] = (speed, torque, loss(arm.model, arm.robot.n, j, torque, speed))
    return png(loss_maps(maps))
